"""The saved states of a run."""

from __future__ import annotations

import numpy as np

from ..memory import n_rows
from ..stepper import Cancel, Stepper
from .chunk import Chunk

# Values in an array of a chunk with every state: 512 kB, so that it stays in the second-level cache. With fewer,
# the steps of a large system would take no longer than the calls around them.
_SCRATCH_VALUES = 2**16


class History:
    """The first state, every `every`-th state and the last state of a run of `n_steps` steps.

    Parameters
    ----------
    n_steps, every : int
    stepper : Stepper
    t_end : float
        The time after the last step, from which t0 + n h may differ by round-off.
    width : int
        The number of values of a state in the largest array of the observers that need every state; 0 if none does. If
        it is not 0, the chunks contain every state.
    """

    def __init__(self, n_steps: int, every: int, stepper: Stepper, t_end: float, width: int) -> None:
        u, v = stepper.start
        rows = n_rows(n_steps, every)
        self.every = every
        self._n_steps, self._t_end = n_steps, t_end
        shape = rows, *np.shape(u)
        self.u, self.v = np.empty(shape), np.empty(shape)
        self.u[0], self.v[0] = u, v
        self._t = np.arange(rows, dtype=np.float64)  # made before the run, so that memory cannot run out later
        self._t *= every
        self._t *= stepper.h
        self._t += stepper.t0
        self._t[-1] = t_end
        self._chunk_every = 1 if width else every
        #: Largest number of steps in a chunk.
        self.most = min(n_steps, max(1, _SCRATCH_VALUES // width)) if width else n_steps
        if self._chunk_every < every:
            shape = self.most, *np.shape(u)
            self._counted, self._times = np.arange(1.0, self.most + 1), np.empty(self.most)
            self._u, self._v = np.empty(shape), np.empty(shape)

    def advance(self, stepper: Stepper, count: int, cancel: Cancel) -> Chunk:
        """Take `count` steps, or fewer if a solve fails or `cancel` is set, and return them as a chunk."""
        first, every = stepper.index, self._chunk_every
        saved = slice(None)
        if every == self.every:
            rows = slice(first // every + 1, (first + count) // every + 1)
            t, u, v = self._t[rows], self.u[rows], self.v[rows]
        else:
            t, u, v = self._times_after(stepper, count), self._u[:count], self._v[:count]
            saved = slice(self.every - 1 - first % self.every, None, self.every)
        stepper.advance(count, every, u, v, cancel)
        chunk = Chunk(first, every, t, u, v, saved, stepper)
        if not (stepper.is_over and every == 1):
            return chunk.until(stepper)
        rows = stepper.index - first  # the state at the event that ended the run follows them
        t[rows], u[rows], v[rows] = stepper.t, stepper.u, stepper.v
        return chunk._replace(t=t[: rows + 1], u=u[: rows + 1], v=v[: rows + 1])

    def _times_after(self, stepper: Stepper, count: int) -> np.ndarray:
        """Return the times after each of the next steps."""
        t = self._times[:count]
        np.add(self._counted[:count], stepper.index, out=t)
        t *= stepper.h
        t += stepper.t0
        if stepper.index + count == self._n_steps:
            t[-1] = self._t_end
        return t

    def see(self, chunk: Chunk) -> None:
        """Save states of a chunk that contains every state."""
        if chunk.every == self.every:
            return  # the rows of the chunk are rows of the history
        u, v = chunk.u[chunk.saved], chunk.v[chunk.saved]
        begin = chunk.first // self.every + 1
        self.u[begin : begin + len(u)], self.v[begin : begin + len(v)] = u, v

    def close(self, stepper: Stepper) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return t, u and v of the saved states. The last one is the state of `stepper`."""
        rows = n_rows(stepper.index + stepper.is_over, self.every)
        self._t[rows - 1] = self._t_end if stepper.index == self._n_steps else stepper.t
        self.u[rows - 1], self.v[rows - 1] = stepper.u, stepper.v
        return self._t[:rows], self.u[:rows], self.v[:rows]
