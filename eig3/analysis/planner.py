"""Find by short pilot runs which method reaches a given accuracy in the shortest time, and with which step."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..callbacks import check_callback
from ..checks import check_method, check_params, check_state
from ..kernels.invariant import invariant_kernel
from ..methods import EIG, LIBRARY, RK8, Method
from ..problem import Problem
from ..solution import Solution
from ..stepper import Stepper

_GUIDE = RK8()
#: The order in which the methods of the library are tried: a good method found early shortens the runs of the others.
_FIRST = ("eig5", "bm6", "eig8", "eig9", "eig10", "eig11", "eig12", "eig13", "eig7", "eig6", "rk8", "rk5", "eig4")
_WEAK_ORDERS = (5, 6, 9, 10)  # without damping, EIG methods of these orders have no limit, but grow at every step
_AIM = 0.8  # aim for this fraction of the requested accuracy
_AGREEMENT = 0.25  # two runs that differ by this fraction of the accuracy give a reference
_AGREEMENT_AT_MOST = 0.05  # runs with a larger relative difference may both be wrong
_GUIDE_SECONDS = 0.3  # time for the runs of RK8 over each part of the span
_SEARCH_SECONDS = 0.8  # time after which no method is tried any more
_SHORT = 0.005  # a run that takes less time, s, is repeated
_PIECES = 8  # of a run, after each of which it is checked
_DIVERGED = 100.0  # a motion that is larger than the reference by this factor is unstable
_LONGEST_TIMED = 0.02  # longest run that measures the time of a step, s
_TIMED_SECONDS = 0.15  # time of the last comparison
_LEAST_GUIDE = 2**26  # work that the runs of RK8 may make in any case
_LEAST_WORK = 2**24  # work that the runs of a method named by the user may make in any case
_CALL = 16  # the work of an evaluation is that for its degrees of freedom and this number
_PARTS = (1, 1 / 8, 1 / 64)  # parts of the span to run
_FEWEST = 61  # fewest steps of a run. A prime number: states at multiples of a period would hide an error of phase
_STATES = 976  # most states at which two runs are compared, 16 times the fewest,
_VALUES = 2**18  # or fewer, so that they have no more values than this
_STEPS_PER_STATE = 16  # fewest steps from one of these states to the next, in a run of many steps
_MOST_RUNS = 24  # of a method
_CONVERGING = 0.2  # from a relative error above this, the error at a smaller step cannot be predicted
_NEAR = 1.06  # the longest step is found to this factor
_SAME = 1.04  # steps closer than this need no run
_ENOUGH = 0.7  # or until the error is at least this fraction of the aim
_STEEP = 2.0  # an error that grows with more than this multiple of its order is one of stability
_SLOW = 2.0  # a method that takes this multiple of the best time is given up
_HOPELESS = 4.0  # a method of no higher order and no fewer evaluations is at most this many times as fast
_CLOSE = 1.6  # methods predicted to take at most this multiple of the shortest time are timed
_IMPLICIT = 2  # fewest evaluations per step of an implicit method
_ROUND_OFF = 1e-6  # an error below this is round-off, if it falls with a power of the step
_STALLED = 0.5  # below this
EXTRAPOLATED = "extrapolated from longer steps"  # the note of a prediction that is rougher than the others
_RULED_OUT = "ruled out: "


@dataclass(frozen=True)
class Prediction:
    """The step at which one method reaches the accuracy, and its cost.

    Attributes
    ----------
    method : Method
    h : float
        The step; NaN if no step is known to reach the accuracy.
    n_steps, evaluations : int
        Number of steps and of evaluations of the right-hand side over the whole span.
    seconds : float
        Time in the kernel over the whole span.
    error : float
        The error expected at h.
    note : str
        Why the accuracy is not reached, why the method was ruled out, or what limits the step; otherwise empty. A
        method that was ruled out before it ran has no step.
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
        """Whether a step is predicted to reach the accuracy."""
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
        Time that the pilot runs and their comparison took, without compilation.
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
                lines.append(f"  {name:<{width}} {'' if p.note.startswith(_RULED_OUT) else 'not reached: '}{p.note}")
        return "\n".join(lines)


