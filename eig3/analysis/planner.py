"""Predict from short pilot runs which method reaches a given accuracy in the shortest time, and with which step."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..checks import check_method
from ..methods import LIBRARY, Method
from ..problem import Problem
from ..solution import Solution
from .critical import longest_stable_step
from .linear import Linearised, linearise

PILOT_SECONDS = 1.0  # time of all pilot runs together, not counting the search for stable runs
_VALUES = 2**18  # largest number of values in the states at which two runs are compared
_FIRST_STEPS = 64  # fewest steps of a pilot run
_BELOW_CRITICAL = 0.95  # first step of the pilot runs, as a fraction of the critical step
_LONGEST = 4.0  # longest first step in radians of the fastest mode: beyond the stability limit of every explicit method
_PROJECTED = 8  # directions of each of three kinds on which a critical step is accurate enough to start from
_REFINED = 64  # the search for a stable run takes at most this multiple of the steps of the first run,
_EVALUATED = 2**24  # or, if that is more, steps with this number of evaluations of one degree of freedom
_LEAST_EVALUATED = 2**20  # evaluations of one degree of freedom that the runs of a method may make in any case
_SOLVED = 4  # estimated evaluations per step of an implicit method
_MOST_EVALUATED = 2**25  # if the first run needs more evaluations of one degree of freedom, take a part of the span
_SAFETY = 0.7  # aim for this fraction of the requested accuracy
_ORDER_TOLERANCE = 0.4  # largest difference between observed and known order of an error that follows the order
_UNSTABLE = 5.0  # a relative error above this means that the run is unstable
_CONVERGING = 0.2  # from a relative error above this, the error at a smaller step cannot be predicted
_NEAR = 10  # an error below this multiple of the accuracy is extrapolated to the accuracy
_BISECTIONS = 3  # narrow down the longest stable step from a factor of 2 to a factor of 2^(1/8) = 1.09
_LAST_TRIALS = 12  # largest number of runs of the whole span, each with 1.2 times the steps of the one before
_PARTS = (1, 1 / 8, 1 / 64)  # parts of the span to run
_FURTHEST = 1e4  # largest ratio of the step of a pilot run to the step that is extrapolated from it
_TIMED_SECONDS = 0.02  # length of each of three runs that measure the time of a step
_ROUND_OFF = 1e-13  # a relative error that round-off may prevent


@dataclass(frozen=True)
class Prediction:
    """The step at which one method reaches the accuracy, and its cost.

    Attributes
    ----------
    method : Method
    h : float
        The step; NaN if no step is predicted to reach the accuracy.
    n_steps, evaluations : int
        Number of steps and of evaluations of the right-hand side over the whole span.
    seconds : float
        Time in the kernel over the whole span.
    error : float
        The error expected at h.
    note : str
        Why the accuracy is not reached, or why the error is well below it; otherwise empty.
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
    """Predictions for several methods, the fastest first.

    Attributes
    ----------
    problem : Problem
    accuracy : float
    metric : {"trajectory", "energy"}
    predictions : tuple of Prediction
    pilot_seconds : float
        Time that the pilot runs took, without compilation.
    """

    problem: Problem
    accuracy: float
    metric: str
    predictions: tuple[Prediction, ...]
    pilot_seconds: float

    @property
    def best(self) -> Prediction:
        """The prediction of the fastest method.

        Raises
        ------
        ValueError
            If no method is predicted to reach the accuracy.
        """
        if not self.predictions[0].reaches:
            reasons = "; ".join(f"{p.method.label}: {p.note}" for p in self.predictions)
            raise ValueError(f"accuracy {self.accuracy:g} is not reached by any method of this plan ({reasons}).")
        return self.predictions[0]

    def run(self, **options: Any) -> Solution:
        """Integrate with the method and the step of `best`.

        `options` are those of `Problem.integrate`. By default about 2000 states are kept, fewer for a large system, and
        the energy is computed only if it is the metric.
        """
        best = self.best
        options.setdefault("save_every", _every(self.problem, best.n_steps))
        if self.metric == "trajectory":
            options.setdefault("invariants", {})
        return self.problem.integrate(h=best.h, method=best.method, **options)

    def __repr__(self) -> str:
        names = [_name(p.method) for p in self.predictions]
        width = max(14, *map(len, names))
        lines = [
            f"Plan for {self.problem.name}: {self.metric} error {self.accuracy:g} up to t = "
            f"{self.problem.t_span[1]:g} (pilot runs: {self.pilot_seconds:.2g} s)",
            f"  {'method':<{width}} {'h':>9} {'steps':>9} {'evaluations':>12} {'seconds':>9} {'error':>8}",
        ]
        for name, p in zip(names, self.predictions, strict=True):
            if p.reaches:
                numbers = f"{p.h:>9.3g} {p.n_steps:>9.3g} {p.evaluations:>12.3g} {p.seconds:>9.3g} {p.error:>8.1e}"
                lines.append(f"  {name:<{width}} {numbers}" + f"  {p.note}" * bool(p.note))
            else:
                lines.append(f"  {name:<{width}} not reached: {p.note}")
        return "\n".join(lines)


