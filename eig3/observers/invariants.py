"""Invariants: compiled functions that are evaluated at every step of a run."""

import math

import numpy as np

from ..extremes import Extremes
from ..kernels.quantity import HIGH, LOW
from ..methods import Method
from ..quantities import Quantity
from ..stepper import Stepper
from .chunk import Chunk

_PARTS = 16  # number of parts of a run; a growth is steady if the invariant grows from each part to the next
_NOTABLE = 1e-6  # least growth over the run that is noted, relative to the invariant
_VISIBLE = 0.1  # least growth over the run that is noted, relative to the oscillation of the invariant in a part
_FAST = 1e3  # a growth above this is not called slow


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
    """

    def __init__(self, name: str, quantity: Quantity, stepper: Stepper, t_end: float) -> None:
        self.name, self._quantity, self._params = name, quantity, stepper.params
        # The parts have unequal lengths, so that they do not all end in the same phase of a periodic motion.
        self._ends = stepper.t0 + (t_end - stepper.t0) * (np.arange(1, _PARTS + 1) / _PARTS) ** 1.1
        self._ends[-1] = np.inf
        # Row 0 of these arrays is the start, and each further row one of the parts.
        self._extremes = np.array([quantity.no_extremes()] * (_PARTS + 1))
        self._forward = np.array([np.atleast_1d(stepper.v) > 0] * (_PARTS + 1))  # the signs of v at the end
        self._start = float(quantity.at_start(stepper.t0, *stepper.start, stepper.params, self._extremes[0]))

    def see(self, chunk: Chunk) -> None:
        """Evaluate the invariant at every state of a chunk."""
        t, u, v = chunk.t, chunk.u, chunk.v
        while len(t):
            part = int(np.searchsorted(self._ends, t[0]))
            count = int(np.searchsorted(t, self._ends[part], side="right"))
            self._quantity.evaluate(t[:count], u[:count], v[:count], self._params, self._extremes[part + 1])
            self._forward[part + 1] = v[count - 1] > 0
            t, u, v = t[count:], u[count:], v[count:]

    @property
    def extremes(self) -> Extremes:
        """The extremes of e over the steps so far."""
        # np.argmin and np.argmax return the place of the first NaN, if there is one.
        low, high, t_low, t_high = self._extremes[:, :, 0].T
        lowest, highest = np.argmin(low), np.argmax(high)
        return Extremes(*(float(x) for x in (low[lowest], high[highest], t_low[lowest], t_high[highest])))

    @property
    def drift(self) -> float:
        """The maximum of |e_n - e_0| over the steps so far; NaN if e became NaN."""
        low, high, *_ = self.extremes
        return float(np.maximum(self._start - low, high - self._start))

    @property
    def growth(self) -> float:
        """The growth of e over the run, relative to e; 0.0 if e did not grow steadily, infinity if it overflowed.

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
        if n_finite < _PARTS / 4 or not steady or turns.max() < 2 or np.isnan(self.drift):
            return 0.0
        if n_finite < _PARTS:
            return math.inf
        growth = float(middle[-1] - middle[0])
        size = abs(self._start) or abs(float(middle[0])) or growth
        if growth > size:
            # The middles leave out half of the first and of the last part, which matters in so fast a growth.
            growth = float(high[-1] - self._start)
        return growth / size if growth > max(_NOTABLE * size, _VISIBLE * np.median(width)) else 0.0

    def note(self, method: Method) -> str:
        """Return a sentence about the steady growth."""
        growth = self.growth
        amount = f"by {100 * growth:.2g} %" if growth < 1 else f"to {1 + growth:.3g} times its size"
        amount = amount if math.isfinite(growth) else "beyond the largest floating-point number,"
        unstable = "slowly unstable" if growth < _FAST else "unstable"
        return (
            f"{self.name} grows steadily, {amount} over the run; if the motion should keep it, {method!r} is "
            f"{unstable} here: take a smaller h, or a method that is stable for this system."
        )
