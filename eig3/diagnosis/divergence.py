"""Find where and why a run diverged.

A run diverges if its state becomes infinite or NaN, or if the motion grows by orders of magnitude because the step is
longer than the critical step.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..result.labels import Labels
from ..stepping.stepper import Stepper
from .critical import CriticalStep, NoStableStepError, growth_by_step, of_linear
from .linearisation import linearise_at
from .singular_position import AT_SINGULAR, AT_WHOLE_TURN, is_at_whole_turn, is_singular, ways_past

_OVERFLOWING = 1e100  # even a correct right-hand side may overflow for larger states
_BLOWN_UP = 1e3  # a motion that grows by more than this factor counts as unstable
_BROUGHT_ABOUT = 1e-3  # a critical step shorter than this fraction of h is a result of the blow-up, not its cause
_SAME_LIMIT = 0.02  # two critical steps whose relative difference is less than this are reported as one
_SAFETY = 0.9  # factor from a critical step to the longest step that is tried
_HALVINGS = 8  # number of steps to try, each half as long as the previous step
_STRIDE_GROWTH = 16  # factor from one stride to the next in the search for the beginning of the growth
_PATIENCE = 2.5  # largest number of steps of all trials together, relative to the steps of the run
_LEAST_WORK = 3e7  # the trials may also take this many steps, divided by the degrees of freedom plus 10


@dataclass(frozen=True)
class Divergence:
    """A run whose state became infinite or NaN.

    The stepper `last` is at the last finite state, which is the last state of the solution. `degree` is the first
    degree of freedom that is not finite after the next step. The search for the beginning of the growth starts at the
    earlier state of `before`. `t_end` is the end of the span of the run.
    """

    last: Stepper
    degree: int
    before: Stepper
    t_end: float

    @property
    def message(self) -> str:
        """Time and degree of freedom at which the state became non-finite, and whether it is singular there."""
        if self._is_at_whole_turn:
            return f"{self._what}{AT_WHOLE_TURN}."
        looked_for = "a way past it" if self._is_singular else "the reason"
        return f"{self._what}{self._lost}; solution.explain() looks for {looked_for}."

    @property
    def _what(self) -> str:
        degree = self.degree if np.ndim(self.last.u) else None
        return became_non_finite(self.last.t, self.last.h, degree, self.last.system.labels)

    @property
    def _is_at_whole_turn(self) -> bool:
        last = self.last
        return is_at_whole_turn(last.system.labels, last.u, last.v, last.h)

    @cached_property
    def _is_singular(self) -> bool:
        return is_singular(self.last, self.last.h)

    @property
    def _lost(self) -> str:
        return AT_SINGULAR if self._is_singular else lost_constraints(bool(self.last.system.constrained_step))

    def explain(self) -> str:
        """Find the reason: an error of rhs, or a step above the critical step, and a shorter step that works.

        At a singular position, find a step, a method or a tolerance with which a run passes it.

        Returns
        -------
        str
            The sentence of `message` with the reason.
        """
        last = self.last
        if self._is_at_whole_turn:
            return self.message
        if self._is_singular:
            return f"{self._what}{self._lost}: {ways_past(last, self.t_end)}."
        start = last.restarted(last.h)
        sane = last_sane(self.before, last.index + 1, start)
        steps, unstable = _critical_steps(start, sane)
        limits = [step.limit for _, step in steps]
        culprit = _culprit(last)
        if culprit and not (limits and last.h > min(limits)):
            return f"{self._what}: {culprit}."
        why = _comparison(last, steps) or unstable
        reasons = [reason for reason in (culprit, why, _remedy(last, limits) if not unstable else "") if reason]
        return f"{self._what}{self._lost}: {'; '.join(reasons)}." if reasons else f"{self._what}{self._lost}."


def became_non_finite(t: float, h: float, degree: int | None, labels: Labels | None) -> str:
    """Return the message that a state became non-finite in the step h after t; `degree` is None in the scalar form."""
    where = "" if degree is None else f" in {(labels or Labels()).place(degree)}"
    return f"The run became non-finite at t = {t + h:g}{where}, with h = {h:g}"


def lost_constraints(has_constraints: bool) -> str:
    """Return a clause about constraints that could not be satisfied."""
    if not has_constraints:
        return ""
    return (
        ", and no state was found that keeps the constraints: near there they may depend on each other, or the step is "
        "too long for them"
    )


def find_divergence(stepper: Stepper, t_end: float) -> Divergence:
    """Find the last finite state of the last chunk by bisection, from a stepper after it that is not finite.

    A chunk can be divided at any step with bitwise the same states. The search is therefore exact.
    """
    before = stepper.before()
    last = _last(before, stepper.index, lambda s: s.is_finite)
    bad = last.fork()
    bad.advance(1)
    last.seconds = stepper.seconds
    return Divergence(last, _first_not_finite(bad.u, bad.v), before, t_end)


@dataclass(frozen=True)
class BlowUp:
    """A run whose motion stayed finite, but grew by orders of magnitude because of its step.

    The stepper `last` is at the end of the run. `growth` is the size of the motion there, relative to its size at the
    start. It grew after the time `began`, and `why` compares h with the critical step. `limits` are the critical steps
    at the start and at this time.
    """

    last: Stepper
    growth: float
    began: float
    why: str
    limits: list[float]

    @property
    def message(self) -> str:
        """The time and the amount of the growth, and the critical step."""
        last = self.last
        return (
            f"The motion stayed finite up to t = {last.t:g}, but from t = {self.began:g} on it grew to "
            f"{self.growth:.2g} times its size, because of the step h = {last.h:g}: {self.why}."
        )

    def explain(self) -> str:
        """Return the message and, if there are critical steps, a shorter step that was tried."""
        return f"{self.message.rstrip('.')}; {_remedy(self.last, self.limits)}." if self.limits else self.message


def find_blow_up(stepper: Stepper, before: Stepper) -> BlowUp | None:
    """Return a `BlowUp` if a motion grew because of its step, and None if it grew for a physical reason.

    A motion can grow for a physical reason: it leaves an unstable equilibrium, it is in resonance, or it falls freely.
    Then h is below the critical step. If the method is unstable at every step, there is no critical step. The step is
    then the reason only if the motion grew much faster than the linearised system. Whatever the linearised system says,
    the step is the reason if half of it leads to a motion of another size: an unbounded solution has no size.

    `stepper` is at the end of the run, and `before` at a state before the growth.
    """
    start = stepper.restarted(stepper.h)
    sane = last_sane(before, stepper.index, start)
    grows = any(stepper.index * _growth_by_step(at) >= 1 for at in (start, sane, stepper))
    steps, unstable = _critical_steps(start, sane) if grows else ([], "")
    limits = [step.limit for _, step in steps]
    size, growth = _size(stepper), _size(stepper) / (_size(start) or 1.0)
    why = _comparison(stepper, steps) or unstable
    if unstable:
        own_growth = max(_own_rate(start), _own_rate(sane)) * (stepper.t - stepper.t0)
        guilty = math.log(growth) > 2 * own_growth + math.log(_BLOWN_UP)
    else:
        guilty = any(stepper.h > limit for limit in limits)
    if guilty and limits:  # a critical step is wrong where a motion from rest is so small that rhs rounds differences
        guilty = not size / _BLOWN_UP < _size_with(stepper, _SAFETY * min(limits)) < math.inf
    if not guilty:
        half, limits = stepper.h / 2, limits or [stepper.h]
        finer = _size_with(stepper, half)
        guilty = finer > _BLOWN_UP * size or size > _BLOWN_UP * finer
        why = f"its largest u or v at the end is {size:.2g}, and {finer:.2g} with h = {half:g}"
    return BlowUp(stepper, growth, sane.t, why, limits) if guilty else None


def _growth_by_step(stepper: Stepper) -> float:
    """Return the numerical growth in a step of the linearised system, or infinity if it is unknown."""
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            system = linearise_at(stepper, stepper.method)
            return growth_by_step(stepper.method, system, stepper.h)
    except Exception:  # rhs overflows or fails close to this state
        return math.inf


def _size_with(stepper: Stepper, h: float) -> float:
    """Return the size of the motion at the end with another step; NaN if that takes too long, or the run ends early."""
    n_steps = math.ceil((stepper.t - stepper.t0) / h)
    if n_steps > max(_PATIENCE * stepper.index, _LEAST_WORK / (10 + np.size(stepper.u))):
        return math.nan
    trial = stepper.restarted(h)
    try:
        taken = trial.advance(n_steps)
    except Exception:  # rhs failed
        return math.nan
    if not trial.is_finite:
        return math.inf
    return _size(trial) if taken == n_steps else math.nan


def last_sane(before: Stepper, bad_index: int, start: Stepper) -> Stepper:
    """Return a stepper at the last state before step `bad_index` that is less than 1000 times the start.

    If the first step exceeds this, return the state after this step. A short run is repeated up to this state: then the
    result does not depend on `before`, the end of a chunk, whose length depends on the machine.
    """

    def is_sane(stepper: Stepper) -> bool:
        return _size(stepper) < (_BLOWN_UP * _size(start) or _OVERFLOWING)

    if bad_index > _LEAST_WORK / (10 + start.n):
        return _last(before, bad_index, is_sane)
    last, stride = start.fork(), 1
    while last.index + stride < bad_index:
        ahead = last.fork()
        ahead.advance(stride)
        if last.index > 0 and not is_sane(ahead):
            return _last(last, ahead.index, is_sane)
        last, stride = ahead, _STRIDE_GROWTH * stride
    return _last(last, bad_index, is_sane)


def _last(stepper: Stepper, bad_index: int, is_good: Callable[[Stepper], bool]) -> Stepper:
    """Find by bisection the last good state between the step of `stepper` and step `bad_index`."""
    while bad_index - stepper.index > 1:
        middle = stepper.fork()
        middle.advance((bad_index - stepper.index) // 2)
        if is_good(middle):
            stepper = middle
        else:
            bad_index = middle.index
    return stepper


def _own_rate(stepper: Stepper) -> float:
    """Return the largest growth rate of the linearised system, per unit of time; 0.0 if nothing grows."""
    try:
        system = linearise_at(stepper, stepper.method)
    except Exception:  # for example, rhs is not finite close to this state
        return 0.0
    return max(0.0, float(system.rates().real.max()))


def _comparison(last: Stepper, steps: list[tuple[str, CriticalStep]]) -> str:
    """Describe the critical steps; empty if there are none."""
    shown = [f"{x.limit:.4g} {when} (omega = {x.omega_max:.4g}, xi = {x.xi:.2g})" for when, x in steps]
    return f"the critical step of {last.method!r} is {' and '.join(shown)}" if shown else ""


def _critical_steps(start: Stepper, sane: Stepper) -> tuple[list[tuple[str, CriticalStep]], str]:
    """Find the critical steps at the start and at the last state before the growth, each with its time as text.

    Also return the reason why there is no critical step, if the method is unstable at every step; otherwise it is
    empty.
    """
    steps: list[tuple[str, CriticalStep]] = []
    for stepper in (start, sane):
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                step = _critical_step(stepper)
        except NoStableStepError as error:
            return steps, str(error).rstrip(".")
        except Exception:  # nothing limits the step, or rhs overflows or fails close to this state
            continue
        else:
            if steps and abs(step.limit / steps[0][1].limit - 1) < _SAME_LIMIT:
                return [(f"from t = {start.t:g} to {sane.t:g}", step)], ""
            steps.append((f"at t = {stepper.t:g}", step))
    return steps, ""


def _critical_step(stepper: Stepper) -> CriticalStep:
    """Return the critical step at a state.

    A search may take a quarter of a second, and the members of an ensemble often start as the same linear system.
    """
    linear = linearise_at(stepper, stepper.method)
    if stepper.index > 0:
        return of_linear(linear, stepper.method)
    same, known = (linear.K.tobytes(), linear.C.tobytes()), stepper.system.critical_at_start
    if not known or known[0] != same:
        known = stepper.system.critical_at_start = same, of_linear(linear, stepper.method)
    return known[1]


def _culprit(last: Stepper) -> str:
    """Describe a value of rhs that is not finite during the next step; empty if there is none."""
    if _size(last) >= _OVERFLOWING:
        return ""
    for t in (last.t, last.t + last.h / 2, last.t + last.h):
        try:
            a = last.acceleration(t, last.u, last.v)
        except Exception:  # rhs may fail at a time at which the method does not evaluate it
            continue
        if not np.isfinite(a).all():
            value = np.atleast_1d(a)[_first_not_finite(a)]
            return f"rhs gives {value} at t = {t:g}, for the last u and v of the solution"
    return ""


def _size(stepper: Stepper) -> float:
    """Return the largest absolute value of u and v."""
    return float(max(np.abs(stepper.u).max(), np.abs(stepper.v).max()))


def _first_not_finite(*arrays: Any) -> int:
    finite = np.all([np.isfinite(np.atleast_1d(array)) for array in arrays], axis=0)
    return int(np.argmin(finite))


def _remedy(last: Stepper, limits: list[float]) -> str:
    """Name a step with which the run stays bounded up to the time of its failure, or the reason why none is named."""
    end = last.t + last.h
    left = max(_PATIENCE * last.index, _LEAST_WORK / (10 + np.size(last.u)))
    tried = last.h
    for h in _candidates(last.h, limits):
        n_steps = math.ceil((end - last.t0) / h)
        left -= n_steps
        if left < 0:
            return f"h = {h:g} may be stable, but was not tried, because that would take too long"
        if _holds(last.restarted(h), n_steps):
            return f"h = {h:g} was tried and is stable up to then"
        tried = h
    return f"shorter steps down to h = {tried:g} were tried and fail too: the solution itself may be unbounded"


def _candidates(h: float, limits: list[float]) -> list[float]:
    """Return the steps to try, the longest first.

    They are 0.9 times the smaller of h and the largest critical step, successive halves of this step, and 0.9 times the
    shortest critical step.
    """
    longest = _SAFETY * min([h, *([max(limits)] if limits else [])])
    least = min([longest, *(_SAFETY * limit for limit in limits if limit > _BROUGHT_ABOUT * h)])
    halved = [longest / 2**i for i in range(_HALVINGS)]
    return [float(f"{step:.3g}") for step in sorted({*halved, least}, reverse=True)]


def _holds(trial: Stepper, n_steps: int) -> bool:
    """Return whether the motion does not grow much in the second half of a run."""
    try:
        trial.advance(n_steps // 2)
        size = max(_size(trial), _size(trial.restarted(trial.h)))
        taken = trial.advance(n_steps - n_steps // 2)
    except Exception:  # rhs failed
        return False
    return taken == n_steps - n_steps // 2 and trial.is_finite and _size(trial) < _BLOWN_UP * (size or 1.0)
