"""Runs of one system: `integrate`, prepared runs, and the saved history."""
