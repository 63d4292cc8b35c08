"""Detect a right-hand side that stops writing an entry of a in the middle of a run.

The entry would keep its value from an earlier evaluation, and the run would look well. An array that is filled with NaN
before each evaluation in the kernel would show this, but takes time in each step. So rhs is evaluated once more at the
ends of chunks.
"""

from __future__ import annotations

from .chunk import Chunk

_LEAST_STEPS = 100  # between two evaluations, so that they take little time


class Written:
    """Whether the right-hand side, in the vector form, writes every entry of a at the ends of chunks and of the run."""

    def __init__(self, n_steps: int) -> None:
        self._last, self._n_steps = 0, n_steps

    def see(self, chunk: Chunk) -> None:
        """Raise a ValueError if rhs leaves out an entry of a at the end of the chunk."""
        stepper = chunk.stepper
        if stepper.index - self._last < _LEAST_STEPS and stepper.index < self._n_steps:
            return
        self._last = stepper.index
        j = stepper.find_unwritten()
        if j is not None:
            raise unwritten_entry(j, stepper.t - stepper.h)


def unwritten_entry(j: int, t: float) -> ValueError:
    """Return the error for an entry of a that rhs does not write at the time t."""
    return ValueError(
        f"rhs does not write a[{j}] at t = {t:g}, so that a[{j}] keeps its value from an earlier evaluation; write "
        "every a[j] in every evaluation."
    )
