"""The states that a run keeps."""

from __future__ import annotations

import numpy as np

from ..memory import n_rows
from ..stepper import Stepper
from .chunk import Chunk

_SCRATCH_VALUES = 2**19  # of one array of states that only invariants see: 4 MB, so that it stays in cache


class History:
    """Every `every`-th state of a run of `n_steps`, with the first and the last.

    With `all_states`, the chunks hold every state, because another observer looks at each of them.
    """

    def __init__(self, n_steps: int, every: int, stepper: Stepper, all_states: bool) -> None:
        u, v = stepper.start
        rows = n_rows(n_steps, every)
        self.every = every
        self.u, self.v = (np.empty((rows, *np.shape(u))) for _ in range(2))
        self.u[0], self.v[0] = u, v
        self._t = np.arange(rows, dtype=np.float64)  # made here, in place, so that memory runs out before the run
        self._t *= every
        self._t[-1] = n_steps
        self._t *= stepper.h
        self._t += stepper.t0
        self._chunk_every = 1 if all_states else every
        #: The most steps of a chunk.
        self.most = max(1, _SCRATCH_VALUES // np.size(u)) if all_states and every > 1 else n_steps

    def advance(self, stepper: Stepper, count: int) -> Chunk:
        """Take `count` steps, or fewer where a solve fails, and return them as a chunk."""
        first, every = stepper.index, self._chunk_every
        u, v = self._rows(first, count)
        taken = stepper.advance(count, every, u, v)
        states = (first + taken) // every - first // every
        return Chunk(first, every, u[:states], v[:states], stepper)

    def _rows(self, first: int, count: int) -> tuple[np.ndarray, np.ndarray]:
        if self._chunk_every == self.every:
            rows = slice(first // self.every + 1, (first + count) // self.every + 1)
            return self.u[rows], self.v[rows]
        shape = count, *self.u.shape[1:]
        return np.empty(shape), np.empty(shape)

    def see(self, chunk: Chunk) -> None:
        """Keep the states of a chunk that holds more than those to keep."""
        if chunk.every == self.every:
            return  # its rows are ours
        kept = slice(self.every - 1 - chunk.first % self.every, None, self.every)
        begin = chunk.first // self.every + 1
        end = begin + len(chunk.u[kept])
        self.u[begin:end], self.v[begin:end] = chunk.u[kept], chunk.v[kept]

    def close(self, stepper: Stepper) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """t, u and v of the states kept, up to and with the one where `stepper` stands."""
        rows = n_rows(stepper.index, self.every)
        self._t[rows - 1], self.u[rows - 1], self.v[rows - 1] = stepper.t, stepper.u, stepper.v
        return self._t[:rows], self.u[:rows], self.v[:rows]
