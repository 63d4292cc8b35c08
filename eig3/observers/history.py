"""The rows a run keeps."""

import numpy as np

from ..memory import n_rows
from ..stepper import Stepper


class History:
    """Every `every`-th state of a run of `n_steps`, with the first and the last."""

    def __init__(self, n_steps: int, every: int, stepper: Stepper) -> None:
        u, v = stepper.u, stepper.v
        rows = n_rows(n_steps, every)
        self.every = every
        self.u, self.v = (np.empty((rows, *np.shape(u))) for _ in range(2))
        self.u[0], self.v[0] = u, v
        self._t = np.arange(rows, dtype=np.float64)  # made here, in place, so that memory runs out before the run
        self._t *= every
        self._t[-1] = n_steps
        self._t *= stepper.h
        self._t += stepper.t0

    def window(self, first: int, count: int) -> tuple[np.ndarray, np.ndarray]:
        """The rows that the `count` steps from step index `first` write."""
        rows = slice(first // self.every + 1, (first + count) // self.every + 1)
        return self.u[rows], self.v[rows]

    def close(self, stepper: Stepper) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """t, u and v of the states kept, up to and with the one where `stepper` stands."""
        rows = n_rows(stepper.index, self.every)
        self._t[rows - 1], self.u[rows - 1], self.v[rows - 1] = stepper.t, stepper.u, stepper.v
        return self._t[:rows], self.u[:rows], self.v[:rows]
