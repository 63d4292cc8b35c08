"""Invariants: compiled functions that are evaluated at every step of a run."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..callbacks import check_callback
from ..checks import check_invariants
from ..kernels.invariant import invariant_kernel
from ..methods import Method
from ..stepper import Stepper
from .chunk import Chunk

_PARTS = 16  # number of parts of a run; a growth is steady if the invariant grows from each part to the next
_NOTABLE = 1e-6  # least growth over the run that is noted, relative to the invariant
_VISIBLE = 0.1  # least growth over the run that is noted, relative to the oscillation of the invariant in a part
_FAST = 1e3  # a growth above this is not called slow


class Watch:
    """An invariant e along a run.

    Attributes
    ----------
    name : str
    drift : float
        The maximum of |e_n - e_0| over the steps so far; NaN if e became NaN.
    """

    def __init__(self, name: str, function: Any, stepper: Stepper, n_steps: int) -> None:
        self.name = name
        self.drift = 0.0
        self._function = check_callback(function, "invariant", stepper.form, f"invariants[{name!r}]")
        self._kernel = invariant_kernel(stepper.form)
        self._start = self._function.call(stepper.t0, stepper.u, stepper.v, stepper.params)
        self._context = (stepper.t0, stepper.h, stepper.params)
        # The parts have unequal lengths, so that they do not all end in the same phase of a periodic motion.
        self._ends = np.ceil(n_steps * (np.arange(1, _PARTS + 1) / _PARTS) ** 1.1).astype(int)
        self._low, self._high = np.full(_PARTS, np.inf), np.full(_PARTS, -np.inf)
        self._forward = np.atleast_1d(stepper.v) > 0
        self._turns = np.zeros(self._forward.size, dtype=np.int8)
        self._next = 1  # index of the next step to evaluate

    def see(self, chunk: Chunk) -> None:
        """Evaluate the invariant at every state of a chunk."""
        u_rows, v_rows = chunk.u, chunk.v
        while len(u_rows):
            part = int(np.searchsorted(self._ends, self._next))
            count = min(len(u_rows), int(self._ends[part]) - self._next + 1)
            low, high = self._kernel(self._function.address, *self._context, self._next, u_rows[:count], v_rows[:count])
            # np.minimum and np.maximum return NaN if one of their arguments is NaN.
            self._low[part], self._high[part] = np.minimum(self._low[part], low), np.maximum(self._high[part], high)
            self.drift = float(np.maximum(self.drift, np.maximum(self._start - low, high - self._start)))
            self._next += count
            if self._next > self._ends[part]:
                forward = np.atleast_1d(v_rows[count - 1]) > 0
                self._turns += forward != self._forward
                self._forward = forward
            u_rows, v_rows = u_rows[count:], v_rows[count:]

    @property
    def extremes(self) -> tuple[float, float]:
        """The minimum and the maximum of e over the steps so far; NaN if e became NaN."""
        return float(np.minimum(self._start, self._low.min())), float(np.maximum(self._start, self._high.max()))

    @property
    def growth(self) -> float:
        """The growth of e over the run, relative to e; 0.0 if e did not grow steadily, infinity if it overflowed.

        The growth counts as steady if e grows from each part of the run to the next. It is 0.0 if no velocity has
        changed its sign at least twice from one end of a part to the next: the run may then be shorter than a period,
        and the error of e only follows the motion.
        """
        with np.errstate(invalid="ignore"):
            middle, width = (self._low + self._high) / 2, self._high - self._low
        n_finite = int(np.argmin(np.append(np.isfinite(middle), False)))  # number of parts before e overflows
        steady = (np.diff(middle[:n_finite]) > 0).all()
        if n_finite < _PARTS / 4 or not steady or self._turns.max() < 2 or np.isnan(self.drift):
            return 0.0
        if n_finite < _PARTS:
            return math.inf
        growth = float(middle[-1] - middle[0])
        size = abs(self._start) or abs(float(middle[0])) or growth
        if growth > size:
            # The middles leave out half of the first and of the last part, which matters in so fast a growth.
            growth = float(self._high[-1] - self._start)
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


def watches_of(invariants: Mapping[str, Any] | None, stepper: Stepper, n_steps: int) -> list[Watch]:
    """Compile the invariants of a run of `n_steps` steps, and evaluate them at its start."""
    functions = check_invariants(invariants)
    return [Watch(name, function, stepper, n_steps) for name, function in functions.items()]
