"""The saved states of a run whose number of steps is not known beforehand."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from .kernels.protocol import SCALAR, Form
from .mapped import MappedRows
from .memory import available_memory

_UNCHECKED = 2**26  # bytes by which the history grows before the free memory is looked at again


class Rows(NamedTuple):
    """Saved states: times, the steps that led there, and u and v of shape (rows, n)."""

    t: np.ndarray
    h: np.ndarray
    u: np.ndarray
    v: np.ndarray

    @classmethod
    def empty(cls, count: int, n: int) -> Rows:
        return cls(np.empty(count), np.empty(count), np.empty((count, n)), np.empty((count, n)))

    def at(self, which: slice | np.ndarray) -> Rows:
        """Return some of the rows."""
        return Rows(*(x[which] for x in self))

    def in_form(self, form: Form) -> tuple[np.ndarray, np.ndarray]:
        """Return u and v, of the shape (rows,) for one degree of freedom."""
        return (self.u[:, 0], self.v[:, 0]) if form is SCALAR else (self.u, self.v)

    @property
    def nbytes(self) -> int:
        return sum(x.nbytes for x in self)


class GrowingHistory:
    """The saved states of a run whose number of steps is not known beforehand.

    Parameters
    ----------
    form : Form
    n : int
        Number of degrees of freedom.
    directory : Path, optional
        Save the states in files of this directory.
    """

    def __init__(self, form: Form, n: int, directory: Path | None = None) -> None:
        self._form, self._blocks = form, [Rows.empty(0, n)]
        self._size = self._unchecked = 0
        shape = () if form is SCALAR else (n,)
        shapes = {"t": (), "steps": (), "u": shape, "v": shape}
        self._files = None if directory is None else MappedRows(directory, shapes)
        self._joined: Rows | None = None

    def append(self, rows: Rows) -> None:
        """Add a copy of some rows.

        Raises
        ------
        MemoryError, OSError
            If there is no space left in memory or on the disk. The rows up to now stay as they are.
        """
        if not len(rows.t):
            return
        if self._files:
            u, v = rows.in_form(self._form)
            self._files.append(t=rows.t, steps=rows.h, u=u, v=v)
            return
        self._blocks.append(Rows(*(x.copy() for x in rows)))
        self._size += rows.nbytes
        self._unchecked += rows.nbytes
        if self._unchecked > _UNCHECKED:
            self._unchecked = 0
            if self._size > (free := available_memory()):  # the blocks are joined at the end
                raise MemoryError(
                    f"the history has {self._size:.3g} bytes and {free:.3g} are free; take a larger save_every, t_eval "
                    "with the times that you need, or save_to."
                )

    def commit(self, **counts: float) -> None:
        """Say that the rows up to now are complete, and what the run has counted up to there."""
        if self._files:
            self._files.commit(self._files.count, **counts)

    @property
    def count(self) -> int:
        """Number of rows."""
        return self._files.count if self._files else sum(len(block.t) for block in self._blocks)

    def rows(self) -> Rows:
        """Return all rows up to now."""
        if self._files:
            arrays, count = self._files.arrays, self._files.count
            u, v = (arrays[name][:count].reshape(count, -1) for name in "uv")
            return Rows(arrays["t"][:count], arrays["steps"][:count], u, v)
        self._blocks = [Rows(*(np.concatenate(parts) for parts in zip(*self._blocks, strict=True)))]
        return self._blocks[0]

    def close(self) -> None:
        """Cut files after their last row. They can only be read from here on."""
        if self._files:
            self._files.close()

    def remove(self) -> None:
        """Remove the files of the history, if it has any."""
        if self._files:
            self._files.remove()
