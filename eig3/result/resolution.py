"""Error estimates for the interpolation between saved states."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np

from .interpolation import Knots

_POINTS = np.array([0.2, 0.5, 0.8])  # of an interval, where the polynomial is compared
_BUMP = 12.0  # the curvature of the error of a polynomial is about this, times the error, over the length squared
_NUDGE = 1e-4  # the displacement for measuring a stiffness, relative to the motion
_STATES = 1000  # least number of saved states for the range of the motion
_SMALL = 1e-3  # least scale of the errors, relative to the largest motion of all degrees of freedom
_ROUND_OFF = 1e-9  # a smaller motion relative to the displacement counts as rest
_CUBIC = 1 / 12  # ratio of the errors of a quintic and a cubic polynomial, with about two states a period
_CHUNK_VALUES = 2**20  # values in the states that are compared at once

#: A function that evaluates f at rows of t, u and v.
Evaluate = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


class Resolution:
    """The errors of the polynomials between saved states, estimated by the right-hand side.

    At three points of an interval of the length H, the acceleration of the polynomial P is compared with f. The
    difference d drives the error e of P: e'' = f'(P) e + d. With e'' of the size 12 e / H^2, and a stiffness k from one
    more evaluation of f near P, the error is about ``|d| / (12 / H^2 + k)``. This is the error of P for few states in a
    period, within a factor of four, and |d| / k for stiff directions, in which f amplifies a small error.

    An interval between two consecutive steps has no interpolation error beyond the error of the run, and is skipped.
    Without f, the error is a twelfth of the difference between P and the cubic polynomial through u and v. Without any
    acceleration there is no estimate, and the error is 0.

    A polynomial has `count` knots. ``evaluate(t, u, v)`` returns f at rows of states, and ``steps(t)`` the length of
    the step that led to each of the times.
    """

    def __init__(
        self, knots: Knots, count: int, evaluate: Evaluate | None, steps: Callable[[np.ndarray], np.ndarray]
    ) -> None:
        self._knots, self._count = knots, count
        self._evaluate, self._steps = evaluate, steps

    @cached_property
    def _range(self) -> np.ndarray:
        """The range of the motion of each degree of freedom, from a sample of the saved states."""
        u = self._knots.u.reshape(len(self._knots.t), -1)
        rows = u[:: max(1, len(u) // _STATES)]
        return np.maximum(np.ptp(rows, axis=0), _ROUND_OFF * np.abs(rows).max(axis=0))

    def errors(self, times: np.ndarray) -> np.ndarray:
        """Return the relative errors around these times, shape (2, times).

        The first is the largest error relative to the motion of its degree of freedom, or to a thousandth of the
        largest motion. The second is relative to the largest motion of all degrees of freedom. The error is 0 at the
        saved states.
        """
        t = self._knots.t
        left = np.minimum(self._knots.left_of(times), len(t) - 2)
        errors = np.zeros((2, len(left)))
        is_long = t[left + 1] - t[left] > 1.01 * self._steps(t[left + 1])
        some = is_long & (t[left] < times) & (times < t[left + 1])
        if some.any():
            errors[:, some] = self._of_intervals(left[some])
        return errors

    @cached_property
    def _found(self) -> np.ndarray:
        """The errors by interval; NaN until they are computed."""
        return np.full((2, len(self._knots.t) - 1), np.nan)

    def _of_intervals(self, left: np.ndarray) -> np.ndarray:
        unknown = np.unique(left[np.isnan(self._found[0, left])])
        size = max(1, _CHUNK_VALUES // (len(_POINTS) * self._knots.u[:1].size * 3 * self._count))
        with np.errstate(all="ignore"):  # the last states of a run that blew up
            for first in range(0, len(unknown), size):
                some = unknown[first : first + size]
                self._found[:, some] = self._relative(some)
        return self._found[:, left]

    def _relative(self, left: np.ndarray) -> np.ndarray:
        knots, k = self._knots, len(_POINTS)
        length = knots.t[left + 1] - knots.t[left]
        times = (knots.t[left, None] + length[:, None] * _POINTS).ravel()
        which = np.repeat(left, k)
        u, v, a = knots.between(times, which, self._count, orders=3)

        def by_interval(values: np.ndarray) -> np.ndarray:
            return values.reshape(len(left), k, -1)

        way = np.abs(by_interval(u) - knots.u[left].reshape(len(left), 1, -1)).max(axis=1)
        size = np.maximum(self._range, way)
        whole = size.max(axis=1, keepdims=True)
        size = np.maximum(size, _SMALL * whole)
        if self._evaluate is None:
            error = by_interval(_CUBIC * np.abs(u - knots.cubic(times, which)))
        else:
            bump = np.repeat(_BUMP / length**2, k)[:, None]
            error = by_interval(self._error(times, u, v, a, bump, np.repeat(size, k, axis=0)))
        error = error.max(axis=1)
        relative = np.stack([(error / size).max(axis=1), (error / whole).max(axis=1)])
        return np.where(np.isnan(relative), 0.0, relative)

    def _error(
        self, t: np.ndarray, u: np.ndarray, v: np.ndarray, a: np.ndarray, bump: np.ndarray, size: np.ndarray
    ) -> np.ndarray:
        """Estimate the error of polynomials from f at these values, as rows."""
        shape, rows = u.shape, (len(t), -1)
        assert self._evaluate is not None
        try:
            f = self._evaluate(t, u, v).reshape(rows)
            d = a.reshape(rows) - f
            part = _NUDGE * np.min(np.where(d == 0, np.inf, size / np.abs(d)), axis=1, keepdims=True)
            part = np.where((part > 0) & np.isfinite(part), part, _NUDGE / bump)  # without any motion
            beside = self._evaluate(t, u + (part * d).reshape(shape), v).reshape(rows)
        except Exception:  # rhs may fail at a state at which the method does not evaluate it
            return np.zeros(rows if u.ndim > 1 else (len(t), 1))
        difference = np.abs(d)
        error = difference * difference / (bump * difference + np.abs(beside - f) / part)
        return np.where(difference == 0, 0.0, np.where(np.isfinite(f), error, np.inf))