def plan(
    problem: Problem,
    accuracy: float,
    *,
    metric: str = "trajectory",
    methods: Sequence[str | Method] | None = None,
) -> Plan:
    """Find the step at which each method reaches an accuracy over the whole span, and the time that it takes.

    Parameters
    ----------
    problem : Problem
    accuracy : float
        The largest relative error to allow, above 0 and below 1.
    metric : {"trajectory", "energy"}
        The error is max |u - u(t)| / max |u| over all degrees of freedom for "trajectory", and max |E - E0| / |E0| for
        "energy". For "trajectory", all degrees of freedom should have the same unit or be scaled.
    methods : sequence of str or Method, optional
        The methods to compare; all methods of the library if None.

    Returns
    -------
    Plan

    Raises
    ------
    TypeError, ValueError
        If an argument is not valid.

    Notes
    -----
    The first pilot run of a method has a step just below the critical step at the start of the span. If there is no
    critical step, it has a step that is too long for every method. The step is halved until a run is stable. This
    search is limited by a number of steps, not by time, so that the load of the machine does not decide which methods
    are stable.

    Then the step is halved until two runs of the whole span differ as the order of the method predicts. If the method's
    share of one second does not allow that, the runs are repeated over a part of the span, and the error is
    extrapolated to the whole span by its growth in the part. The error of a run is its difference from the run at half
    its step, times 2^p / (2^p - 1) for the order p (Richardson).
    """
    if not isinstance(problem, Problem):
        raise TypeError(f"problem must be an eig3.Problem, not {type(problem).__name__}.")
    if not (isinstance(accuracy, int | float) and 0 < accuracy < 1):
        raise ValueError(f"accuracy must be a number between 0 and 1, not {accuracy!r}.")
    if metric not in ("trajectory", "energy"):
        raise ValueError(f"metric must be 'trajectory' or 'energy', not {metric!r}.")
    if metric == "energy" and problem.energy is None:
        raise ValueError(f"metric 'energy' needs a problem with an energy, and {problem.name} has none.")
    records = [check_method(method) for method in (LIBRARY if methods is None else methods)]
    if methods is None and problem.uses_velocity:
        records = [method for method in records if not method.ignores_velocity]
    if not records:
        raise ValueError("methods must name at least one method.")
    predictions, spent, system = [], 0.0, _linearised(problem)
    for i, method in enumerate(records):
        longest = _longest_step(system, method)
        budget = max(PILOT_SECONDS / len(records), (PILOT_SECONDS - spent) / (len(records) - i))
        pilot = Pilot(problem, method, metric, longest, budget)
        predictions.append(pilot.predict(accuracy))
        spent += pilot.spent
    predictions.sort(key=lambda p: (not p.reaches, p.seconds))
    return Plan(problem, float(accuracy), metric, tuple(predictions), spent)


@dataclass
class _Run:
    """A pilot run over a part of the span, and its error, which is NaN until the run with half its step is made."""

    n_steps: int
    solution: Solution
    error: float = math.nan
    growth: float = 1.0  # the error grows as this power of time


