"""Compilation: options, inlined elements, the cache on the disk, and interrupts."""
