"""Invariants: compiled functions that are evaluated at every step of a run."""

import math
from collections.abc import Mapping
from copy import copy
from typing import Any

import numpy as np

from ..functions.checks import reals
from ..functions.extremes import Extremes
from ..functions.quantities import Quantity
from ..kernels.loops.quantity import HIGH, LOW
from ..methods import Method
from ..stepping.stepper import Stepper
from .chunk import Chunk

_PARTS = 16  # number of parts of a run; a growth is steady if the invariant grows from each part to the next
_NOTABLE = 1e-6  # least growth over the run that is noted, relative to the invariant
# The same of an energy less the work, relative to the larger of both. The errors of the work add up in a stable run
# too, to 2 % at resonance with EIG-3 and omega h = 0.2.
_NOTABLE_BALANCE = 0.1
_VISIBLE = 0.1  # least growth over the run that is noted, relative to the oscillation of the invariant in a part
_FAST = 1e3  # a growth above this is not called slow
_OVERFLOW = "beyond the largest floating-point number,"


class Watch:
    """An invariant e along a run.

    Parameters
    ----------
    name : str
    quantity : Quantity
    stepper : Stepper
        The stepper at the start of the run.
    t_end : float
        The end of the run.
    work : int or None
        The degree of freedom whose velocity is the work, if e is an energy less the work.
    """

    def __init__(self, name: str, quantity: Quantity, stepper: Stepper, t_end: float, work: int | None = None) -> None:
        self.name, self._quantity, self._params = name, quantity, stepper.params
        self._t0, self._ends = stepper.t0, _ends_of_parts(stepper.t0, t_end)
        # Row 0 of these arrays is the start, and each further row one of the parts.
        self._extremes = np.array([quantity.no_extremes()] * (_PARTS + 1))
        self._forward = np.array([np.atleast_1d(stepper.v) > 0] * (_PARTS + 1))  # the signs of v at the end
        self._start = float(quantity.at_start(stepper.t0, *stepper.start, stepper.params, self._extremes[0]))
        self._work, self._most_work = work, 0.0

    def see(self, chunk: Chunk) -> None:
        """Evaluate the invariant at every state of a chunk."""
        self.widen(chunk.t, chunk.u, chunk.v)

    def widen(self, t: np.ndarray, u: np.ndarray, v: np.ndarray) -> None:
        """Evaluate the invariant at states in the order of their times."""
        if self._work is not None and len(t):
            self._most_work = max(self._most_work, float(np.abs(v[:, self._work]).max()))
        while len(t):
            part = int(np.searchsorted(self._ends, t[0]))
            count = int(np.searchsorted(t, self._ends[part], side="right"))
            self._quantity.evaluate(t[:count], u[:count], v[:count], self._params, self._extremes[part + 1])
            self._forward[part + 1] = v[count - 1] > 0
            t, u, v = t[count:], u[count:], v[count:]

    def extended(self, t: float, t_end: float) -> "Watch":
        """Return an independent watch that has seen the same states, up to the time t, for a run up to `t_end`.

        Its parts are those of a run up to `t_end`, but each that ends before t ends where one of the old parts does.
        """
        other = copy(self)
        begun = np.append(-np.inf, self._ends[:-1]) < t
        old = np.minimum(self._ends[begun], t)
        new = _ends_of_parts(self._t0, t_end)
        nearest = np.abs(old[:, None] - new[new < t]).argmin(axis=0)
        other._ends = np.unique(np.concatenate([old[nearest], new[new >= t]]))
        other._quantity = self._quantity.fork()
        other._extremes = np.array([self._extremes[0]] + [self._quantity.no_extremes()] * len(other._ends))
        other._forward = np.array([self._forward[0]] * (len(other._ends) + 1))
        parts = np.searchsorted(other._ends, old)
        for part in np.unique(parts):
            rows = 1 + np.flatnonzero(parts == part)
            other._extremes[part + 1, :, 0] = _overall(self._extremes[rows])
            other._forward[part + 1] = self._forward[rows[-1]]
        return other

    def kept(self) -> dict[str, Any]:
        """Return what this watch needs to go on, in arrays."""
        parts = {"ends": self._ends, "extremes": self._extremes.copy(), "forward": self._forward.copy()}
        return {**parts, "most_work": self._most_work}

    def restore(self, kept: Mapping[str, Any]) -> None:
        """Become the watch that has returned `kept`."""
        ends, extremes = (reals(kept[name], name) for name in ("ends", "extremes"))
        forward, parts = np.array(kept["forward"], dtype=bool), len(ends) + 1
        if not ((np.diff(ends) > 0).all() and ends[-1] == np.inf):
            raise ValueError("the parts of a run follow each other, and the last has no end.")
        if extremes.shape != (parts, *self._extremes.shape[1:]) or forward.shape != (parts, *self._forward.shape[1:]):
            raise ValueError(f"the state of {self.name} has another shape.")
        self._ends, self._extremes, self._forward = ends, extremes, forward
        self._most_work = float(kept["most_work"])

    @property
    def extremes(self) -> Extremes:
        """The extremes of e over the steps so far."""
        return _overall(self._extremes)

    @property
    def drift(self) -> float:
        """The maximum of |e_n - e_0| over the steps so far; NaN if e became NaN."""
        low, high, *_ = self.extremes
        return float(np.maximum(self._start - low, high - self._start))

    @property
    def growth(self) -> float:
        """The growth of e over the run, relative to e; 0.0 if e did not grow steadily, infinity if it overflowed.

        The growth of an energy less the work is relative to the larger of the two, of which it is the difference.
        The growth counts as steady if e grows from each part of the run to the next. It is 0.0 if no velocity has
        changed its sign at least twice from one end of a part to the next: the run may then be shorter than a period,
        and the error of e only follows the motion.
        """
        low, high = self._extremes[1:, LOW, 0], self._extremes[1:, HIGH, 0]
        with np.errstate(invalid="ignore"):
            middle, width = (low + high) / 2, high - low
        n_finite = int(np.argmin(np.append(np.isfinite(middle), False)))  # number of parts before e overflows
        steady = (np.diff(middle[:n_finite]) > 0).all()
        turns = (self._forward[1:] != self._forward[:-1]).sum(axis=0)
        if n_finite < len(middle) / 4 or not steady or turns.max() < 2 or np.isnan(self.drift):
            return 0.0
        if n_finite < len(middle):
            return math.inf
        growth = float(middle[-1] - middle[0])
        if self._work is None:
            size, notable = abs(self._start) or abs(float(middle[0])) or growth, _NOTABLE
        else:
            size, notable = max(abs(self._start), self._most_work) or growth, _NOTABLE_BALANCE
        if growth > size:
            # The middles leave out half of the first and of the last part, which matters in so fast a growth.
            growth = float(high[-1] - self._start)
        return growth / size if growth > max(notable * size, _VISIBLE * np.median(width)) else 0.0

    def note(self, method: Method) -> str:
        """Return a sentence about the steady growth."""
        growth = self.growth
        remedy = "take a smaller h, or a method that is stable for this system."
        percent = f"by {100 * growth:.2g} %"
        if self._work is not None:
            amount = f"{percent} of the larger of the two" if math.isfinite(growth) else _OVERFLOW
            return f"{self.name} less the work grows steadily, {amount} over the run: {method!r} adds energy; {remedy}"
        amount = percent if growth < 1 else f"to {1 + growth:.3g} times its size"
        amount = amount if math.isfinite(growth) else _OVERFLOW
        unstable = "slowly unstable" if growth < _FAST else "unstable"
        return (
            f"{self.name} grows steadily, {amount} over the run; if the motion should keep it, {method!r} is "
            f"{unstable} here: {remedy}"
        )


def _ends_of_parts(t0: float, t_end: float) -> np.ndarray:
    # The parts have unequal lengths, so that they do not all end in the same phase of a periodic motion.
    ends = t0 + (t_end - t0) * (np.arange(1, _PARTS + 1) / _PARTS) ** 1.1
    ends[-1] = np.inf
    return ends


def _overall(parts: np.ndarray) -> Extremes:
    """Return the extremes over some parts."""
    # np.argmin and np.argmax return the place of the first NaN, if there is one.
    low, high, t_low, t_high = parts[:, :, 0].T
    lowest, highest = np.argmin(low), np.argmax(high)
    return Extremes(*(float(x) for x in (low[lowest], high[highest], t_low[lowest], t_high[highest])))
