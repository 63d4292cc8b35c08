"""Benchmarks: the article's tables, and the speed of the loops."""