def plan(
    problem: Problem,
    accuracy: float,
    *,
    metric: str = "trajectory",
    methods: Sequence[str | Method] | None = None,
) -> Plan:
    """Find the method that reaches an accuracy over the whole span in the shortest time, and its step.

    Parameters
    ----------
    problem : Problem
    accuracy : float
        The largest relative error to allow, above 0 and below 1.
    metric : {"trajectory", "energy"}
        The error is max |u - u(t)| / max |u| over all degrees of freedom for "trajectory", and max |E - E0| / |E0| for
        "energy". For "trajectory", all degrees of freedom should have the same unit or be scaled.
    methods : sequence of str or Method, optional
        The methods to compare. Each of them gets a prediction. If None, all methods of the library are compared, and
        those that cannot be the fastest are ruled out.

    Returns
    -------
    Plan

    Raises
    ------
    TypeError, ValueError
        If an argument is not valid.

    Notes
    -----
    RK8 runs first, each time with twice the steps, until two runs agree to a quarter of the accuracy. The last run is
    the reference: the difference of another run from it is the error of that run. For the metric "energy", each run
    gives its error itself. If RK8 takes too long, the runs cover a part of the span, and each error is extrapolated to
    the whole span by its growth in the part.

    Each method starts with the number of steps that should take as long as the best method so far. From there its
    longest step is searched for, down to 6 %. A method is given up when it would take twice the time of the best one.
    A method is ruled out before it runs, and is then not compiled,

    - by its order and evaluations: if another method takes four times as long as the best one, has at least the same
      order and no more evaluations per step, and is not limited by stability;
    - by its limit: if it is an EIG method, and stability limits an EIG method of a lower grade, which has the longer
      limit, and that method is not the best one;
    - if there is no time left.

    The methods that are close to the fastest are timed at their steps, in turn.

    RK8, and each method that the user names, may take a number of evaluations in any case, so that the load of the
    machine does not decide which methods are stable.
    """
    if not isinstance(problem, Problem):
        raise TypeError(f"problem must be an eig3.Problem, not {type(problem).__name__}.")
    if not (isinstance(accuracy, int | float) and 0 < accuracy < 1):
        raise ValueError(f"accuracy must be a number between 0 and 1, not {accuracy!r}.")
    if metric not in ("trajectory", "energy"):
        raise ValueError(f"metric must be 'trajectory' or 'energy', not {metric!r}.")
    if metric == "energy" and problem.energy is None:
        raise ValueError(f"metric 'energy' needs a problem with an energy, and {problem.name} has none.")
    records = [check_method(method) for method in (_in_order_of_trial() if methods is None else methods)]
    if methods is None and problem.uses_velocity:
        records = [method for method in records if not method.ignores_velocity]
    if not records:
        raise ValueError("methods must name at least one method.")
    pilots = Pilots(problem, metric, _AIM * accuracy)
    guide = pilots.guide()
    if isinstance(guide, str):
        predictions = [_failure(method, guide) for method in records]
    else:
        predictions = _choose(pilots, guide, records) if methods is None else _predict_each(pilots, guide, records)
    predictions.sort(key=lambda p: (not p.reaches, p.seconds))
    return Plan(problem, float(accuracy), metric, tuple(predictions), pilots.spent)


def _in_order_of_trial() -> list[str]:
    return sorted(LIBRARY, key=lambda name: _FIRST.index(name) if name in _FIRST else len(_FIRST))


def _choose(pilots: Pilots, guide: Search, records: list[Method]) -> list[Prediction]:
    """The predictions of the methods that may be the fastest, and the reasons why the others are not."""
    tried: list[Search] = []
    ruled_out = []
    best = guide
    for method in records:
        reason = _ruled_out(pilots, method, tried, best)
        if not reason and tried and pilots.spent > _SEARCH_SECONDS:
            reason = "no time was left to try it"
        if reason:
            ruled_out.append(_failure(method, _RULED_OUT + reason))
            continue
        search = guide if method == guide.method else Search(pilots, method)
        longest = _SLOW * best.seconds
        search.run(best, lambda longest=longest: longest)
        tried.append(search)
        if not search.steps:
            ruled_out.append(
                _failure(method, f"{_RULED_OUT}in {_SLOW:g} times the time of {best.method.label}, {search.verdict}")
            )
        best = min([guide, *tried], key=lambda search: search.seconds)
    return _timed(pilots, [search for search in tried if search.steps]) + ruled_out


