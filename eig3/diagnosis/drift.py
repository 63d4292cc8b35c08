"""Compare the drift of an invariant with the size of the terms of which it is the sum."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..stepping.stepper import Stepper
from ..stepping.variable_stepper import VariableStepper

_BEYOND = 10.0  # least drift that is noted, relative to the terms at the start
_SHOWN = 0.05  # and relative to those at the end: near an unstable position, the terms at the start are small
_STEPS = 10  # more steps whose velocities count at the end: the errors of a method of order 2 are smaller


def excess(march: Stepper | VariableStepper, k: int, h: float) -> float:
    """Return the drift of an invariant relative to its terms at the start; 0.0 if that is not beyond all reason.

    The terms are the value without velocities and the change by them. Velocities count without their signs, with some
    weights, so that the terms of a momentum do not cancel. The work belongs to the terms of an energy less the work. At
    the end, the velocities of some more steps count too: the motion may be where it turns back.

    Parameters
    ----------
    march : Stepper or VariableStepper
        It stands at the end of the run.
    k : int
        The number of the invariant.
    h : float
        The step, or the mean one.
    """
    assert march.look
    follower = march.look.follower
    drift = follower.drift_of(k)
    if not drift > _BEYOND * abs(follower.start_of(k)):  # this is so in nearly all runs
        return 0.0
    invariant, work = follower.followed.quantities[k].callback, follower.followed.work[k]

    def terms(t: float, u: Any, v: Any, more: Any) -> float:
        speeds = (np.abs(v) + np.abs(more)) * (1 + np.cos(np.arange(march.n) ** 2.0) / 2 if np.ndim(v) else 1.0)
        if work >= 0:
            speeds[work] = 0.0
        rest = invariant.call(t, u, 0 * speeds, march.params)
        return abs(rest) + abs(invariant.call(t, u, speeds, march.params) - rest) + float(follower.most[k])

    t, u, v = march.t, march.u, march.v
    with np.errstate(over="ignore", invalid="ignore"):
        try:
            at_start = terms(march.t0, *march.start, 0.0)
            at_end = terms(t, u, v, _STEPS * h * march.acceleration(t, u, v))
        except Exception:  # a function may fail at other velocities, and where it ended the run
            return 0.0
    return drift / at_start if at_start > 0 and drift > max(_BEYOND * at_start, _SHOWN * at_end) else 0.0
