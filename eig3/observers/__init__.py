"""What watches a run between its native chunks: the history, invariants, growth, progress and Ctrl-C."""
