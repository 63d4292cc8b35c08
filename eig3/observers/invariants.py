"""Invariants followed along a run, natively, at every step."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..callbacks import check_callback
from ..kernels.invariant import invariant_kernel
from ..stepper import Stepper
from .chunk import Chunk

_PARTS = 16  # of a run, in each of which what grows steadily must have grown
_NOTABLE = 1e-6  # growth over the run, relative to the invariant
_VISIBLE = 0.1  # and to what it comes and goes by in a part


class Watch:
    """One invariant: `drift` is max |e_n - e_0| over the states followed, NaN once e was."""

    def __init__(self, name: str, function: Any, stepper: Stepper, n_steps: int) -> None:
        self.name = name
        self.drift = 0.0
        self._function = check_callback(function, "invariant", stepper.form, f"invariants[{name!r}]")
        self._kernel = invariant_kernel(stepper.form)
        self._start = self._function.call(stepper.t0, stepper.u, stepper.v, stepper.params)
        self._context = (stepper.t0, stepper.h, stepper.params)
        # of unequal lengths, lest every part ends in the same phase of a periodic motion
        self._ends = np.ceil(n_steps * (np.arange(1, _PARTS + 1) / _PARTS) ** 1.1).astype(int)
        self._low, self._high = np.full(_PARTS, np.inf), np.full(_PARTS, -np.inf)
        self._forward = np.atleast_1d(stepper.v) > 0
        self._turns = np.zeros(self._forward.size, dtype=np.int8)
        self._next = 1  # the step index to follow from

    def see(self, chunk: Chunk) -> None:
        """Take in every state of a chunk."""
        u_rows, v_rows = chunk.u, chunk.v
        while len(u_rows):
            part = int(np.searchsorted(self._ends, self._next))
            count = min(len(u_rows), int(self._ends[part]) - self._next + 1)
            low, high = self._kernel(self._function.address, *self._context, self._next, u_rows[:count], v_rows[:count])
            # np.minimum and np.maximum keep a NaN
            self._low[part], self._high[part] = np.minimum(self._low[part], low), np.maximum(self._high[part], high)
            self.drift = float(np.maximum(self.drift, np.maximum(self._start - low, high - self._start)))
            self._next += count
            if self._next > self._ends[part]:
                forward = np.atleast_1d(v_rows[count - 1]) > 0
                self._turns += forward != self._forward
                self._forward = forward
            u_rows, v_rows = u_rows[count:], v_rows[count:]

    @property
    def growth(self) -> float:
        """What a steady growth added, relative to the invariant; 0.0 where it did not grow in every part of the run.

        A motion that turns back less than twice tells nothing: the error of an invariant comes and goes with it.
        """
        with np.errstate(invalid="ignore"):
            middle, width = (self._low + self._high) / 2, self._high - self._low
        told = int(np.argmin(np.append(np.isfinite(middle), False)))  # parts, until the invariant overflows
        steady = (np.diff(middle[:told]) > 0).all()
        if told < _PARTS / 4 or not steady or self._turns.max() < 2 or np.isnan(self.drift):
            return 0.0
        if told < _PARTS:
            return math.inf
        growth = float(middle[-1] - middle[0])
        size = abs(self._start) or abs(float(middle[0])) or growth
        if growth > size:  # by so much that the parts at the ends, half of which the middles leave out, tell
            growth = float(self._high[-1] - self._start)
        return growth / size if growth > max(_NOTABLE * size, _VISIBLE * np.median(width)) else 0.0


def watches_of(invariants: Mapping[str, Any] | None, stepper: Stepper, n_steps: int) -> list[Watch]:
    """The invariants of a run of `n_steps`, compiled and evaluated at its start."""
    if invariants is not None and not isinstance(invariants, Mapping):
        raise TypeError("invariants must be a dictionary of names and jitted functions, as {'energy': energy}.")
    return [Watch(name, function, stepper, n_steps) for name, function in (invariants or {}).items()]
