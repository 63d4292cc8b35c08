"""Refuse what would not fit in memory before anything runs; Linux would promise it and then kill the process."""

import math
import os
from pathlib import Path

import numpy as np

from .methods import Method

_CACHE_LINE = 64  # bytes
_NOT_WORTH_A_LOOK = 2**20  # bytes, below which asking the system takes longer than using them


def n_rows(n_steps: int, every: int) -> int:
    """States kept: the first, every `every`-th and the last."""
    return n_steps // every + 1 + (n_steps % every > 0)


def check_history(n_steps: int, every: int, n: int) -> None:
    """Raise a MemoryError, naming the save_every that would fit, where the history of n degrees of freedom does not."""
    row = 8 * (2 * n + 1)  # u, v and t
    needed = row * n_rows(n_steps, every)
    if needed <= _NOT_WORTH_A_LOOK or needed <= (free := available_memory()):
        return
    most = int(free // row) - 2
    remedy = f"save_every={math.ceil(n_steps / most)}" if most > 0 else "save_every=None and fewer degrees of freedom"
    raise MemoryError(f"the history needs {needed:.3g} bytes and {free:.3g} are free; {remedy} would fit.")


def check_workspace(method: Method, n: int) -> None:
    """Raise a MemoryError where the matrix of an implicit method does not fit."""
    # The matrix, and its copy in the state that a stepper can go back to.
    needed = 16 * n * n if method.formulas.matrix else 0
    if needed > _NOT_WORTH_A_LOOK and needed > (free := available_memory()):
        raise MemoryError(
            f"the {n} x {n} matrix of Newton's method needs {needed:.3g} bytes and {free:.3g} are free; "
            "CentralDifference(solver='fixed-point') needs none."
        )


def aligned(shape: tuple[int, ...]) -> np.ndarray:
    """Zeros that start on a cache line; a loop in cache takes half as long again where its vectors straddle two."""
    size = math.prod(shape)
    buffer = np.zeros(size + _CACHE_LINE // 8)
    start = -buffer.ctypes.data % _CACHE_LINE // 8
    return buffer[start : start + size].reshape(shape)


def available_memory() -> float:
    """Bytes of memory free for use; infinite where the system does not tell."""
    try:
        with Path("/proc/meminfo").open() as lines:
            for line in lines:
                if line.startswith("MemAvailable:"):
                    return 1024.0 * int(line.split()[1])
    except OSError:
        pass
    try:
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, ValueError, OSError):
        return math.inf  # Windows does not overcommit: there NumPy raises the MemoryError
