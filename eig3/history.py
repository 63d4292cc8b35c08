"""The rows a run keeps, and the refusal of more rows than memory holds."""

import math
import os
from typing import Any

import numpy as np

from .stepper import Stepper


class History:
    """Every `every`-th state of a run of `n_steps`, with the first and the last.

    Raises
    ------
    MemoryError
        When the history would not fit in memory: with the bytes it needs and the save_every that would fit.
    """

    def __init__(self, n_steps: int, every: int, u0: Any, v0: Any) -> None:
        rows = n_rows(n_steps, every)
        check_memory(n_steps, every, np.size(u0))
        shape = (rows, *np.shape(u0))
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


def n_rows(n_steps: int, every: int) -> int:
    """States kept: the first, every `every`-th and the last."""
    return n_steps // every + 1 + (n_steps % every > 0)


def check_memory(n_steps: int, every: int, n: int) -> None:
    """Refuse a history that would not fit in what memory is free, as `History` says."""
    row = 8 * (2 * n + 1)  # u, v and t
    needed, free = row * n_rows(n_steps, every), available_memory()
    if needed <= free:
        return
    most = int(free // row) - 2
    remedy = f"save_every={math.ceil(n_steps / most)}" if most > 0 else "save_every=None and fewer degrees of freedom"
    raise MemoryError(
        f"the history needs {needed:.3g} bytes and {free:.3g} are free; {remedy} would fit."
    )


def available_memory() -> float:
    """Bytes of memory free for use; infinite where the system does not tell."""
    try:
        with open("/proc/meminfo") as lines:
            for line in lines:
                if line.startswith("MemAvailable:"):
                    return 1024.0 * int(line.split()[1])
    except OSError:
        pass
    try:
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, ValueError, OSError):
        return math.inf  # Windows does not overcommit: there NumPy raises the MemoryError
