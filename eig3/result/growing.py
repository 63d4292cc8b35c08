"""The saved states of a run whose number of steps is not known beforehand."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..kernels.protocol import SCALAR, Form
from .mapped import MappedRows, output_files
from .memory import NOT_WORTH_A_LOOK, available_memory

_FIRST_ROWS = 64  # rows of the first block; each further block doubles their number
# The largest size of a block. A smaller one could come from a heap of the C library, which does not give the memory of
# a freed block back to the system.
_BLOCK_BYTES = 2**27


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
        return Rows(self.t[which], self.h[which], self.u[which], self.v[which])

    def in_form(self, form: Form) -> tuple[np.ndarray, np.ndarray]:
        """Return u and v, of the shape (rows,) for one degree of freedom."""
        return (self.u[:, 0], self.v[:, 0]) if form is SCALAR else (self.u, self.v)


class GrowingHistory:
    """The saved states of a run whose number of steps is not known beforehand.

    In memory they are in blocks, from which `rows` makes whole arrays one block after the other: it needs the memory of
    one more block only, because it gives each block back before it takes the next.

    Parameters
    ----------
    form : Form
    n : int
        Number of degrees of freedom.
    outputs : dict of str to tuple of int
        The shapes of the values of outputs in a state, by name. In memory they are computed when the run ends.
    directory : Path, optional
        Save the states, and the values of the outputs, in files of this directory.
    """

    def __init__(
        self, form: Form, n: int, outputs: Mapping[str, tuple[int, ...]], directory: Path | None = None
    ) -> None:
        self._form, self._n, self._count = form, n, 0
        self._row_bytes, self._output_bytes = 8 * (2 + 2 * n), 8 * sum(map(math.prod, outputs.values()))
        self._blocks: list[Rows] = []
        self._free = 0  # rows of the last block that are not used
        shape: tuple[int, ...] = () if form is SCALAR else (n,)
        shapes: dict[str, tuple[int, ...]] = {"t": (), "steps": (), "u": shape, "v": shape}
        self._output_files = {} if directory is None else output_files(outputs)
        shapes |= {file: outputs[name] for name, file in self._output_files.items()}
        self._n_written = 0  # rows in files with the values of the outputs
        self._files = None if directory is None else MappedRows(directory, shapes)
        self._is_full = False

    def append(self, rows: Rows) -> None:
        """Add a copy of some rows.

        Raises
        ------
        MemoryError, OSError
            If there is no space left in memory or on the disk. The rows for which there is space are kept.
        """
        if not len(rows.t) or self._is_full:
            return
        if self._files:
            u, v = rows.in_form(self._form)
            try:
                self._files.append(t=rows.t, steps=rows.h, u=u, v=v)
            except OSError:
                self._is_full = True  # the rows that are left out would be a gap before later ones
                raise
            return
        size = len(rows.t) * self._row_bytes
        if size > _BLOCK_BYTES:  # those of a run that goes on
            self._check(size)
        block_bytes = 0
        while len(rows.t):
            if not self._free:
                block_bytes = self._add_block()
            block = self._blocks[-1].at(slice(-self._free, None))
            for target, source in zip(block, rows, strict=True):
                target[: len(source)] = source[: len(target)]
            count = min(len(rows.t), self._free)
            self._count, self._free = self._count + count, self._free - count
            rows = rows.at(slice(count, None))
        if block_bytes > NOT_WORTH_A_LOOK:
            self._check(block_bytes)  # now, so that these rows are kept

    def _add_block(self) -> int:
        """Add a block, and return its size in bytes."""
        rows = max(1, min(max(_FIRST_ROWS, self._count), _BLOCK_BYTES // self._row_bytes))
        self._blocks.append(Rows.empty(rows, self._n))
        self._free = rows
        return rows * self._row_bytes

    def _check(self, size: int) -> None:
        """Raise a MemoryError if there is no memory for so many bytes more, and for the end of the run."""
        joining = 2 * min(size, _BLOCK_BYTES)  # the block that is copied, and those that are too small to be given back
        if size + joining + self._count * self._output_bytes > (free := available_memory()):
            raise MemoryError(
                f"the history has {self._count * self._row_bytes:.3g} bytes and {free:.3g} are free; take a larger "
                "save_every, t_eval with the times that you need, or save_to."
            )

    def write_outputs(self, functions: Mapping[str, Callable[..., np.ndarray]]) -> None:
        """Write the values of outputs in files for the rows that have none: each is a function of t, u and v."""
        if not self._output_files:
            return
        new = slice(self._n_written, self.count)
        rows = self.rows().at(new)
        values = {name: function(rows.t, *rows.in_form(self._form)) for name, function in functions.items()}
        for name, array in self.outputs.items():
            array[new] = values[name]
        self._n_written = self.count

    @property
    def outputs(self) -> dict[str, np.ndarray]:
        """The values of the outputs in files; empty in memory."""
        if self._files is None:
            return {}
        return {name: self._files.arrays[file][: self.count] for name, file in self._output_files.items()}

    @property
    def count(self) -> int:
        """Number of rows."""
        return self._files.count if self._files else self._count

    @property
    def last(self) -> Rows:
        """The last row."""
        if self._files:
            return self.rows().at(slice(-1, None))
        used = len(self._blocks[-1].t) - self._free
        return self._blocks[-1].at(slice(used - 1, used))

    def rows(self) -> Rows:
        """Return all rows up to now."""
        if self._files:
            arrays, count = self._files.arrays, self._files.count
            u, v = (arrays[name][:count].reshape(count, -1) for name in "uv")
            return Rows(arrays["t"][:count], arrays["steps"][:count], u, v)
        if len(self._blocks) > 1:
            self._join()
        return self._blocks[0].at(slice(self._count))

    def _join(self) -> None:
        """Make one block of all. Each block is freed as soon as it is copied, because both may not fit in memory."""
        joined, begin = Rows.empty(self._count, self._n), 0
        while self._blocks:
            block = self._blocks.pop(0)
            for target, source in zip(joined, block, strict=True):
                part = target[begin : begin + len(source)]
                part[:] = source[: len(part)]
            begin += len(block.t)
            del block, source
        self._blocks, self._free = [joined], 0

    def close(self) -> None:
        """Cut files after their last row. They can only be read from here on."""
        if self._files:
            self._files.close()

    def remove(self) -> None:
        """Remove the files of the history, if it has any."""
        if self._files:
            self._files.remove()
