"""Outputs: compiled functions of the state, with their values at the saved states and their extremes over all steps."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from typing import Any

import numpy as np

from ..functions.extremes import Extremes
from ..functions.quantities import Quantity, as_extremes
from ..stepping.stepper import Stepper
from .chunk import Chunk


class Output:
    """An output along a run.

    Parameters
    ----------
    name : str
    quantity : Quantity
    stepper : Stepper
        The stepper at the start of the run.
    values : ndarray, shape (rows, ...)
        For the values at the states that the run saves.
    """

    def __init__(self, name: str, quantity: Quantity, stepper: Stepper, values: np.ndarray) -> None:
        self.name, self._quantity, self._params = name, quantity, stepper.params
        self._extremes = quantity.no_extremes()
        self._values = values
        self._latest = quantity.at_start(stepper.t0, *stepper.start, stepper.params, self._extremes)
        self._values[0] = self._latest
        self._saved, self._seen = 1, 0  # the number of values that are saved, and the step index of the latest

    def see(self, chunk: Chunk) -> None:
        """Evaluate the output at every state of a chunk."""
        if len(chunk.t):
            values = self._quantity.evaluate(chunk.t, chunk.u, chunk.v, self._params, self._extremes)
            saved = values[chunk.saved]
            self._values[self._saved : self._saved + len(saved)] = saved
            self._saved += len(saved)
            self._latest = values[-1].copy()
        self._seen = chunk.stepper.index

    def widen(self, t: np.ndarray, u: np.ndarray, v: np.ndarray) -> None:
        """Widen the extremes by states between two steps."""
        self._quantity.evaluate(t, u, v, self._params, self._extremes)

    def extended(self, values: np.ndarray, earlier: np.ndarray) -> Output:
        """Return an independent output for a longer run, which begins with the `earlier` of its values."""
        other = copy(self)
        other._quantity, other._extremes = self._quantity.fork(), self._extremes.copy()
        other._values, other._saved = values, len(earlier)
        values[: len(earlier)] = earlier
        return other

    def kept(self) -> dict[str, Any]:
        """Return what this output needs to go on, besides its values, in numbers and arrays."""
        return {"extremes": self._extremes.copy(), "latest": self._latest, "seen": self._seen}

    def restore(self, kept: Mapping[str, Any]) -> None:
        """Become the output that has returned `kept`."""
        np.copyto(self._extremes, kept["extremes"])
        self._latest, self._seen = np.array(kept["latest"]).reshape(self._quantity.shape), int(kept["seen"])

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of a value."""
        return self._quantity.shape

    @property
    def width(self) -> int:
        """Number of values."""
        return self._quantity.width

    @property
    def extremes(self) -> Extremes:
        """The extremes over the steps so far."""
        return as_extremes(self._extremes, self._quantity.shape)

    def at(self, t: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the values in other states."""
        return self._quantity.evaluate(t, u, v, self._params, self._quantity.no_extremes()).copy()

    def close(self, index: int, rows: int) -> None:
        """Complete the values at the saved states of a run that ends at a step index.

        They are NaN at states at which the output was not evaluated, because it raised an exception.
        """
        values = self._values[:rows]
        values[self._saved :] = np.nan
        if self._seen == index:
            values[-1] = self._latest
