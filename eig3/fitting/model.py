"""The weighted residuals of a fit and their derivatives, as functions of the parameters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .data import Series
from .history import History
from .runs import Runs, history
from .stencils import differences, usual_steps

_PART = 2.0**-8  # the steps of differences do not fall below those of this part of a parameter's size


class Model:
    """The difference between a model and its data.

    Parameters
    ----------
    runs : Runs
    series : sequence of Series
    low, high : ndarray, shape (p,)
        Bounds, beyond which no run goes.
    sizes : ndarray, shape (p,)
        Sizes of the parameters.
    """

    def __init__(
        self, runs: Runs, series: Sequence[Series], low: np.ndarray, high: np.ndarray, sizes: np.ndarray
    ) -> None:
        self.runs, self.series, self.bounds, self.sizes = runs, series, (low, high), sizes
        self._times = np.unique(np.concatenate([each.t for each in series]))
        self._rows = [np.searchsorted(self._times, each.t) for each in series]
        self._values = np.concatenate([each.values for each in series])
        self._sigma = np.concatenate([each.sigma for each in series])
        self.size = float(np.linalg.norm(self._values / self._sigma)) or 1.0  # of all weighted values

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """Return (model - data) / sigma; infinite if the run fails, which SciPy answers by a shorter step."""
        members = self.runs(x[None])
        if not members.success[0]:
            return np.full(len(self._values), np.inf)
        return (self._quantities(history(members, self._times))[0] - self._values) / self._sigma

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """Return the derivatives of the residuals, shape (number of data, p)."""
        steps = usual_steps(np.maximum(np.abs(x), _PART * self.sizes))
        chosen = differences(x, steps, *self.bounds)
        members = self.runs(chosen.rows)
        self.runs.check(members, chosen.rows)
        derivatives = chosen.derivatives(history(members, self._times))
        return (self._quantities(derivatives) / self._sigma).T

    def check(self, x: np.ndarray) -> None:
        """Raise an error if the run with these values fails."""
        self.runs.check(self.runs(x[None]), x[None])

    def curves(self, x: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
        """Return the saved times of the run with these values, and each quantity there."""
        members = self.runs(x[None])
        self.runs.check(members, x[None])
        found = history(members, None)
        return np.array(members.t[0]), [each.of(found)[0] for each in self.series]

    def _quantities(self, values: History) -> np.ndarray:
        """Return the quantities at the times of their data, one series after the other, along the last axis."""
        pairs = zip(self.series, self._rows, strict=True)
        return np.concatenate([each.of(values)[:, rows] for each, rows in pairs], axis=1)