@dataclass
class Pilot:
    """The pilot runs of one method, from the step `longest` down.

    `budget`, s, limits how often the step is halved after the first stable run. A small number of evaluations, which
    take some milliseconds on an idle machine, is made in any case.
    """

    problem: Problem
    method: Method
    metric: str
    longest: float
    budget: float
    spent: float = 0.0
    evaluated: int = 0  # evaluations of one degree of freedom
    part: float = 1.0
    unstable: int = 0  # the largest number of steps over the part with which a run diverged
    runs: list[_Run] = field(default_factory=list)

    def predict(self, accuracy: float) -> Prediction:
        self._integrate(1, self.problem.t_span[0] + self._span * 1e-9)  # compiles
        self.spent, self.evaluated = 0.0, 0
        for part in _PARTS:
            self.part, self.unstable, self.runs = part, 0, []
            if part != _PARTS[-1] and self._first_steps() * self._evaluations > _MOST_EVALUATED:
                continue
            if self._halve(accuracy) or not self._judged:
                break
            self.longest = self.runs[0].solution.h
        return self._conclude(accuracy)

    @property
    def _span(self) -> float:
        return self.problem.t_span[1] - self.problem.t_span[0]

    @property
    def _evaluations(self) -> int:
        """Evaluations of one degree of freedom in a step."""
        return (self.method.evaluations or _SOLVED) * int(np.size(self.problem.u0))

    def _first_steps(self) -> int:
        """The steps of the first run: a multiple of a power of 2, so that a saved state is at the end of the part."""
        needed = max(float(_FIRST_STEPS), self.part * self._span / self.longest)
        unit = 2 ** math.floor(math.log2(needed / _FIRST_STEPS))
        return unit * math.ceil(needed / unit)

    def _halve(self, accuracy: float) -> bool:
        """Halve the step until the error is small or follows the order; return whether this is reached.

        Until the error of a stable run is known, only the number of steps is limited. After that, the time is limited.
        """
        n_steps = self._first_steps()
        most = max(_REFINED * n_steps, _EVALUATED // self._evaluations)
        while not self._judged:
            if n_steps > most:
                return False
            begin = self.spent
            self._run(n_steps)
            n_steps *= 2
        until = self.spent + self.budget / len(_PARTS)
        while True:
            conclusive = self._is_conclusive(accuracy)
            if conclusive and self._whole(self._judged[-1]) <= _NEAR * accuracy:
                return True
            if self.evaluated > _LEAST_EVALUATED and self.spent + 2.2 * (self.spent - begin) > until:
                return conclusive
            begin = self.spent
            self._run(n_steps)
            if not self._judged:  # a shorter step diverged
                return False
            n_steps *= 2

    def _run(self, n_steps: int) -> None:
        solution = self._integrate(n_steps, self.problem.t_span[0] + self.part * self._span)
        if not solution.success:
            self.unstable = max(self.unstable, n_steps)
            self.runs = []
            return
        run = _Run(n_steps, solution)
        if self.metric == "energy":
            run.error = solution.drift["energy"] / abs(self.problem.energy_of(self.problem.u0, self.problem.v0))
        elif self.runs:
            self._judge(self.runs[-1], run)
            if not self.runs[-1].error < _UNSTABLE:  # it was still finite at the end
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
        self.evaluated += solution.n_rhs * np.size(self.problem.u0)
        return solution

    def _judge(self, coarse: _Run, fine: _Run) -> None:
        every = max(1, (len(fine.solution.u) - 1) // (len(coarse.solution.u) - 1))
        u_coarse, u_fine = coarse.solution.u, fine.solution.u
        difference = np.abs(u_coarse - u_fine[::every])
        size = self._size(fine.solution)
        errors = difference.reshape(len(difference), -1).max(axis=1) / size
        gain = 2.0**self.method.order
        coarse.error = float(errors.max()) * gain / (gain - 1)
        half = float(errors[: len(errors) // 2 + 1].max())
        coarse.growth = min(2.0, max(0.0, math.log2(errors.max() / half))) if half > 0 else 1.0

    def _size(self, solution: Solution) -> float:
        return float(np.abs(solution.u).max())

    @property
    def _judged(self) -> list[_Run]:
        return [run for run in self.runs if math.isfinite(run.error)]

    def _order(self) -> float:
        """The order of convergence over the last two runs; NaN if there are not two, 0 if the error does not fall."""
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
            return not excess > 3 * _ORDER_TOLERANCE  # an error that falls faster changes sign, and grows again
        return abs(excess) < _ORDER_TOLERANCE

    def _order_of_metric(self) -> float:
        # The energy error of a Runge-Kutta method can have one order more than the method.
        order = self._order()
        return float(self.method.order) if self.metric == "trajectory" else max(float(self.method.order), order)

    def _whole(self, run: _Run) -> float:
        """The error of a run at the end of the whole span."""
        return run.error * (1 / self.part) ** run.growth

    def _conclude(self, accuracy: float) -> Prediction:
        judged = self._judged
        if not judged:
            return self._failure("unstable at every step tried")
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
        if self._whole(coarse) > _CONVERGING:  # the error is not a power of h between the two runs
            fraction = 1 - math.log2(aim / self._whole(fine)) / self.method.order
        else:
            fraction = math.log(self._whole(coarse) / aim) / math.log(self._whole(coarse) / self._whole(fine))
        return coarse.n_steps * 2 ** min(1.0, max(0.0, fraction))

    def _extrapolated(self, run: _Run, aim: float) -> Prediction:
        if aim < _ROUND_OFF:
            return self._failure("the accuracy is below round-off")
        smaller = (self._whole(run) / aim) ** (1 / self._order())
        if smaller > _FURTHEST:
            return self._failure(f"it needs a step more than {_FURTHEST:g} times shorter than in the pilot runs")
        return self._at(run.n_steps * smaller, aim)

    def _limited_by_stability(self, run: _Run, aim: float) -> Prediction:
        """The first stable run is accurate enough: find the longest stable step, between its step and twice that."""
        low, high = self.unstable or run.n_steps // 2, run.n_steps
        largest = _UNSTABLE * self._size(run.solution)
        for _ in range(_BISECTIONS):
            middle = round(math.sqrt(low * high))
            solution = self._integrate(middle, self.problem.t_span[0] + self.part * self._span)
            stable = solution.success and self._size(solution) < largest
            low, high = (low, middle) if stable else (middle, high)
        if self.part < 1:
            high = self._stable_over_the_span(high, largest)
            if high == 0:
                return self._failure("unstable over the whole span at every step tried")
        error = self._whole(run) * (run.n_steps / high) ** self.method.order
        needed = run.n_steps * (self._whole(run) / aim) ** (1 / self.method.order)
        if needed >= high:
            return self._at(needed, aim)
        return self._at(1.02 * high, error, "the step is limited by stability")

    def _stable_over_the_span(self, n_steps: int, largest: float) -> int:
        """Steps over the part with which the whole span is stable; 0 if no number tried is enough.

        The growth of RK2 and AB2 may be too small to be seen in a part of the span.
        """
        for _ in range(_LAST_TRIALS):
            solution = self._integrate(round(n_steps / self.part), self.problem.t_span[1])
            if solution.success and self._size(solution) < largest:
                return n_steps
            n_steps = math.ceil(1.2 * n_steps)
        return 0

    def _at(self, n_steps: float, error: float, note: str = "") -> Prediction:
        """The prediction for a number of steps over the part."""
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
        """Seconds and evaluations of a step: the fastest of three short runs at the step of the whole run."""
        last = self.runs[-1].solution
        count = min(total, max(1, int(_TIMED_SECONDS * last.n_steps / last.kernel_seconds)))
        every = _every(self.problem, total)  # the run keeps as many
        h = self._span / total
        runs = [self._integrate(count, self.problem.t_span[0] + count * h, every) for _ in range(3)]
        seconds = min(run.kernel_seconds / run.n_steps for run in runs)
        return seconds, runs[0].n_rhs / runs[0].n_steps

    def _failure(self, note: str) -> Prediction:
        return Prediction(self.method, math.nan, 0, 0, math.inf, math.nan, note)


def _every(problem: Problem, n_steps: int) -> int:
    """The `save_every` with which comparing two runs takes less time than the runs.

    It is a power of 2, so that a run with twice the steps keeps the states at the same times.
    """
    most = min(2048, max(64, _VALUES // np.size(problem.u0)))
    return 2 ** max(0, (n_steps // most).bit_length() - 1)


def _linearised(problem: Problem) -> Linearised | None:
    """The problem linearised at its start, on few directions; None if rhs is not finite close to it."""
    stepper = problem.stepper(h=1.0, method="rk4")
    try:
        system = linearise(stepper.acceleration, stepper.t, stepper.u, stepper.v)
    except ValueError:
        return None
    return system if len(system.K) <= 3 * _PROJECTED else system.fastest(_PROJECTED)


def _longest_step(system: Linearised | None, method: Method) -> float:
    """The step of the first pilot run; infinite if nothing limits it."""
    if system is None:
        return math.inf
    fastest = float(np.abs(system.rates()).max())
    longest = _LONGEST / fastest if fastest > 0 else math.inf
    limit, _, _ = longest_stable_step(method, system)
    return min(_BELOW_CRITICAL * limit, longest) if limit > 0 else longest


def _name(method: Method) -> str:
    """The label of a method, or its record if it is not the one that its name stands for."""
    return method.label if method == check_method(method.name) else repr(method)