def _ruled_out(pilots: Pilots, method: Method, tried: Sequence[Search], best: Search) -> str:
    """Why the method cannot be the fastest; empty if it may be."""
    for search in tried:
        other = search.method
        if search.is_limited:
            graded = isinstance(method, EIG) and isinstance(other, EIG) and other.order not in _WEAK_ORDERS
            if graded and other.order < method.order:
                return f"stability limits its step more than that of {other.label}"
        elif search.follows_order and method.order <= other.order and pilots.evaluations(method) >= search.evaluations:
            factor = search.seconds / best.seconds
            if factor > _HOPELESS:
                return f"{other.label}, of order {other.order}, takes {factor:.2g} times as long as {best.method.label}"
    return ""


def _predict_each(pilots: Pilots, guide: Search, records: list[Method]) -> list[Prediction]:
    """A prediction for every method, from the runs that its share of the time allows."""
    searches = []
    for i, method in enumerate(records):
        search = guide if method == guide.method else Search(pilots, method)
        until = pilots.spent + max(0.0, _SEARCH_SECONDS - pilots.spent) / (len(records) - i)
        search.run(guide, lambda until=until: until - pilots.spent, _LEAST_WORK)
        searches.append(search)
    return _timed(pilots, searches)


def _timed(pilots: Pilots, searches: Sequence[Search]) -> list[Prediction]:
    """The predictions of all methods; those of the fastest have times measured in turn."""
    shortest = min(search.seconds for search in searches)
    close = [s for s in searches if s.steps and s.seconds <= _CLOSE * shortest]
    runs = 0
    until = pilots.spent + _TIMED_SECONDS
    seconds = {id(search): math.inf for search in close}
    while runs < 3 or (len(close) > 1 and pilots.spent < until and runs < 15):
        for search in close:
            seconds[id(search)] = min(seconds[id(search)], pilots.time_of_a_step(search))
        runs += 1
    return [search.predict(seconds.get(id(search))) for search in searches]


@dataclass(frozen=True)
class History:
    """The states of a run, the spacing of their times, and what the run took."""

    u: np.ndarray
    v: np.ndarray
    spacing: float
    seconds: float
    n_rhs: int


@dataclass(frozen=True)
class Run:
    """A pilot run: its steps over the part of the span, its error over the whole span, and its cost of a step."""

    n_steps: int
    error: float  # infinite if the run diverged
    seconds: float = math.nan
    evaluations: float = math.nan


