"""Where a run left what is finite, or grew beyond measure, and why."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..stepper import Stepper
from .critical import CriticalStep, NoStableStepError, critical
from .linear import linearise

_OVERFLOWING = 1e100  # states beyond this make a right-hand side infinite by themselves
_BLOWN_UP = 1e3  # times the size before: the growth of an instability
_BROUGHT_ABOUT = 1e-3  # of h: critical steps shorter than this are those of a blow-up, not of what led to it
_SAME_LIMIT = 0.02  # critical steps closer than this are told once
_SAFETY = 0.9
_HALVINGS = 8
_PATIENCE = 2.5  # steps of all trials together, in units of those that the run took,
_LEAST_WORK = 3e7  # or, where that is more, this many steps divided by the degrees of freedom and some overhead


@dataclass(frozen=True)
class Divergence:
    """Where a run left what is finite, or grew beyond measure.

    Attributes
    ----------
    last : Stepper
        At the last state that the solution keeps.
    degree : int
        The degree of freedom that is not finite after the next step.
    before : Stepper
        Somewhere before the motion grew.
    """

    last: Stepper
    degree: int
    before: Stepper

    @property
    def message(self) -> str:
        """What is known without looking for the reason."""
        return f"{self._what}; solution.explain() looks for the reason."

    @property
    def _what(self) -> str:
        last = self.last
        where = "" if np.ndim(last.u) == 0 else f" in degree of freedom {self.degree}"
        return f"The run became non-finite at t = {last.t + last.h:g}{where}, with h = {last.h:g}"

    def explain(self) -> str:
        """Compare h with the critical step, look for what rhs does wrong, and try shorter steps."""
        last = self.last
        start = last.restarted(last.h)
        sane = last_sane(self.before, last.index + 1, start)
        steps, unstable = _critical_steps(start, sane)
        limits = [step.limit for _, step in steps]
        culprit = _culprit(last)
        if culprit and not (limits and last.h > min(limits)):
            return f"{self._what}: {culprit}."
        why = _comparison(last, steps) or unstable
        reasons = [reason for reason in (culprit, why, _remedy(last, limits) if not unstable else "") if reason]
        return f"{self._what}: {'; '.join(reasons)}."


def find_divergence(stepper: Stepper) -> Divergence:
    """Bisect the last chunk for its last finite state; chunks agree bit for bit, so the search is exact."""
    before = stepper.before()
    last = _last(before, stepper.index, lambda s: s.is_finite)
    bad = last.fork()
    bad.advance(1)
    last.seconds = stepper.seconds
    return Divergence(last, _first_not_finite(bad.u, bad.v), before)


@dataclass(frozen=True)
class BlowUp:
    """A finite motion that grew beyond measure through its step.

    Attributes
    ----------
    last : Stepper
        At the end of the run.
    growth : float
        The size at the end, in units of that at the start.
    began : float
        The time after which the motion grew.
    why : str
        How h compares with the critical step.
    limits : list of float
        The critical steps.
    """

    last: Stepper
    growth: float
    began: float
    why: str
    limits: list[float]

    @property
    def message(self) -> str:
        last = self.last
        return (
            f"The motion stayed finite up to t = {last.t:g}, but from t = {self.began:g} on it grew to "
            f"{self.growth:.2g} times its size, through the step h = {last.h:g}: {self.why}."
        )

    def explain(self) -> str:
        """The message, with a step that was tried."""
        return f"{self.message.rstrip('.')}; {_remedy(self.last, self.limits)}." if self.limits else self.message


def find_blow_up(stepper: Stepper, before: Stepper) -> BlowUp | None:
    """Whether a motion that grew beyond measure since `before` grew through the step of the method alone.

    An unstable equilibrium, a resonance, a free fall grow by themselves: there the step is below the critical one. A
    method without any stable step is the reason only where the system's own growth is much slower than what is seen.
    """
    start = stepper.restarted(stepper.h)
    sane = last_sane(before, stepper.index, start)
    steps, unstable = _critical_steps(start, sane)
    limits = [step.limit for _, step in steps]
    growth = _size(stepper) / (_size(start) or 1.0)
    if unstable:
        own_growth = max(_own_rate(start), _own_rate(sane)) * (stepper.t - stepper.t0)
        guilty = math.log(growth) > 2 * own_growth + math.log(_BLOWN_UP)
    else:
        guilty = any(stepper.h > limit for limit in limits)
    if not guilty:
        return None
    return BlowUp(stepper, growth, sane.t, _comparison(stepper, steps) or unstable, limits)


def last_sane(before: Stepper, bad_index: int, start: Stepper) -> Stepper:
    """The last state before a step index at which the motion has about the size it had at the start."""
    return _last(before, bad_index, lambda s: _size(s) < (_BLOWN_UP * _size(start) or _OVERFLOWING))


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


def _own_rate(stepper: Stepper) -> float:
    """The fastest rate at which the linearised system grows by itself."""
    try:
        system = linearise(stepper.acceleration, stepper.t, stepper.u, stepper.v)
    except Exception:  # rhs is not finite close to this state
        return 0.0
    return max(0.0, float(system.rates().real.max()))


def _comparison(last: Stepper, steps: list[tuple[str, CriticalStep]]) -> str:
    shown = [f"{step.limit:.4g} {when}{_mode(step)}" for when, step in steps]
    return f"the critical step of {last.method!r} is {' and '.join(shown)}" if shown else ""


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
    left = max(_PATIENCE * last.index, _LEAST_WORK / (10 + np.size(last.u)))
    tried = last.h
    for h in _candidates(last.h, limits):
        n_steps = math.ceil((end - last.t0) / h)
        left -= n_steps
        if left < 0:
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
    return [float(f"{step:.3g}") for step in sorted({*halved, least}, reverse=True)]


def _holds(trial: Stepper, n_steps: int) -> bool:
    """Whether the second half of a run leaves the motion of about the size that it has after the first."""
    try:
        trial.advance(n_steps // 2)
        size = max(_size(trial), _size(trial.restarted(trial.h)))
        taken = trial.advance(n_steps - n_steps // 2)
    except Exception:  # of rhs
        return False
    return taken == n_steps - n_steps // 2 and trial.is_finite and _size(trial) < _BLOWN_UP * (size or 1.0)
