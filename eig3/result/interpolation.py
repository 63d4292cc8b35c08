"""Hermite interpolation between states, with their accelerations if these are known."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

_CHUNK_VALUES = 2**20  # values in the divided differences that are computed at once
_LEAST_GAP = 0.5  # least distance of two knots of a polynomial, relative to the interval of evaluation


@dataclass(frozen=True, eq=False)
class Knots:
    """States in the order of time. Two states at the same time are the states before and after a jump.

    Attributes
    ----------
    t : ndarray, shape (m,)
    u, v : ndarray, shape (m,) or (m, n)
    accelerations : callable or None
        ``accelerations(rows)`` returns the accelerations of the states with these numbers; None if they are not known.
    """

    t: np.ndarray
    u: np.ndarray
    v: np.ndarray
    accelerations: Callable[[np.ndarray], np.ndarray] | None

    def at(self, times: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Interpolate u and v at times between the first and the last state.

        The polynomial of an interval matches u, v and the accelerations of `count` states, or of fewer states between
        two jumps: of the two ends of the interval, and of the next states on the nearer side. Its errors are of the
        orders 3 count in u and 3 count - 1 in v. If an acceleration is not known or not finite, it matches only u and v
        at the two ends.
        """
        flat = times.ravel()
        left = self.left_of(flat)
        u, v = self.u[left], self.v[left]
        between = np.flatnonzero(flat > self.t[left])
        step = max(1, _CHUNK_VALUES // (3 * count * max(1, self.u[:1].size)))
        for first in range(0, len(between), step):
            part = between[first : first + step]
            u[part], v[part] = self.between(flat[part], left[part], count)
        shape = times.shape + self.u.shape[1:]
        return u.reshape(shape)[()], v.reshape(shape)[()]

    def left_of(self, times: np.ndarray) -> np.ndarray:
        """Return the index of the last state at or before each time."""
        return np.searchsorted(self.t, times, side="right") - 1

    def between(self, times: np.ndarray, left: np.ndarray, count: int, orders: int = 2) -> np.ndarray:
        """Interpolate between the states `left` and the next states.

        Returns
        -------
        ndarray, shape (orders, times, ...)
            u, v and further derivatives.
        """
        values = np.empty((orders, len(times), *self.u.shape[1:]))
        for some, knots in self._knots_of(left, count):
            values[:, some] = self._polynomial(times[some], knots, orders)
        return values

    def cubic(self, times: np.ndarray, left: np.ndarray) -> np.ndarray:
        """Interpolate u between the states `left` and the next states by cubic polynomials through u and v."""
        return self._evaluated(times, np.stack([left, left + 1], axis=1), [], 1)[0]

    def _polynomial(self, times: np.ndarray, knots: np.ndarray, orders: int) -> np.ndarray:
        """Interpolate at each time between the first two of its `knots`, shape (times, count)."""
        rows, places = np.unique(knots, return_inverse=True)
        a = self._accelerations(rows)[places.reshape(knots.shape)]
        is_known = np.isfinite(a).reshape(len(times), -1).all(axis=1)
        values = np.empty((orders, len(times), *self.u.shape[1:]))
        for some, own, derivatives in (
            (is_known, knots[is_known], [a[is_known]]),
            (~is_known, knots[~is_known, :2], []),
        ):
            if len(own):
                values[:, some] = self._evaluated(times[some], own, derivatives, orders)
        return values

    def _evaluated(
        self, times: np.ndarray, knots: np.ndarray, derivatives: list[np.ndarray], orders: int
    ) -> np.ndarray:
        t, u = self.t[knots], self.u[knots]
        start, length = t[:, 0], t[:, 1] - t[:, 0]
        with np.errstate(over="ignore", invalid="ignore"):  # the last states of a run that blew up
            coefficients = [u - u[:, :1], *(x for x in (self.v[knots], *derivatives))]
            taylor = np.stack([c.reshape(*knots.shape, -1) for c in coefficients], axis=2)
            powers = np.arange(taylor.shape[2])
            taylor *= (length[:, None] ** powers / np.maximum(1, powers))[:, None, :, None]  # 0!, 1! and 2!
            values = hermite((times - start) / length, (t - start[:, None]) / length[:, None], taylor, orders)
            values /= length[:, None] ** np.arange(orders)[:, None, None]
        values = values.reshape(orders, *u[:, 0].shape)
        values[0] += u[:, 0]
        return values

    def _accelerations(self, rows: np.ndarray) -> np.ndarray:
        if self.accelerations is not None:
            try:
                return self.accelerations(rows)
            except Exception:  # rhs may fail at a state at which the method does not evaluate it
                pass
        return np.full((len(rows), *self.u.shape[1:]), np.nan)

    def _knots_of(self, left: np.ndarray, count: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Choose the knots for the intervals that begin at the states `left`, with no jump between them.

        Knots that are much closer together than the ends of the interval would amplify round-off, and are skipped.

        Yields
        ------
        some : ndarray of int
            Intervals with the same number of knots.
        knots : ndarray of int, shape (intervals, number of knots)
            The first two are the ends of the interval.
        """
        t, (first, last) = self.t, self._smooth(left)
        low, high = left, left + 1
        gap = _LEAST_GAP * (t[high] - t[low])
        knots, sizes = [low, high], np.full(len(left), 2)
        for _ in range(count - 2):
            below = np.searchsorted(t, t[low] - gap, side="right") - 1
            above = np.searchsorted(t, t[high] + gap, side="left")
            is_below, is_above = below >= first, above <= last
            below, above = np.maximum(below, first), np.minimum(above, last)
            is_below &= ~is_above | (t[left] - t[below] <= t[above] - t[left + 1])
            is_above &= ~is_below
            low, high = np.where(is_below, below, low), np.where(is_above, above, high)
            knots.append(np.where(is_below, below, above))
            sizes += is_below | is_above
        table = np.stack(knots, axis=1)
        for size in np.unique(sizes):
            some = np.flatnonzero(sizes == size)
            yield some, table[some, :size]

    def _smooth(self, left: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the first and the last state of the smooth parts of the motion that contain the states `left`."""
        part = np.searchsorted(self._jumps, left, side="left")
        return np.append(0, self._jumps + 1)[part], np.append(self._jumps, len(self.t) - 1)[part]

    @cached_property
    def _jumps(self) -> np.ndarray:
        """The indices of the states before the jumps."""
        return np.flatnonzero(self.t[1:] == self.t[:-1])


def hermite(s: np.ndarray, x: np.ndarray, taylor: np.ndarray, orders: int) -> np.ndarray:
    """Evaluate polynomials that match functions and their first m - 1 derivatives at k points, in Newton's form.

    Parameters
    ----------
    s : ndarray, shape (q,)
        The point of evaluation of each polynomial.
    x : ndarray, shape (q, k)
        The points at which the polynomials match.
    taylor : ndarray, shape (q, k, m, n)
        The values of n functions there and their derivatives, divided by the factorial of their order.
    orders : int
        The number of rows to return: values, first derivatives, second derivatives and so on.

    Returns
    -------
    ndarray, shape (orders, q, n)
    """
    k, m = taylor.shape[1:3]
    nodes, place = np.repeat(x, m, axis=1), np.repeat(np.arange(k), m)
    c = taylor[:, place, 0]
    for level in range(1, k * m):
        same = np.flatnonzero(place[level:] == place[:-level]) + level
        distance = nodes[:, level:] - nodes[:, :-level]
        distance[:, same - level] = 1.0
        c[:, level:] = (c[:, level:] - c[:, level - 1 : -1]) / distance[..., None]
        if same.size:
            c[:, same] = taylor[:, place[same], level]
    values = np.zeros((orders, *c[:, -1].shape))
    values[0] = c[:, -1]
    for j in range(k * m - 2, -1, -1):
        along = (s - nodes[:, j])[:, None]
        for order in range(orders - 1, 0, -1):
            values[order] = values[order] * along + order * values[order - 1]
        values[0] = values[0] * along + c[:, j]
    return values
