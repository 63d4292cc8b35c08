"""The invariants and outputs of the members in the lanes of a block, which the kernel evaluates in every step."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..functions.guard import are_untouched
from ..functions.quantities import Quantity
from ..kernels.lanes import Lanes, Layout
from ..kernels.protocol import ADDRESS, COLUMN, HIGH, LOW, OUT, ROWS, WIDTH, WORK, Follow

_GUARD_ROWS = 4  # of NaN on each side of the values of a quantity
_NONE = np.empty((2, 0))


class Tracks:
    """The quantities of the members in the lanes of a block.

    Parameters
    ----------
    quantities : dict of str to (Quantity, Lanes)
        Each quantity, and its function compiled for lanes.
    layout : Layout
    project : int
        The address of the function that moves states to the constraints, or 0.

    Attributes
    ----------
    numbers : ndarray
        All that changes along the run.
    record : Follow
        What the kernel gets.
    start : dict of str to ndarray, shape (k, lanes)
        The values at the start.
    """

    def __init__(self, quantities: Mapping[str, tuple[Quantity, Lanes]], layout: Layout, project: int = 0) -> None:
        self._quantities, self._lanes = quantities, layout.lanes
        self._table = np.zeros((len(quantities), 6), dtype=np.int64)
        column, place = 0, _GUARD_ROWS * layout.lanes
        for row, (quantity, function) in zip(self._table, quantities.values(), strict=True):
            width = quantity.width * layout.lanes
            row[[ADDRESS, WIDTH, COLUMN, OUT, WORK]] = function.address, width, column, place, -1
            column, place = column + width, place + width + _GUARD_ROWS * layout.lanes
        self.numbers = np.full(place + 4 * column, np.nan)
        self._out, self._extremes = self.numbers[:place], self.numbers[place:].reshape(4, column)
        self._extremes[LOW], self._extremes[HIGH] = np.inf, -np.inf
        no_parts = _NONE.reshape(0, 2, 0)
        arrays = self._table, self._out, self._extremes, _NONE, no_parts, _NONE, np.empty(0)
        self.record = Follow(*arrays, project=project)

    def begin(self, t: float, u: np.ndarray, v: np.ndarray, p: np.ndarray) -> None:
        """Evaluate the quantities at the start, from the values of the kernel."""
        for k, (_, function) in enumerate(self._quantities.values()):
            function.call(t, u, v, p, self._values(k), *self._extremes[:, self._columns(k)])
        self.check()
        self.start = {name: self.latest(name).copy() for name in self._quantities}

    def save_in(self, rows: Mapping[str, np.ndarray]) -> None:
        """Let the kernel write the values in saved states to these arrays, of shape (states, k, lanes)."""
        for k, name in enumerate(self._quantities):
            self._table[k, ROWS] = rows[name].ctypes.data if name in rows else 0

    def check(self) -> None:
        """Raise a ValueError if a function has written beyond its values."""
        cells, end = _GUARD_ROWS * self._lanes, 0
        for k, (quantity, _) in enumerate(self._quantities.values()):
            begin, end = end, int(self._table[k, OUT] + self._table[k, WIDTH])
            if not (are_untouched(self._out[begin : begin + cells]) and are_untouched(self._out[end : end + cells])):
                raise quantity.written_beyond()

    def latest(self, name: Any) -> np.ndarray:
        """The values of a quantity in the latest state, shape (k, lanes)."""
        return self._values(list(self._quantities).index(name)).reshape(-1, self._lanes)

    def extremes(self, name: Any) -> np.ndarray:
        """The minimum and the maximum so far, and the kernel's times of them, shape (4, k, lanes)."""
        return self._extremes[:, self._columns(list(self._quantities).index(name))].reshape(4, -1, self._lanes)

    def _values(self, k: int) -> np.ndarray:
        begin = int(self._table[k, OUT])
        return self._out[begin : begin + int(self._table[k, WIDTH])]

    def _columns(self, k: int) -> slice:
        begin = int(self._table[k, COLUMN])
        return slice(begin, begin + int(self._table[k, WIDTH]))
