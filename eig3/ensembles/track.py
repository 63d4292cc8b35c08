"""A quantity along the run of a block: an invariant or an output of the members in its lanes."""

from __future__ import annotations

import numpy as np

from ..functions.guard import guarded
from ..functions.quantities import Quantity
from ..kernels.lanes import Lanes
from ..stepping.stepper import NEVER
from .lane_state import LaneState

_GUARD_ROWS = 4  # of NaN on each side of the values


class Track:
    """A quantity of the members in the lanes of a block.

    Parameters
    ----------
    quantity : Quantity
    function : Lanes
        It, compiled for lanes.
    every : int or None
        The values are wanted in the states whose step index is a multiple of this; None if only the extremes are.
    state : LaneState
        The members at the start.

    Attributes
    ----------
    start, latest : ndarray, shape (k, lanes)
        The values at the start, and in the latest step; k is 1 for a quantity with one value.
    extremes : ndarray, shape (4, k, lanes)
        The minimum, the maximum, and the step indices at which they first occurred.
    """

    def __init__(self, quantity: Quantity, function: Lanes, every: int | None, state: LaneState) -> None:
        self._quantity, self._function, self._every = quantity, function, every
        shape = quantity.width, state.layout.lanes
        self._out = guarded(np.full(shape[0] * shape[1], np.nan), count=_GUARD_ROWS * state.layout.lanes)
        self._values = np.empty((0, self._out.size))
        self.extremes = np.full((4, *shape), np.nan)
        self.extremes[0], self.extremes[1] = np.inf, -np.inf
        self.see(state, 0, *(x[None].copy() for x in state.values))
        self.start = self.latest

    def see(self, state: LaneState, first: int, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Evaluate the quantity in the states from step index `first` on.

        Returns
        -------
        ndarray, shape (states, k, lanes)
            The values that are wanted. The next call overwrites them.

        Raises
        ------
        ValueError
            If the function writes beyond its k values.
        """
        every = self._every or NEVER
        states = (first + len(u) - 1) // every - (first - 1) // every if self._every else 0
        if len(self._values) < states:
            self._values = np.empty((states, self._out.size))
        values, extremes = self._values[:states], self.extremes.copy()
        state.evaluate(self._function, first, u, v, every, self._out, values, *extremes.reshape(4, -1))
        self._quantity.check_within(self._out)
        shape = self.extremes.shape[1:]
        self.latest, self.extremes = self._out.reshape(shape).copy(), extremes
        return values.reshape(states, *shape)
