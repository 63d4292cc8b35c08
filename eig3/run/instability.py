"""Find out whether a completed run has grown because its fixed step is unstable."""

from __future__ import annotations

from typing import Any

from ..diagnosis.critical import NoStableStepError, critical
from ..diagnosis.stiffness import VERY_MANY_STEPS
from ..stepping.stepper import Stepper
from ..stepping.system import System

_MOST_DEGREES = 200  # for which the critical step is found
_GROWN = 10.0  # a motion that grows by this factor may be unstable


def has_grown(system: System, n_steps: Any, ends: Any, starts: Any) -> Any:
    """Whether a long motion with forces that read the velocity is several times larger than at its start.

    The sizes of u and v, `ends` and `starts`, are numbers, or arrays of shape (m,) of members.
    """
    u, v = ((end > _GROWN * start) & (start > 0) for end, start in zip(ends, starts, strict=True))
    return (u | v) & (n_steps >= VERY_MANY_STEPS) & system.callback.reads_velocity


def instability(stepper: Stepper) -> str:
    """Describe a step that is unstable at the start of a run; empty if it is stable there."""
    if stepper.n > _MOST_DEGREES:
        return ""
    try:
        limit = critical(stepper.acceleration, stepper.t0, *stepper.start, stepper.running).limit
    except NoStableStepError as error:
        return str(error)
    except ValueError:  # nothing limits the step
        return ""
    if stepper.h <= limit:
        return ""
    return (
        f"h = {stepper.h:.4g} is longer than the critical step {limit:.4g} of {stepper.running!r} at the start: "
        "take a shorter step, or RK4."
    )