class Pilots:
    """The pilot runs of all methods on one problem.

    Attributes
    ----------
    aim : float
        The error to reach.
    part : float
        The part of the span that is run.
    """

    def __init__(self, problem: Problem, metric: str, aim: float) -> None:
        self.problem, self.aim, self.part = problem, aim, 1.0
        self.span = problem.t_span[1] - problem.t_span[0]
        self._begin = time.perf_counter()
        self._compiled: set[Method] = set()
        self._reference: np.ndarray | None = None
        self._size = math.inf
        self._start: tuple[Any, Any] = problem.u0, problem.v0
        self._energy = None
        if metric == "energy":
            zeros = np.zeros(len(problem.integrals))
            self._start = tuple(np.append(x, zeros) if zeros.size else x for x in self._start)
            self._energy = check_callback(problem.energy, "invariant", check_state(*self._start)[2], "energy")
        most = min(_STATES, max(_FEWEST, _VALUES // np.size(problem.u0)))
        self._states = _FEWEST * 2 ** int(math.log2(most / _FEWEST))

    @property
    def spent(self) -> float:
        """The time since the start, s, without compilation."""
        return time.perf_counter() - self._begin

    def evaluations(self, method: Method) -> int:
        """The evaluations in a step, at least."""
        running = method.for_force(self.problem.uses_velocity, np.size(self.problem.u0))
        return running.evaluations or _IMPLICIT

    def work(self, method: Method, n_steps: float) -> float:
        """The work of a run, in evaluations of one degree of freedom."""
        return n_steps * self.evaluations(method) * (_CALL + np.size(self.problem.u0))

    def guide(self) -> Search | str:
        """Find a reference and the runs of RK8 that lead to it; if there is none, the reason why."""
        shortest = math.inf  # of the steps that were unstable over a longer part
        for self.part in _PARTS:
            search = Search(self, _GUIDE)
            found = self._guide(search)
            stable = [run.n_steps for run in search.runs if math.isfinite(run.error)]
            if stable and shortest < self.part * self.span / stable[0]:
                return "unstable at every step tried"  # over the whole span
            if found:
                return search
            if not stable:
                shortest = self.part * self.span / search.runs[-1].n_steps
        return search.failure

    def _guide(self, search: Search) -> bool:
        """Double the steps of RK8 until the error is known and far below the aim; return whether this is reached."""
        until, work, seconds, n_steps = self.spent + _GUIDE_SECONDS, 0.0, 0.0, _FEWEST
        coarse: History | None = None
        while work + self.work(_GUIDE, n_steps) < _LEAST_GUIDE or self.spent + 2 * seconds < until:
            begin = self.spent
            fine = self._history(_GUIDE, n_steps)
            seconds = self.spent - begin
            work += self.work(_GUIDE, n_steps)
            if fine is None:
                search.add(Run(n_steps, math.inf))
            elif self._energy:
                search.add(self._judged(n_steps, fine))
            elif coarse:
                self._reference, self._size = fine.u, float(np.abs(fine.u).max())
                search.add(self._judged(n_steps // 2, coarse))
            if search.runs and search.runs[-1].error <= min(_AGREEMENT * self.aim, _AGREEMENT_AT_MOST):
                return True
            if search.is_stalled:
                return False
            coarse = fine
            n_steps *= 2
        return False

    def run(self, method: Method, n_steps: int) -> Run:
        """Run a method over the part of the span; a short run twice, because of what else the machine does."""
        history = self._history(method, n_steps)
        if history is None:
            return Run(n_steps, math.inf)
        run = self._judged(n_steps, history)
        again = history.seconds < _SHORT and self._history(method, n_steps)
        return replace(run, seconds=min(run.seconds, again.seconds / n_steps)) if again else run

    def time_of_a_step(self, search: Search) -> float:
        """Seconds, measured at the predicted step."""
        n_steps = search.steps
        count = max(1, min(n_steps, int(_LONGEST_TIMED / search.pace)))
        history = self._advance(search.method, self.span / n_steps, count, _every(self.problem, n_steps))
        return history.seconds / count if history else math.inf

    def multiple(self, n_steps: float) -> int:
        """The number of steps close to `n_steps` with which there are states to compare with the reference."""
        n_steps = max(n_steps, _FEWEST)
        if self._energy:
            return round(n_steps)
        unit = min(self._states, _FEWEST * 2 ** max(0, int(math.log2(n_steps / _STEPS_PER_STATE / _FEWEST))))
        return unit * round(n_steps / unit)

    def _history(self, method: Method, n_steps: int) -> History | None:
        """The states to compare of a run over the part of the span, which has a multiple of the fewest steps."""
        if method not in self._compiled:
            self._compiled.add(method)
            begin = time.perf_counter()
            self._advance(method, 1e-9 * self.span, 1, 1)
            self._begin += time.perf_counter() - begin  # this was compilation
        states = _FEWEST
        while states < self._states and n_steps % (2 * states) == 0:
            states *= 2
        every = max(1, n_steps // self._states) if self._energy else n_steps // states
        return self._advance(method, self.part * self.span / n_steps, n_steps, every)

    def _advance(self, method: Method, h: float, n_steps: int, every: int) -> History | None:
        """Run in several pieces, and stop as soon as the run has diverged, with the result None."""
        t0 = self.problem.t_span[0]
        stepper = Stepper(self.problem.rhs, *self._start, h=h, t0=t0, params=self.problem.params, method=method)
        shape = n_steps // every, *np.shape(stepper.start[0])
        u, v = np.empty(shape), np.empty(shape)
        piece = every * math.ceil(shape[0] / _PIECES) if shape[0] else n_steps
        while stepper.index < n_steps:
            first, count = stepper.index // every, min(piece, n_steps - stepper.index)
            taken = stepper.advance(count, every, u[first:], v[first:])
            if taken < count or not stepper.is_finite or stepper.sizes[0] > _DIVERGED * self._size:
                return None
        return History(u, v, h * every, stepper.seconds, stepper.n_rhs)

    def _judged(self, n_steps: int, history: History) -> Run:
        """The run of this history, with its error extrapolated to the whole span."""
        error, growth = self._energy_error(history) if self._energy else self._trajectory_error(history)
        return Run(n_steps, error * (1 / self.part) ** growth, history.seconds / n_steps, history.n_rhs / n_steps)

    def _trajectory_error(self, history: History) -> tuple[float, float]:
        """The error, and the power of time with which it grows."""
        assert self._reference is not None
        both = math.gcd(len(history.u), len(self._reference))
        u, known = (x[len(x) // both - 1 :: len(x) // both] for x in (history.u, self._reference))
        errors = np.abs(u - known).reshape(both, -1).max(axis=1) / self._size
        error, half = float(errors.max()), float(errors[: both // 2].max())
        return error, min(2.0, max(0.0, math.log2(error / half))) if half > 0 else 1.0

    def _energy_error(self, history: History) -> tuple[float, float]:
        assert self._energy is not None
        u0, v0, form = check_state(*self._start)
        t0, params = self.problem.t_span[0], check_params(self.problem.params)
        start = self._energy.call(t0, u0, v0, params)
        low, high = invariant_kernel(form)(self._energy.address, t0, history.spacing, params, 1, history.u, history.v)
        return float(np.maximum(start - low, high - start)) / abs(start), 1.0


class Search:
    """The search for the longest step with which a method reaches the aim."""

    def __init__(self, pilots: Pilots, method: Method) -> None:
        self.pilots, self.method, self.evaluations = pilots, method, pilots.evaluations(method)
        self.runs: list[Run] = []  # from the fewest steps to the most

    def add(self, run: Run) -> None:
        self.runs = sorted([*self.runs, run], key=lambda run: run.n_steps)

    def run(self, other: Search, longest: Callable[[], float], work: float = 0.0) -> None:
        """Run until the longest step is known, or the next run would take too long.

        The first run takes as long as `other` takes to reach the aim. `longest` returns the seconds that the next run
        may take; a run within the remaining `work` may be made in any case.
        """
        guess = other.pace / other.evaluations * self.evaluations
        n_steps = self._next() if self.runs else other.seconds / guess * self.pilots.part
        while n_steps and len(self.runs) < _MOST_RUNS:
            pace = self.pace if math.isfinite(self.pace) else guess
            most = max(longest() / pace * self.pilots.part, work / self.pilots.work(self.method, 1))
            n_steps = self.pilots.multiple(min(n_steps, most))
            tried = any(run.n_steps <= n_steps < _SAME * run.n_steps for run in self.runs)
            if tried or (self.runs and n_steps > _NEAR * most):
                return
            self.add(self.pilots.run(self.method, n_steps))
            work -= self.pilots.work(self.method, n_steps)
            n_steps = self._next()

    @property
    def pace(self) -> float:
        """Seconds of a step, in the fastest run; infinite if no run was stable."""
        return min((run.seconds for run in self.runs if math.isfinite(run.seconds)), default=math.inf)

    @property
    def _bad(self) -> Run | None:
        """The run with the most steps that does not reach the aim."""
        return next((run for run in reversed(self.runs) if not run.error <= self.pilots.aim), None)

    @property
    def _good(self) -> Run | None:
        """The run with the fewest steps from which on every run reaches the aim."""
        bad = self._bad
        return next((run for run in self.runs if not bad or run.n_steps > bad.n_steps), None)

    def _next(self) -> float | None:
        """The steps of the next run, before they are rounded; None if no run is needed."""
        good, bad, aim = self._good, self._bad, self.pilots.aim
        if not good:
            last = self.runs[-1]
            if self.is_stalled:
                return None
            factor = min(4.0, 1.05 * (last.error / aim) ** (1 / self.order)) if last.error < _CONVERGING else 1.5
            return max(factor, _NEAR) * last.n_steps
        if not bad:
            factor = max(1 / 4, 0.97 * (good.error / aim) ** (1 / self.order))
            return min(factor, 1 / _NEAR) * good.n_steps
        ratio = good.n_steps / bad.n_steps
        if ratio < _NEAR or good.error > _ENOUGH * aim:
            return None
        return self._between(bad, good) if bad.error < _CONVERGING else math.sqrt(ratio) * bad.n_steps

    def _between(self, bad: Run, good: Run) -> float:
        """The steps with which the error is just below the aim, if it is a power of the step."""
        return 1.01 * bad.n_steps * (bad.error / self.pilots.aim) ** (1 / self._slope(bad, good))

    def _slope(self, bad: Run, good: Run) -> float:
        return math.log(bad.error / max(good.error, 1e-300)) / math.log(good.n_steps / bad.n_steps)

    @property
    def order(self) -> float:
        """The order of convergence over the two runs with the most steps, or else that of the method."""
        known = float(self.method.order)
        return min(2 * known, max(known / 2, self._observed)) if self._observed else known

    @property
    def _observed(self) -> float | None:
        converging = [run for run in self.runs if run.error < _CONVERGING][-2:]
        return self._slope(*converging) if len(converging) == 2 else None

    @property
    def follows_order(self) -> bool:
        """Whether the error falls with the step as the order predicts, so that it can be extrapolated."""
        return self._observed is not None and not self.is_limited

    @property
    def is_limited(self) -> bool:
        """Whether stability limits the step: beyond the longest step, the error grows faster than by the order."""
        good, bad = self._good, self._bad
        if good and not bad:
            return False
        slope = self._observed
        if good and bad:
            slope = self._slope(bad, good) if bad.error < _CONVERGING else None
        return slope is None or slope > _STEEP * (self.method.order + 1)

    @property
    def is_stalled(self) -> bool:
        """Whether round-off keeps the error from falling."""
        before = self.runs[-2].error if len(self.runs) > 1 else math.inf
        return before < _ROUND_OFF and (self._observed or 0.0) < _STALLED

    @property
    def steps(self) -> int:
        """The steps over the whole span that reach the aim; 0 if unknown."""
        if self._good:
            n_steps: float = self._good.n_steps
        elif self.runs and self.runs[-1].error < _CONVERGING and not self.is_stalled:
            n_steps = self.runs[-1].n_steps * (self.runs[-1].error / self.pilots.aim) ** (1 / self.order)
        else:
            return 0
        return math.ceil(n_steps / self.pilots.part)

    @property
    def seconds(self) -> float:
        """The predicted time; infinite if unknown."""
        return self.steps * self.pace if self.steps else math.inf

    @property
    def verdict(self) -> str:
        """How the run with the most steps ended."""
        error = self.runs[-1].error
        return f"its error is {error:.1e}" if math.isfinite(error) else "it is unstable"

    @property
    def failure(self) -> str:
        """Why the aim is not reached."""
        stable = [run for run in self.runs if math.isfinite(run.error)]
        if not stable:
            return "unstable at every step tried"
        last = stable[-1]
        if self.is_stalled:
            return f"round-off leaves an error of {last.error:.1e}"
        h = self.pilots.part * self.pilots.span / last.n_steps
        return (
            f"the error does not converge down to h = {h:.2g}, where it is {last.error:.1e} (chaos, or a step still "
            "too long)"
        )

    def predict(self, seconds_of_a_step: float | None) -> Prediction:
        if not self.steps:
            return _failure(self.method, self.failure)
        good = self._good
        cost = min((run for run in self.runs if math.isfinite(run.seconds)), key=lambda run: run.seconds)
        note = "" if good else EXTRAPOLATED
        if good and self.is_limited:
            note = "the step is limited by stability"
        return Prediction(
            method=self.method,
            h=self.pilots.span / self.steps,
            n_steps=self.steps,
            evaluations=round(self.steps * cost.evaluations),
            seconds=self.steps * (seconds_of_a_step or cost.seconds),
            error=good.error if good else self.pilots.aim,
            note=note,
        )


def _failure(method: Method, note: str) -> Prediction:
    return Prediction(method, math.nan, 0, 0, math.inf, math.nan, note)


def _every(problem: Problem, n_steps: int) -> int:
    """The `save_every` with which a run keeps about 2000 states, or fewer of a large system."""
    most = min(2048, max(64, _VALUES // np.size(problem.u0)))
    return 2 ** max(0, (n_steps // most).bit_length() - 1)


def _name(method: Method) -> str:
    """The label of a method, or its record if it is not the one that its name stands for."""
    return method.label if method == check_method(method.name) else repr(method)
