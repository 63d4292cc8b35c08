"""Invariants followed along a run, natively, at every step."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from .callbacks import check_callback
from .kernels.invariant import drift
from .kernels.jit import invariant_kernel
from .stepper import Stepper


class Watch:
    """One invariant: `drift` is max |e_n - e_0| over the states followed, NaN once e was."""

    def __init__(self, name: str, function: Any, stepper: Stepper) -> None:
        self.drift = 0.0
        self._function = check_callback(function, "invariant", stepper.form, f"invariants[{name!r}]")
        self._kernel = invariant_kernel(drift, stepper.form)
        self._start = self._function(stepper.t0, stepper.u, stepper.v, stepper.params)
        self._context = (stepper.t0, stepper.h, stepper.params)

    def follow(self, first: int, u_rows: np.ndarray, v_rows: np.ndarray) -> None:
        """Take in the states of the step indices from `first`."""
        worst = self._kernel(self._function, self._start, *self._context, first, u_rows, v_rows)
        self.drift = float(np.maximum(self.drift, worst))  # np.maximum keeps a NaN


def watches_of(invariants: Mapping[str, Any] | None, stepper: Stepper) -> dict[str, Watch]:
    """The invariants of a run, compiled and evaluated at its start."""
    if invariants is not None and not isinstance(invariants, Mapping):
        raise TypeError("invariants must be a dictionary of names and jitted functions, as {'energy': energy}.")
    return {name: Watch(name, function, stepper) for name, function in (invariants or {}).items()}
