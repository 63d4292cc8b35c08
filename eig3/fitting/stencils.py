"""Difference formulas for derivatives of the order 4, and for estimates of their errors."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .series import History

_RELATIVE = 2.0**-12  # step of a difference, relative to the value: a run of 100 periods is smooth over it
_UNIT = float(np.finfo(np.float64).eps)


# Central differences D(d) and D(2 d) from values at these multiples of d: by Richardson extrapolation,
# (4 D(d) - D(2 d)) / 3 has the order 4. The weights apply to differences from the value in the middle.
_OFFSETS = -2, -1, 1, 2
_WEIGHTS = 1 / 12, -8 / 12, 8 / 12, -1 / 12
_SPREAD = 1 / 4, -1 / 2, 1 / 2, -1 / 4  # of the difference between D(d) and D(2 d)


class Differences(NamedTuple):
    """The members of an ensemble whose differences give the derivatives with respect to p parameters.

    `rows`, shape (1 + 4 p, p), are the values of the parameters in each member. The first member has the unchanged
    values.
    """

    rows: np.ndarray
    steps: np.ndarray

    def derivatives(self, members: History) -> History:
        """Return the derivatives, with a first axis of parameters, from the histories of all members."""
        return members.map(lambda x: self._weighted(x, _WEIGHTS))

    def errors(self, members: History, n_steps: int) -> History:
        """Return estimates of the errors of the derivatives.

        An estimate is the sum of the difference between two derivatives of the order 2, which exceeds the error of the
        derivative of the order 4, and of the round-off of sums over `n_steps` steps, which grows as a random walk. At
        each time it is the largest value so far.
        """
        return members.map(lambda x: self._errors(x, n_steps))

    def _errors(self, values: np.ndarray, n_steps: int) -> np.ndarray:
        spread = np.abs(self._weighted(values, _SPREAD))
        round_off = _UNIT * math.sqrt(n_steps) * np.abs(values[0]) / self._steps_beside(values)
        return np.maximum.accumulate(spread + round_off, axis=1)

    def _weighted(self, values: np.ndarray, weights: tuple[float, ...]) -> np.ndarray:
        beside = (values[1:] - values[0]).reshape(len(self.steps), 4, *values.shape[1:])
        return np.einsum("j,ij...->i...", np.array(weights), beside) / self._steps_beside(values)

    def _steps_beside(self, values: np.ndarray) -> np.ndarray:
        return self.steps.reshape(-1, *[1] * (values.ndim - 1))


def differences(values: np.ndarray, steps: np.ndarray) -> Differences:
    """Return the members for the derivatives at some values; both arrays have the shape (p,)."""
    steps = 2.0 ** np.floor(np.log2(steps))  # makes the sum of a value and a step exact
    rows = [values]
    for i, step in enumerate(steps):
        for offset in _OFFSETS:
            rows.append(values.copy())
            rows[-1][i] += offset * step
    return Differences(np.array(rows), steps)


def usual_steps(sizes: np.ndarray) -> np.ndarray:
    """Return the steps of the differences for values of these sizes."""
    return _RELATIVE * sizes
