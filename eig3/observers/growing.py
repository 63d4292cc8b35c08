"""The saved states of a run whose number of steps is not known beforehand."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..kernels.protocol import SCALAR, Form
from ..memory import available_memory

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
    """Rows that are added in blocks."""

    def __init__(self) -> None:
        self.blocks: list[Rows] = []
        self._size = self._unchecked = 0

    def append(self, rows: Rows) -> None:
        """Add a copy of some rows.

        Raises
        ------
        MemoryError
            If there is no memory left to join the blocks at the end.
        """
        if not len(rows.t):
            return
        self.blocks.append(Rows(*(x.copy() for x in rows)))
        self._size += rows.nbytes
        self._unchecked += rows.nbytes
        if self._unchecked > _UNCHECKED:
            self._unchecked = 0
            if self._size > (free := available_memory()):
                raise MemoryError(
                    f"the history has {self._size:.3g} bytes and {free:.3g} are free; take a larger save_every, or "
                    "t_eval with the times that you need."
                )

    @staticmethod
    def join(blocks: Sequence[Rows]) -> Rows:
        """Return the rows of some blocks."""
        return Rows(*(np.concatenate(parts) for parts in zip(*blocks, strict=True)))
