"""The saved states of a run: rows of arrays in memory or in files, with room for more."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..result.columns import ROWS
from ..result.mapped import MappedRows, output_files
from ..result.memory import NOT_WORTH_A_LOOK, available_memory
from ..stepping.march import Rows

FIRST_ROWS = 64  # rows of the first block if the number of rows is not known; each further block doubles them
# The largest size of a block. A smaller block could come from the heap of the C library, which does not return the
# memory of a freed block to the system.
_BLOCK_BYTES = 2**27
_NONE = np.empty(0)


class SavedRows:
    """The saved states of a run, with the values of its outputs.

    The kernel writes rows of the present block. In memory, a full block is stored, and `whole` joins the blocks: it
    needs the memory of only one more block, because it frees each block after copying it. In files, there is one
    growing block.

    `state` is the shape of u and v in a row, and `outputs` are the shapes of the values of outputs, by name. There is
    space for `rows` rows at first, in memory or in files of a directory. `has_times` and `has_steps` say whether there
    are rows for times, and for the lengths of steps.

    Attributes
    ----------
    arrays : dict of str to ndarray
        The present block.
    row : int
        The next row of the present block to write.
    """

    def __init__(
        self,
        state: tuple[int, ...],
        outputs: Mapping[str, tuple[int, ...]],
        rows: int,
        directory: Path | None = None,
        *,
        has_times: bool,
        has_steps: bool,
    ) -> None:
        shapes: dict[str, tuple[int, ...]] = {"u": state, "v": state}
        if has_times or directory:
            shapes["t"] = ()
        if has_steps:
            shapes["steps"] = ()
        self._output_files = output_files(outputs) if outputs else {}
        for name, file in self._output_files.items():
            shapes[file] = outputs[name]
        self._shapes, self.row = shapes, 0
        self._full: list[tuple[dict[str, np.ndarray], int]] = []
        self._put_aside = 0  # rows in the blocks that are full
        self.files = None if directory is None else MappedRows(directory, shapes, rows)
        self.arrays = self.files.arrays if self.files else self._block(rows)

    def _block(self, rows: int) -> dict[str, np.ndarray]:
        block = {}
        for name, shape in self._shapes.items():
            block[name] = np.empty((rows, *shape))
        return block

    @property
    def count(self) -> int:
        """Number of rows that are written."""
        return self._put_aside + self.row

    def rows(self, n: int) -> Rows:
        """The present block as the kernel takes it: u and v have rows of n values."""
        arrays = self.arrays
        u, v = arrays["u"].reshape(-1, n), arrays["v"].reshape(-1, n)
        return Rows(arrays.get("t", _NONE), arrays.get("steps", _NONE), u, v)

    @property
    def outputs(self) -> dict[str, np.ndarray]:
        """The values of the outputs in the present block."""
        return {name: self.arrays[file] for name, file in self._output_files.items()}

    def write(self, values: Mapping[str, Any], outputs: Mapping[str, Any]) -> None:
        """Write the next row: u, v and, where there are rows for them, t and steps; and outputs by their names."""
        if self.row == len(self.arrays["u"]):
            self.make_room()
        for name, value in self._by_file(values, outputs):
            self.arrays[name][self.row] = value
        self.row += 1

    def _by_file(self, values: Mapping[str, Any], outputs: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
        """Yield the name of each array of the block, and its values. An output may have the name of a row."""
        for name, value in values.items():
            if name in self.arrays:
                yield name, value
        for name, value in outputs.items():
            yield self._output_files[name], value

    def last_row(self) -> dict[str, np.ndarray]:
        """The last row that is written."""
        arrays, row = (self.arrays, self.row) if self.row else self._full[-1]
        return {name: array[row - 1] for name, array in arrays.items()}

    def make_room(self) -> None:
        """Extend the present block, or begin another block.

        Raises
        ------
        MemoryError, OSError
            If there is no space left in memory or on the disk. The rows up to now are kept.
        """
        if self.files:
            self.files.count = self.row
            self.files.grow()
            self.arrays = self.files.arrays
            return
        row_bytes = 8 * sum(map(math.prod, self._shapes.values()))
        rows = max(4, min(max(FIRST_ROWS, self.count), _BLOCK_BYTES // row_bytes))
        if rows * row_bytes > NOT_WORTH_A_LOOK:
            self._check(rows * row_bytes, row_bytes)
        self._full.append((self.arrays, self.row))
        self._put_aside += self.row
        self.arrays, self.row = self._block(rows), 0

    def _check(self, size: int, row_bytes: int) -> None:
        """Raise a MemoryError if there is no memory for so many bytes more, and for the end of the run."""
        joining = 2 * min(size, _BLOCK_BYTES)  # the copied block, and blocks too small to be returned to the system
        if size + joining > (free := available_memory()):
            raise MemoryError(
                f"the history has {self.count * row_bytes:.3g} bytes and {free:.3g} are free; take a larger "
                "save_every, t_eval with the times that you need, or save_to."
            )

    def take(self, earlier: Mapping[str, np.ndarray], outputs: Mapping[str, np.ndarray], count: int) -> None:
        """Copy the first rows of an earlier part of the run as the first rows."""
        if len(self.arrays["u"]) < count:
            if self.files:
                self.files.reserve(count + FIRST_ROWS)
                self.arrays = self.files.arrays
            else:
                self.arrays = self._block(count + FIRST_ROWS)
        for name, array in self._by_file(earlier, outputs):
            self.arrays[name][:count] = array[:count]
        self.row = count

    def whole(self) -> dict[str, np.ndarray]:
        """Return all rows: u, v and, where there are such rows, t and steps."""
        if self._full:
            self._join()
        return {name: self.arrays[name][: self.row] for name in ROWS if name in self.arrays}

    def whole_outputs(self) -> dict[str, np.ndarray]:
        """Return the values of the outputs in all rows."""
        return {name: values[: self.row] for name, values in self.outputs.items()}

    def _join(self) -> None:
        """Join all blocks. Each block is freed as soon as it is copied, because two copies may not fit in memory."""
        self._full.append((self.arrays, self.row))
        joined, begin = self._block(self.count), 0
        self.arrays = joined
        while self._full:
            block, used = self._full.pop(0)
            for name, array in joined.items():
                array[begin : begin + used] = block[name][:used]
            begin += used
            del block
        self.row, self._put_aside = begin, 0

    def close(self) -> None:
        """Cut files after their last row. After this they are read-only."""
        if self.files:
            self.files.count = self.row
            self.files.close()
            self.arrays = self.files.arrays

    def remove(self) -> None:
        """Remove the files of the history, if it has any."""
        if self.files:
            self.files.remove()
