"""Where a run left what is finite, and why."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from .critical import CriticalStep, NoCriticalStepError, critical
from .stepper import Stepper

_OVERFLOWING = 1e100  # states beyond this make a right-hand side infinite by themselves
_SAFETY = 0.9
_SAME = 0.02  # critical steps closer than this are told once
_TRIALS = 8
_LEAST_SECONDS = 0.2  # to try shorter steps for; as long as the run took, if that is longer


def before_divergence(stepper: Stepper) -> tuple[Stepper, Callable[[], str]]:
    """Bisect the last chunk for its last finite state; chunks agree bit for bit, so the search is exact.

    Returns
    -------
    last : Stepper
        There.
    message : callable
        Why the run ends; to be called when somebody asks, since finding out can take as long as the run.
    """
    bad_index, seconds = stepper.index, stepper.seconds
    stepper.back()
    last = _last(stepper, bad_index, lambda s: s.is_finite)
    bad = last.fork()
    bad.advance(1)
    last.seconds = seconds
    return last, partial(divergence_message, last, _first_not_finite(bad.u, bad.v), stepper)


def _last(stepper: Stepper, bad_index: int, is_good: Callable[[Stepper], bool]) -> Stepper:
    """The last good state from where `stepper` stands to before `bad_index`."""
    while bad_index - stepper.index > 1:
        middle = stepper.fork()
        middle.advance((bad_index - stepper.index) // 2)
        if is_good(middle):
            stepper = middle
        else:
            bad_index = middle.index
    return stepper


def divergence_message(last: Stepper, degree: int, before: Stepper | None = None) -> str:
    """Why a run ends.

    Parameters
    ----------
    last : Stepper
        At the last finite state.
    degree : int
        The degree of freedom that is not finite after the next step.
    before : Stepper, optional
        Somewhere before that.
    """
    where = "" if np.ndim(last.u) == 0 else f" in degree of freedom {degree}"
    what = f"The run became non-finite at t = {last.t + last.h:g}{where}, with h = {last.h:g}"
    culprit = _culprit(last)
    if culprit:
        return f"{what}: {culprit}"
    moderate = _last(before or last, last.index + 1, lambda s: _size(s) < _OVERFLOWING)
    late, why_late = _critical(moderate)
    start, why_start = _critical(last.restarted(last.h))
    if late and start and abs(late.limit - start.limit) < _SAME * start.limit:
        told = [f"{late.limit:.4g} from the start to the end{_mode(late)}"]
    else:
        ends = (start, "at the start"), (late, "at the end")
        told = [f"{step.limit:.4g} {at}{_mode(step)}" for step, at in ends if step]
    if told:
        why = f"the critical step of {last.method!r} is {' and '.join(told)}"
    else:
        why = (why_start or why_late or "its critical step cannot be told, as rhs overflows").rstrip(".")
    limits = [step.limit for step in (start, late) if step]
    return f"{what}: {why}; {_remedy(last, max(limits, default=last.h))}"


def _culprit(last: Stepper) -> str:
    """What rhs itself does wrong, at the times of the next step; empty where it does nothing."""
    if _size(last) >= _OVERFLOWING:
        return ""
    for t in (last.t, last.t + last.h / 2, last.t + last.h):
        try:
            a = last.acceleration(t, last.u, last.v)
        except Exception:  # at a time that the method does not ask for
            continue
        if not np.isfinite(a).all():
            value = np.atleast_1d(a)[_first_not_finite(a)]
            return f"rhs gives {value} at t = {t:g}, for the last u and v of the solution."
    return ""


def _size(stepper: Stepper) -> float:
    return float(max(np.abs(stepper.u).max(), np.abs(stepper.v).max()))


def _first_not_finite(*arrays: Any) -> int:
    finite = np.all([np.isfinite(np.atleast_1d(array)) for array in arrays], axis=0)
    return int(np.argmin(finite))


def _critical(stepper: Stepper) -> tuple[CriticalStep | None, str]:
    """The critical step where `stepper` stands, or why there is none."""
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            return critical(stepper.acceleration, stepper.t, stepper.u, stepper.v, stepper.method), ""
    except NoCriticalStepError as error:
        return None, str(error)
    except Exception:  # whatever rhs or the differences of it come to so near to overflow
        return None, ""


def _mode(step: CriticalStep) -> str:
    return f" (omega = {step.omega_max:.4g}, xi = {step.xi:.2g})"


def _remedy(stepper: Stepper, limit: float) -> str:
    """A step that was tried from the start to where the run failed, or why none is named."""
    h = _rounded(_SAFETY * min(limit, stepper.h))
    seconds = max(_LEAST_SECONDS, stepper.seconds)
    rate = stepper.seconds / max(1, stepper.index)
    tried = None
    for _ in range(_TRIALS):
        n_steps = int((stepper.t + stepper.h - stepper.t0) / h) + 2
        seconds -= n_steps * rate
        if seconds < 0:
            break
        tried = h
        if _holds(stepper.restarted(h), n_steps):
            return f"h = {h:g} was tried and holds up to there."
        h = _rounded(h / 2)
    if tried is None:
        return f"h = {h:g} should hold, which would take long to try."
    return (
        f"shorter steps down to h = {tried:.3g} were tried and fail too, so that the solution itself may be unbounded."
    )


def _holds(trial: Stepper, n_steps: int) -> bool:
    try:
        return trial.advance(n_steps) == n_steps and trial.is_finite and _size(trial) < _OVERFLOWING
    except Exception:  # of rhs
        return False


def _rounded(h: float) -> float:
    """To three digits, towards zero."""
    unit = 10.0 ** (np.floor(np.log10(h)) - 2)
    return float(np.floor(h / unit) * unit)
