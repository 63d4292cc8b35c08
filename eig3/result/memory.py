"""Checks that the arrays of a run fit in memory or on the disk, before anything runs.

Linux grants more memory than exists, and kills the process when it uses the memory. These checks raise an error
instead. The package psutil reports only the memory of the machine, not the limit of a container.
"""

import errno
import math
import os
import shutil
from pathlib import Path

import numpy as np

from ..methods import Method

_CACHE_LINE = 64  # size of a cache line, bytes
_OF_ERROR = 4  # histories of a run that its error needs: compared runs, errors of u and v, and temporary arrays
_VALUE = 56  # bytes for a value of a member: two arrays, and a Python number in the list for the table
_PROC, _CGROUPS = Path("/proc"), Path("/sys/fs/cgroup")
# The files of a control group with its limit and its usage, and the statistics entry of reclaimable memory.
_VERSION_1 = "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"
_VERSION_2 = "memory.max", "memory.current", "inactive_file"
NOT_WORTH_A_LOOK = 2**20  # bytes; reading the free memory takes longer than filling less than this


def n_rows(n_steps: int, every: int) -> int:
    """Return the number of saved states: the first, every `every`-th and the last."""
    return n_steps // every + 1 + (n_steps % every > 0)


def _check(needed: float, what: str, remedy: str) -> None:
    """Raise a MemoryError if so many bytes do not fit."""
    if not needed <= NOT_WORTH_A_LOOK and not needed <= (free := available_memory()):
        raise MemoryError(f"{what} {needed:.3g} bytes and {free:.3g} are free; {remedy}.")


def check_history(n_steps: int, every: int, n: int, n_outputs: int = 0) -> None:
    """Raise a MemoryError if the history of n degrees of freedom does not fit; it names a `save_every` that fits.

    `n_outputs` is the number of values of all outputs in a state.
    """
    row = 8 * (2 * n + 1 + n_outputs)  # u, v and t
    needed = row * n_rows(n_steps, every)
    if needed <= NOT_WORTH_A_LOOK or needed <= (free := available_memory()):
        return
    raise MemoryError(
        f"the history needs {needed:.3g} bytes and {free:.3g} are free; {_remedy(n_steps, free / row)} would fit."
    )


def check_error(*history: np.ndarray) -> None:
    """Raise a MemoryError if the errors of runs, whose histories are these arrays, do not fit."""
    needed = _OF_ERROR * sum(x.nbytes for x in history)
    _check(needed, "the estimated error needs", "save fewer states by save_every or t_eval")


def record_places(length: float, spacing: float, each: int) -> np.ndarray:
    """Return the places of the samples of a record: 0, spacing, 2 spacing, ... up to a length.

    Raises
    ------
    MemoryError
        If a record that needs `each` bytes for a sample during its construction does not fit.
    """
    _check(each * (length / spacing + 1), f"a record up to {length:g} needs", "take a shorter t_end")
    return np.arange(0.0, length + spacing / 2, spacing)


def check_disk(directory: Path, n_steps: int, every: int, n: int, n_outputs: int = 0) -> None:
    """Raise an OSError if the history does not fit on the disk of a directory; it names a `save_every` that fits."""
    row = 8 * (2 * n + 1 + n_outputs)
    needed = row * n_rows(n_steps, every)
    existing = next(path for path in (directory, *directory.absolute().parents) if path.exists())
    free = shutil.disk_usage(existing).free
    if needed > free:
        raise OSError(
            errno.ENOSPC,
            f"the history needs {needed:.3g} bytes and the disk of {directory} has {free:.3g} free; "
            f"{_remedy(n_steps, free / row)} would fit, or a directory on another disk",
        )


def _remedy(n_steps: int, rows: float) -> str:
    """Name a `save_every` with which a run saves at most this number of rows."""
    most = int(rows) - 2
    return f"save_every={math.ceil(n_steps / most)}" if most > 0 else "save_every=None and fewer degrees of freedom"


def check_members_history(m: int, rows: int, n: int, n_outputs: int = 0) -> None:
    """Raise a MemoryError if the histories of m members, with `rows` states each, do not fit."""
    _check(
        8 * m * rows * (2 * n + n_outputs),
        f"the histories of {m} members need",
        "take a larger save_every, or reduce=, a function that returns the values that you need from each part of the "
        "ensemble",
    )


def check_study(m: int, values: int) -> None:
    """Raise a ValueError if a study of m members, with this number of values each, does not fit."""
    needed = _VALUE * m * values
    if needed > NOT_WORTH_A_LOOK and needed > (free := available_memory()):
        raise ValueError(f"a study of {m:.3g} members needs {needed:.3g} bytes and {free:.3g} are free: take fewer.")


def check_workspace(method: Method, n: int) -> None:
    """Raise a MemoryError if the n x n matrix of an implicit method does not fit."""
    # There are two matrices: a stepper keeps a copy of its state, to restore it.
    needed = 16 * n * n if method.formulas.matrix else 0
    _check(
        needed, f"the {n} x {n} matrix of Newton's method needs", "CentralDifference(solver='fixed-point') needs none"
    )


def aligned(shape: tuple[int, ...]) -> np.ndarray:
    """Return an array of zeros, aligned to a cache line if its rows fill a cache line.

    A loop over data in the cache takes 1.5 times as long if its vectors cross cache lines.
    """
    if shape[-1] < _CACHE_LINE // 8:
        return np.zeros(shape)
    size = math.prod(shape)
    buffer = np.zeros(size + _CACHE_LINE // 8)
    start = -buffer.__array_interface__["data"][0] % _CACHE_LINE // 8
    return buffer[start : start + size].reshape(shape)


def available_memory() -> float:
    """Return the free memory of the machine or of the container, in bytes; infinity if it is unknown."""
    return min(_machine_memory(), _group_memory())


def _machine_memory() -> float:
    """Return the free memory of the machine."""
    try:
        with (_PROC / "meminfo").open() as lines:
            for line in lines:
                if line.startswith("MemAvailable:"):
                    return 1024.0 * int(line.split()[1])
    except OSError:
        pass
    try:
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, ValueError, OSError):
        return math.inf  # Windows grants only existing memory: NumPy raises the MemoryError


def _group_memory() -> float:
    """Return the memory that the control groups of the process, such as a container, still allow it to use."""
    try:
        lines = (_PROC / "self" / "cgroup").read_text().splitlines()
    except OSError:
        return math.inf
    free = math.inf
    for line in lines:
        _, controllers, path = line.split(":", 2)
        if controllers and "memory" not in controllers.split(","):
            continue
        root, names = (_CGROUPS / "memory", _VERSION_1) if controllers else (_CGROUPS, _VERSION_2)
        # A container may see its group as the root, while the path is the path on the host. Each group is limited by
        # the groups that contain it.
        inner = root / path.lstrip("/")
        for group in (inner, *inner.parents):
            if group.is_relative_to(root):
                free = min(free, _free_in_group(group, *names))
    return free


def _free_in_group(group: Path, limit: str, usage: str, reclaimable: str) -> float:
    """Return the free memory of a control group; infinity if it has no limit."""
    try:
        free = int((group / limit).read_text()) - int((group / usage).read_text())
        for line in (group / "memory.stat").read_text().splitlines():
            name, value = line.split()
            if name == reclaimable:  # cached files, which the system drops when it needs the memory
                free += int(value)
    except (OSError, ValueError):  # "max" means no limit
        return math.inf
    return float(max(0, free))
