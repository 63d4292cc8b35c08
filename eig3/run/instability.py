"""Find out whether a completed run has grown because its fixed step is unstable."""

from __future__ import annotations

from typing import Any

from ..diagnosis.critical import NoStableStepError, growth_by_step, of_linear
from ..diagnosis.linearisation import linearise_at
from ..diagnosis.stiffness import VERY_MANY_STEPS
from ..functions.companions import mark
from ..stepping.stepper import Stepper
from ..stepping.system import System

_MOST_DEGREES = 200  # for which the critical step is found
_SEEN = 0.1  # logarithm of a growth that a run shows
_GROWN, _GROWN_LINEAR = 10.0, 2.0  # motions that grow by these factors may be unstable


def has_grown(system: System, n_steps: Any, ends: Any, starts: Any) -> Any:
    """Whether the motion is so much larger than at its start that its step may be the reason.

    For a linear structure, the critical step at the start holds for the whole run, so that no motion is suspected in
    vain, and also a motion from rest is. Another run must be long, with forces that read the velocity. The sizes of u
    and v, `ends` and `starts`, are numbers, or arrays of shape (m,) of members.
    """
    is_linear = mark(system.rhs, "is_linear")
    factor = _GROWN_LINEAR if is_linear else _GROWN
    from_rest = bool(is_linear) & (sum(starts) == 0)
    u, v = ((end > factor * start) & (from_rest | (start > 0)) for end, start in zip(ends, starts, strict=True))
    return (u | v) & (is_linear or (n_steps >= VERY_MANY_STEPS) & system.callback.reads_velocity)


def instability(stepper: Stepper, n_steps: int) -> str:
    """Describe a step that is unstable at the start of a run of `n_steps`; empty if it is stable there."""
    if stepper.n > _MOST_DEGREES:
        return ""
    try:
        system = linearise_at(stepper.restarted(stepper.h), stepper.running)
        first_order = stepper.system.first_order.is_read
        if not first_order and n_steps * growth_by_step(stepper.running, system, stepper.h) < _SEEN:
            return ""  # the search for the critical step takes a hundred times as long
        limit = of_linear(system, stepper.running).limit
    except NoStableStepError as error:  # which is often so weak that only a long run shows it
        return str(error) if first_order or n_steps >= VERY_MANY_STEPS else ""
    except Exception:  # nothing limits the step, or the function fails beside the start
        return ""
    if stepper.h <= limit:
        return ""
    return (
        f"h = {stepper.h:.4g} is longer than the critical step {limit:.4g} of {stepper.running!r} at the start: "
        "take a shorter step, or RK4."
    )
