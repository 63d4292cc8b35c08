"""Predict from short pilot runs which method reaches an accuracy soonest, and at what step."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..methods import METHODS, CentralDifference, Method
from ..problem import Problem
from ..solution import Solution, Status
from .linear import linearise

PILOT_SECONDS = 1.0  # of all pilot runs together
_VALUES = 2**18  # of the states at which two runs are compared
_LARGE = 50  # degrees of freedom, with which differences for Newton's method cost more than they can win
_FIRST_STEPS = 64
_SAFETY = 0.7  # of the accuracy asked for is aimed at
_ORDER_TOLERANCE = 0.4  # between the order of a method and that seen, where its error is taken to follow the order
_UNSTABLE = 5.0  # a relative error that is that of an unstable run
_CONVERGING = 0.2  # relative errors above this say nothing of those at smaller steps
_NEAR = 10  # times the accuracy: from there an error is extrapolated without looking further
_LAST_TRIALS = 12
_PARTS = (1, 1 / 8, 1 / 64)  # of the span
_FURTHEST = 1e4  # times smaller than a pilot's step: what its error is extrapolated to at most
_TIMED_SECONDS = 0.02  # of each of three runs that tell the time of a step
_ROUND_OFF = 1e-13  # a relative error no step goes below for certain


@dataclass(frozen=True)
class Prediction:
    """What one method needs.

    Attributes
    ----------
    method : Method
    h : float
        The step; NaN where no step is predicted to reach the accuracy.
    n_steps, evaluations : int
        Of the whole span.
    seconds : float
        In the kernel, over the whole span.
    error : float
        The error expected at h.
    note : str
        Why the accuracy is not reached, or why the error is well below it; else empty.
    """

    method: Method
    h: float
    n_steps: int
    evaluations: int
    seconds: float
    error: float
    note: str = ""

    @property
    def reaches(self) -> bool:
        """Whether the accuracy is predicted to be reached."""
        return math.isfinite(self.h)


@dataclass(frozen=True)
class Plan:
    """Predictions for every method, the fastest first.

    Attributes
    ----------
    problem : Problem
    accuracy : float
    metric : {"trajectory", "energy"}
    predictions : tuple of Prediction
    pilot_seconds : float
        What the pilot runs took, without compiling.
    """

    problem: Problem
    accuracy: float
    metric: str
    predictions: tuple[Prediction, ...]
    pilot_seconds: float

    @property
    def best(self) -> Prediction:
        """The fastest.

        Raises
        ------
        ValueError
            Where no method is predicted to reach the accuracy.
        """
        if not self.predictions[0].reaches:
            reasons = "; ".join(f"{p.method.label}: {p.note}" for p in self.predictions)
            raise ValueError(f"accuracy {self.accuracy:g} is not reached by any method of this plan ({reasons}).")
        return self.predictions[0]

    def run(self, **options: Any) -> Solution:
        """Integrate as `best` says.

        `options` are those of `Problem.integrate`. If they do not say else, some 2000 states are kept, fewer of large
        systems, and the energy is followed only where it is the metric.
        """
        best = self.best
        options.setdefault("save_every", _every(self.problem, best.n_steps))
        if self.metric == "trajectory":
            options.setdefault("invariants", {})
        return self.problem.integrate(h=best.h, method=best.method, **options)

    def __repr__(self) -> str:
        lines = [
            f"Plan for {self.problem.name}: {self.metric} error {self.accuracy:g} up to t = "
            f"{self.problem.t_span[1]:g} (pilot runs: {self.pilot_seconds:.2g} s)",
            f"  {'method':<14} {'h':>9} {'steps':>9} {'evaluations':>12} {'seconds':>9} {'error':>8}",
        ]
        for p in self.predictions:
            if p.reaches:
                numbers = f"{p.h:>9.3g} {p.n_steps:>9.3g} {p.evaluations:>12.3g} {p.seconds:>9.3g} {p.error:>8.1e}"
                lines.append(f"  {_name(p.method):<14} {numbers}" + f"  {p.note}" * bool(p.note))
            else:
                lines.append(f"  {_name(p.method):<14} not reached: {p.note}")
        return "\n".join(lines)


def plan(
    problem: Problem,
    accuracy: float,
    *,
    metric: str = "trajectory",
    methods: Sequence[str | Method] | None = None,
) -> Plan:
    """Find the step at which each method reaches an accuracy over the whole span, and what it will take.

    Parameters
    ----------
    problem : Problem
    accuracy : float
        The relative error to reach: max |u - u(t)| / max |u| over all degrees of freedom (scale mixed units), or
        max |E - E0| / |E0|.
    metric : {"trajectory", "energy"}
    methods : sequence of str or Method, optional
        All by name if None. On a large system "cd" by name solves by fixed-point iteration.

    Returns
    -------
    Plan

    Raises
    ------
    TypeError, ValueError
        For bad arguments.

    Notes
    -----
    Each method is run with its step halved until two runs of the whole span differ as its order says, or its share of
    a second is spent; then of a part of the span, with the error continued as it grew in the part. The error of a run
    is that from the run at half its step, times 2^p / (2^p - 1) for the order p (Richardson).
    """
    if not isinstance(problem, Problem):
        raise TypeError(f"problem must be an eig3.Problem, not {type(problem).__name__}.")
    if not (isinstance(accuracy, int | float) and 0 < accuracy < 1):
        raise ValueError(f"accuracy must be a number between 0 and 1, not {accuracy!r}.")
    if metric not in ("trajectory", "energy"):
        raise ValueError(f"metric must be 'trajectory' or 'energy', not {metric!r}.")
    if metric == "energy" and problem.energy is None:
        raise ValueError(f"metric 'energy' needs a problem with an energy, and {problem.name} has none.")
    records = [_record(problem, method) for method in (METHODS if methods is None else methods)]
    if not records:
        raise ValueError("methods must name one method at least.")
    predictions, spent, omega = [], 0.0, _fastest(problem)
    for i, method in enumerate(records):
        pilot = Pilot(problem, method, metric, omega, (PILOT_SECONDS - spent) / (len(records) - i))
        predictions.append(pilot.predict(accuracy))
        spent += pilot.spent
    predictions.sort(key=lambda p: (not p.reaches, p.seconds))
    return Plan(problem, float(accuracy), metric, tuple(predictions), spent)


@dataclass
class _Run:
    """A pilot run: its steps over the part of the span, and its error once a run of half the step is known."""

    n_steps: int
    solution: Solution
    error: float = math.nan
    growth: float = 1.0  # of the error: as this power of time


@dataclass
class Pilot:
    """The pilot runs of one method, within `budget` seconds."""

    problem: Problem
    method: Method
    metric: str
    omega: float
    budget: float
    spent: float = 0.0
    part: float = 1.0
    unstable: int = 0  # the most steps over the part with which a run diverged
    runs: list[_Run] = field(default_factory=list)

    def predict(self, accuracy: float) -> Prediction:
        self._integrate(1, self.problem.t_span[0] + self._span * 1e-9)  # compiles, unless that has been done
        self.spent = 0.0
        share = self.budget / len(_PARTS)
        for i, part in enumerate(_PARTS):
            self.part, self.unstable, self.runs = part, 0, []
            if self._halve(accuracy, (i + 1) * share if i < len(_PARTS) - 1 else self.budget):
                break
        return self._conclude(accuracy)

    @property
    def _span(self) -> float:
        return self.problem.t_span[1] - self.problem.t_span[0]

    def _halve(self, accuracy: float, until: float) -> bool:
        """Run at halved steps until the error follows the order or is small enough; whether one of the two came."""
        radians = self.omega * self.part * self._span  # a step of four is unstable with every method
        n_steps = _FIRST_STEPS * 2 ** max(0, math.ceil(math.log2(max(radians / 4, 1.0) / _FIRST_STEPS)))
        while True:
            begin = self.spent
            self._run(n_steps)
            conclusive = self._is_conclusive(accuracy)
            if conclusive and self._whole(self._judged[-1]) <= _NEAR * accuracy:
                return True
            if self.spent + 2.2 * (self.spent - begin) > until:
                return conclusive
            n_steps *= 2

    def _run(self, n_steps: int) -> None:
        solution = self._integrate(n_steps, self.problem.t_span[0] + self.part * self._span)
        if solution.status is Status.INTERRUPTED:
            raise KeyboardInterrupt
        if not solution.success:
            self.unstable = max(self.unstable, n_steps)
            self.runs = []
            return
        run = _Run(n_steps, solution)
        if self.metric == "energy":
            run.error = solution.drift["energy"] / abs(self.problem.energy_of(self.problem.u0, self.problem.v0))
        elif self.runs:
            self._judge(self.runs[-1], run)
            if not self.runs[-1].error < _UNSTABLE:  # on its way to infinity, which it did not reach in time
                self.unstable = self.runs[-1].n_steps
                self.runs = []
        self.runs.append(run)

    def _integrate(self, n_steps: int, t_end: float, every: int = 0) -> Solution:
        begin = time.perf_counter()
        every = every or _every(self.problem, n_steps)
        h = (t_end - self.problem.t_span[0]) / n_steps
        watched: dict[str, Any] = {"invariants": {}} if self.metric == "trajectory" else {}
        solution = self.problem.integrate(h=h, method=self.method, t_end=t_end, save_every=every, **watched)
        self.spent += time.perf_counter() - begin
        return solution

    def _judge(self, coarse: _Run, fine: _Run) -> None:
        every = max(1, (len(fine.solution.u) - 1) // (len(coarse.solution.u) - 1))
        u_coarse, u_fine = coarse.solution.u, fine.solution.u
        difference = np.abs(u_coarse - u_fine[::every])
        size = float(np.abs(u_fine).max())
        errors = difference.reshape(len(difference), -1).max(axis=1) / size
        gain = 2.0**self.method.order
        coarse.error = float(errors.max()) * gain / (gain - 1)
        half = float(errors[: len(errors) // 2 + 1].max())
        coarse.growth = min(2.0, max(0.0, math.log2(errors.max() / half))) if half > 0 else 1.0

    @property
    def _judged(self) -> list[_Run]:
        return [run for run in self.runs if math.isfinite(run.error)]

    def _order(self) -> float:
        """The order that the last two errors show; NaN without two, 0 where the error no longer falls."""
        if len(self._judged) < 2:
            return math.nan
        before, last = (run.error for run in self._judged[-2:])
        return max(0.0, math.log2(before / last)) if last > 0 else float(self.method.order)

    def _is_conclusive(self, accuracy: float) -> bool:
        judged = self._judged
        if not judged or judged[-1].error > _CONVERGING:
            return False
        excess = self._order() - self._order_of_metric()
        if self._whole(judged[-1]) <= _SAFETY * accuracy:
            return not excess > 3 * _ORDER_TOLERANCE  # an error that falls faster passes through zero, and comes back
        return abs(excess) < _ORDER_TOLERANCE

    def _order_of_metric(self) -> float:
        # the energy error of a Runge-Kutta method of odd order, or of even order by dissipation, is one order better
        order = self._order()
        return float(self.method.order) if self.metric == "trajectory" else max(float(self.method.order), order)

    def _whole(self, run: _Run) -> float:
        """The error of a run at the end of the whole span."""
        return run.error * (1 / self.part) ** run.growth

    def _conclude(self, accuracy: float) -> Prediction:
        judged = self._judged
        if not judged:
            return self._failure("unstable at every step tried" if self.unstable else "no step tried in a second tells")
        if not self._is_conclusive(accuracy):
            stalled = judged[-1].error < 1e-6 and self._order() < 0.5
            return self._failure(
                f"round-off leaves an error of {judged[-1].error:.1e}"
                if stalled
                else f"the error does not converge down to h = {judged[-1].solution.h:.2g}, where it is "
                f"{judged[-1].error:.1e} (chaos, or a step still too long)"
            )
        aim = _SAFETY * accuracy
        if self._whole(judged[-1]) > aim:
            return self._extrapolated(judged[-1], aim)
        above = [i for i, run in enumerate(judged) if self._whole(run) > aim]
        i = above[-1] + 1 if above else 0
        fine = judged[i]
        if i == 0:
            return self._limited_by_stability(fine, aim)
        return self._at(self._between(judged[i - 1], fine, aim), aim)

    def _between(self, coarse: _Run, fine: _Run, aim: float) -> float:
        if self._whole(coarse) > _CONVERGING:  # no power of h between the two
            fraction = 1 - math.log2(aim / self._whole(fine)) / self.method.order
        else:
            fraction = math.log(self._whole(coarse) / aim) / math.log(self._whole(coarse) / self._whole(fine))
        return coarse.n_steps * 2 ** min(1.0, max(0.0, fraction))

    def _extrapolated(self, run: _Run, aim: float) -> Prediction:
        if aim < _ROUND_OFF:
            return self._failure("it is below round-off")
        smaller = (self._whole(run) / aim) ** (1 / self._order())
        if smaller > _FURTHEST:
            return self._failure(f"it needs a step more than {_FURTHEST:g} times below that of the pilot runs")
        return self._at(run.n_steps * smaller, aim)

    def _limited_by_stability(self, run: _Run, aim: float) -> Prediction:
        """The longest step that ran is accurate enough: look between it and twice it for the longest that is stable."""
        low, high = self.unstable or run.n_steps // 2, run.n_steps
        largest = _UNSTABLE * np.abs(run.solution.u).max()
        while high / low > 1.1 and self.spent < self.budget:
            middle = round(math.sqrt(low * high))
            solution = self._integrate(middle, self.problem.t_span[0] + self.part * self._span)
            stable = solution.success and np.abs(solution.u).max() < largest
            low, high = (low, middle) if stable else (middle, high)
        if self.part < 1:
            high = self._stable_over_the_span(high, largest)
        error = self._whole(run) * (run.n_steps / high) ** self.method.order
        needed = run.n_steps * (self._whole(run) / aim) ** (1 / self.method.order)
        if needed >= high:
            return self._at(needed, aim)
        return self._at(1.02 * high, error, "the step is limited by stability")

    def _stable_over_the_span(self, n_steps: int, largest: float) -> int:
        """The growth of RK2 and AB2 may not show in a part of the span: try the whole, with steps ever shorter."""
        for _ in range(_LAST_TRIALS):
            solution = self._integrate(round(n_steps / self.part), self.problem.t_span[1])
            if solution.success and np.abs(solution.u).max() < largest:
                break
            n_steps = math.ceil(1.2 * n_steps)
        return n_steps

    def _at(self, n_steps: float, error: float, note: str = "") -> Prediction:
        """The prediction for so many steps over the part."""
        total = math.ceil(n_steps / self.part)
        seconds, evaluations = self._cost_of_a_step(total)
        return Prediction(
            method=self.method,
            h=self._span / total,
            n_steps=total,
            evaluations=round(total * evaluations),
            seconds=total * seconds,
            error=error,
            note=note,
        )

    def _cost_of_a_step(self, total: int) -> tuple[float, float]:
        """Seconds, the least of three runs at the step of the whole run, and evaluations."""
        last = self.runs[-1].solution
        count = min(total, max(1, int(_TIMED_SECONDS * last.n_steps / last.kernel_seconds)))
        every = _every(self.problem, total)  # as the run will keep them
        h = self._span / total
        runs = [self._integrate(count, self.problem.t_span[0] + count * h, every) for _ in range(3)]
        seconds = min(run.kernel_seconds / run.n_steps for run in runs)
        return seconds, runs[0].n_rhs / runs[0].n_steps

    def _failure(self, note: str) -> Prediction:
        return Prediction(self.method, math.nan, 0, 0, math.inf, math.nan, note)


def _every(problem: Problem, n_steps: int) -> int:
    """Keep so many states that two runs can be compared without the comparison taking longer than they do."""
    most = min(2048, max(64, _VALUES // np.size(problem.u0)))
    return 2 ** max(0, (n_steps // most).bit_length() - 1)  # the states of runs with twice the steps then coincide


def _fastest(problem: Problem) -> float:
    """The highest rate of vibration or decay at the start, in rad by unit of time."""
    stepper = problem.stepper(h=1.0, method="rk4")
    try:
        system = linearise(stepper.acceleration, stepper.t, stepper.u, stepper.v)
    except ValueError:  # rhs is not finite on one side of the start: no more than where to begin is lost
        return 0.0
    return float(np.abs(system.rates()).max())


def _record(problem: Problem, method: str | Method) -> Method:
    record = problem.method(method)
    large = problem.uses_velocity and np.size(problem.u0) > _LARGE
    if large and isinstance(method, str) and isinstance(record, CentralDifference):
        return CentralDifference(solver="fixed-point")
    return record


def _name(method: Method) -> str:
    solver = getattr(method, "solver", None)
    return f"{method.label}, {solver}" if solver == "fixed-point" else method.label
