"""The rows a run keeps."""

from typing import Any

import numpy as np

from .memory import check_history, n_rows
from .stepper import Stepper


class History:
    """Every `every`-th state of a run of `n_steps`, with the first and the last.

    Raises
    ------
    MemoryError
        When the history would not fit in memory: with the bytes it needs and the save_every that would fit.
    """

    def __init__(self, n_steps: int, every: int, u0: Any, v0: Any) -> None:
        check_history(n_steps, every, np.size(u0))
        shape = (n_rows(n_steps, every), *np.shape(u0))
        self.every = every
        self.u, self.v = np.empty(shape), np.empty(shape)
        self.u[0], self.v[0] = u0, v0

    def window(self, first: int, count: int) -> tuple[np.ndarray, np.ndarray]:
        """The rows that the `count` steps from step index `first` write."""
        rows = slice(first // self.every + 1, (first + count) // self.every + 1)
        return self.u[rows], self.v[rows]

    def close(self, stepper: Stepper) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """t, u and v of the states kept, up to and with the one where `stepper` stands."""
        steps = np.arange(0, stepper.index + 1, self.every)
        if steps[-1] != stepper.index:
            steps = np.append(steps, stepper.index)
            self.u[len(steps) - 1], self.v[len(steps) - 1] = stepper.u, stepper.v
        return stepper.t0 + steps * stepper.h, self.u[: len(steps)], self.v[: len(steps)]
