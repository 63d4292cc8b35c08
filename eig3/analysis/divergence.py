"""Where a run left what is finite, and why."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from ..stepper import Stepper
from .critical import CriticalStep, NoStableStepError, critical

_OVERFLOWING = 1e100  # states beyond this make a right-hand side infinite by themselves
_BLOWN_UP = 1e3  # times the size before: the growth of an instability
_BROUGHT_ABOUT = 1e-3  # of h: critical steps shorter than this are those of a blow-up, not of what led to it
_SAME_LIMIT = 0.02  # critical steps closer than this are told once
_SAFETY = 0.9
_HALVINGS = 8
_LEAST_SECONDS = 0.2  # to try shorter steps for
_PATIENCE = 2.5  # or so many times as long as the run took, where that is longer


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
    start = last.restarted(last.h)
    sane = _last(before or last, last.index + 1, lambda s: _size(s) < (_BLOWN_UP * _size(start) or _OVERFLOWING))
    steps, unstable = _critical_steps(start, sane)
    limits = [step.limit for _, step in steps]
    culprit = _culprit(last)
    if culprit and not (limits and last.h > min(limits)):
        return f"{what}: {culprit}."
    told = [f"{step.limit:.4g} {when}{_mode(step)}" for when, step in steps]
    why = f"the critical step of {last.method!r} is {' and '.join(told)}" if told else unstable
    reasons = [reason for reason in (culprit, why, _remedy(last, limits) if not unstable else "") if reason]
    return f"{what}: {'; '.join(reasons)}."


def _critical_steps(start: Stepper, sane: Stepper) -> tuple[list[tuple[str, CriticalStep]], str]:
    """Critical steps and when they are so: at the start, and where the motion was last sane.

    The second is why there is none, where the method is unstable at every step.
    """
    steps: list[tuple[str, CriticalStep]] = []
    for stepper in (start, sane):
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                step = critical(stepper.acceleration, stepper.t, stepper.u, stepper.v, stepper.method)
        except NoStableStepError as error:
            return steps, str(error).rstrip(".")
        except Exception:  # nothing limits the step, or rhs comes to something else so near to overflow
            continue
        else:
            if steps and abs(step.limit / steps[0][1].limit - 1) < _SAME_LIMIT:
                return [(f"from t = {start.t:g} to {sane.t:g}", step)], ""
            steps.append((f"at t = {stepper.t:g}", step))
    return steps, ""


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
            return f"rhs gives {value} at t = {t:g}, for the last u and v of the solution"
    return ""


def _size(stepper: Stepper) -> float:
    return float(max(np.abs(stepper.u).max(), np.abs(stepper.v).max()))


def _first_not_finite(*arrays: Any) -> int:
    finite = np.all([np.isfinite(np.atleast_1d(array)) for array in arrays], axis=0)
    return int(np.argmin(finite))


def _mode(step: CriticalStep) -> str:
    return f" (omega = {step.omega_max:.4g}, xi = {step.xi:.2g})"


def _remedy(last: Stepper, limits: list[float]) -> str:
    """A step that was tried from the start to where the run failed, or why none is named."""
    end = last.t + last.h
    seconds = max(_LEAST_SECONDS, _PATIENCE * last.seconds)
    rate = last.seconds / max(1, last.index)
    tried = last.h
    for h in _candidates(last.h, limits):
        n_steps = math.ceil((end - last.t0) / h)
        seconds -= n_steps * rate
        if seconds < 0:
            return f"h = {h:g} was not tried, which would take long"
        if _holds(last.restarted(h), n_steps):
            return f"h = {h:g} was tried and holds up to then"
        tried = h
    return f"shorter steps down to h = {tried:g} were tried and fail too: the solution itself may be unbounded"


def _candidates(h: float, limits: list[float]) -> list[float]:
    """Steps to try, the longest first: below the largest critical step and h, and then ever shorter."""
    longest = _SAFETY * min([h, *([max(limits)] if limits else [])])
    least = min([longest, *(_SAFETY * limit for limit in limits if limit > _BROUGHT_ABOUT * h)])
    halved = [longest / 2**i for i in range(_HALVINGS)]
    return [_rounded(step) for step in sorted({*halved, least}, reverse=True)]


def _holds(trial: Stepper, n_steps: int) -> bool:
    """Whether the second half of a run leaves the motion of about the size that it has after the first."""
    try:
        trial.advance(n_steps // 2)
        size = max(_size(trial), _size(trial.restarted(trial.h)))
        taken = trial.advance(n_steps - n_steps // 2)
    except Exception:  # of rhs
        return False
    return taken == n_steps - n_steps // 2 and trial.is_finite and _size(trial) < _BLOWN_UP * (size or 1.0)


def _rounded(h: float) -> float:
    """To three digits, towards zero."""
    unit = 10.0 ** (np.floor(np.log10(h)) - 2)
    return float(np.floor(h / unit) * unit)
