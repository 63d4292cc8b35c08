"""The observers of a run, which see one chunk of steps at a time: history, invariants, outputs, growth and progress."""
