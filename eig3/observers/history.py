"""The saved states of a run."""

from __future__ import annotations

import numpy as np

from ..memory import n_rows
from ..stepper import Cancel, Stepper
from .chunk import Chunk

_SCRATCH_VALUES = 2**19  # values in an array of states that are not saved: 4 MB, so that it stays in the cache


class History:
    """The first state, every `every`-th state and the last state of a run of `n_steps` steps.

    If `all_states` is true, the chunks contain every state, because another observer needs all of them.
    """

    def __init__(self, n_steps: int, every: int, stepper: Stepper, all_states: bool) -> None:
        u, v = stepper.start
        rows = n_rows(n_steps, every)
        self.every = every
        shape = rows, *np.shape(u)
        self.u, self.v = np.empty(shape), np.empty(shape)
        self.u[0], self.v[0] = u, v
        self._t = np.arange(rows, dtype=np.float64)  # made before the run, so that memory cannot run out later
        self._t *= every
        self._t[-1] = n_steps
        self._t *= stepper.h
        self._t += stepper.t0
        self._chunk_every = 1 if all_states else every
        #: Largest number of steps in a chunk.
        self.most = max(1, _SCRATCH_VALUES // stepper.n) if all_states and every > 1 else n_steps

    def advance(self, stepper: Stepper, count: int, cancel: Cancel) -> Chunk:
        """Take `count` steps, or fewer if a solve fails or `cancel` is set, and return them as a chunk."""
        first, every = stepper.index, self._chunk_every
        u, v = self._rows(first, count)
        taken = stepper.advance(count, every, u, v, cancel)
        states = (first + taken) // every - first // every
        return Chunk(first, every, u[:states], v[:states], stepper)

    def _rows(self, first: int, count: int) -> tuple[np.ndarray, np.ndarray]:
        if self._chunk_every == self.every:
            rows = slice(first // self.every + 1, (first + count) // self.every + 1)
            return self.u[rows], self.v[rows]
        shape = count, *self.u.shape[1:]
        return np.empty(shape), np.empty(shape)

    def see(self, chunk: Chunk) -> None:
        """Save states of a chunk that contains every state."""
        if chunk.every == self.every:
            return  # the rows of the chunk are rows of the history
        kept = slice(self.every - 1 - chunk.first % self.every, None, self.every)
        begin = chunk.first // self.every + 1
        end = begin + len(chunk.u[kept])
        self.u[begin:end], self.v[begin:end] = chunk.u[kept], chunk.v[kept]

    def close(self, stepper: Stepper) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return t, u and v of the saved states. The last one is the state of `stepper`."""
        rows = n_rows(stepper.index, self.every)
        self._t[rows - 1], self.u[rows - 1], self.v[rows - 1] = stepper.t, stepper.u, stepper.v
        return self._t[:rows], self.u[:rows], self.v[:rows]
