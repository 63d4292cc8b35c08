"""Find the fastest method for a given accuracy, and its step or tolerance, by short pilot runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ..functions.checks import check_method, check_params
from ..functions.companions import constraints_of
from ..kernels.compile.interrupt import with_solution
from ..keywords import with_suggestions
from ..methods import EIG, LIBRARY, Method
from ..notebook import grid
from ..problem import Problem
from ..result.solution import Solution
from .kinds import kind_of
from .other_packages import faster_elsewhere
from .pilots import Pilots, save_every, tolerances
from .step_search import NO_TIME, Search, guide
from .tolerance_search import VARIABLE, ToleranceSearch

EXTRAPOLATED = "extrapolated from longer steps"  # the note of a less accurate prediction
_WEAK_ORDERS = (5, 6, 9, 10)  # without damping, EIG methods of these orders grow at every step
#: Aim for this fraction of the accuracy. The trajectory error is measured at fewer states than the energy error.
_AIM = {"trajectory": 0.75, "energy": 0.9}
_SECONDS = 0.8  # time after which no further method is tried,
_LEAST_SECONDS = 0.4  # or this time after the reference has been found,
_RUNS = 4  # or the time of this number of runs; in any case, within the time limit of the pilot runs
_WORK = 2**24  # work that is always allowed for a method named by the user
_TIMED_SECONDS = 0.2  # time of the last comparison,
_TIMED_RUNS = 3, 15  # and the least and largest number of runs of each method in it
_SLOW = 2.0  # a method that takes this multiple of the best time is abandoned
_HOPELESS = 4.0  # a method of no higher order and no fewer evaluations is at most faster by this factor
_CLOSE = 1.6  # methods predicted to take at most this multiple of the shortest time are timed
_RULED_OUT = "ruled out: "
_HEAD = {"h": 9, "steps": 9, "evaluations": 12, "seconds": 9, "error": 8}  # the columns of a plan, and their widths
AnySearch = Search | ToleranceSearch


@dataclass(frozen=True)
class Prediction:
    """The step, or the tolerance, with which one method reaches the accuracy, and its cost.

    Attributes
    ----------
    method : Method
    h : float
        The step, or with tolerances the mean step; NaN if no step is known to reach the accuracy.
    n_steps, evaluations : int
        Number of steps and of evaluations of the right-hand side over the whole span.
    seconds : float
        Time in the kernel over the whole span.
    error : float
        The expected error.
    note : str
        The reason why the accuracy is not reached or the method was ruled out, or the limit of the step; otherwise
        empty. A method that was ruled out before it ran has no step.
    rtol : float or None
        The tolerance; None for a fixed step, and NaN if no tolerance is known to reach the accuracy.
    sizes : tuple of float or None
        With tolerances, for a motion that starts from rest: the later sizes of u and of v. `options` then has atol,
        which is rtol times these sizes, because the motion at the start gives no scale for the error.
    h_max : float or None
        The longest step for such a motion; longer steps could skip a load that begins later.
    """

    method: Method
    h: float
    n_steps: int
    evaluations: int
    seconds: float
    error: float
    note: str = ""
    rtol: float | None = None
    sizes: tuple[float, float] | None = None
    h_max: float | None = None

    @property
    def reaches(self) -> bool:
        """Whether a step or a tolerance is predicted to reach the accuracy."""
        return math.isfinite(self.h)

    @property
    def options(self) -> dict[str, Any]:
        """The arguments of `Problem.integrate`: the method, and h or rtol, from rest with atol and h_max."""
        if self.rtol is None:
            return {"method": self.method, "h": self.h}
        return {"method": self.method, **tolerances(self.rtol, self.sizes, self.h_max)}

    @property
    def label(self) -> str:
        """The label of the method, with its tolerance if it has one."""
        name = self.method.label if self.method == check_method(self.method.name) else repr(self.method)
        if self.rtol is None:
            return name
        return f"{name}, rtol {self.rtol:.1e}" if self.reaches else f"{name}, rtol"

    @property
    def cells(self) -> tuple[str, ...]:
        """The label, then the numbers and a note in the columns of a plan, or the reason why there are none."""
        if not self.reaches:
            return self.label, self.note if self.note.startswith(_RULED_OUT) else f"not reached: {self.note}"
        numbers = f"{self.h:.3g}", f"{self.n_steps:.3g}", f"{self.evaluations:.3g}", f"{self.seconds:.3g}"
        return self.label, *numbers, f"{self.error:.1e}", self.note


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
        Processor time of the pilot runs and their comparison, without compilation.
    compile_seconds : float
        Time for compiling methods that no run on this machine had used before, and for loading the others.
    window : tuple of float
        The beginning and the end of the pilot runs: the whole span, or the part of it in which the motion is fastest.
    seen : float
        The time up to which a run has shown the motion: before the end of the span if the run would take too long.
    elsewhere : str
        Where another package may be faster: an implicit method if the motion is stiff, or Taylor series; otherwise
        empty.
    """

    problem: Problem
    accuracy: float
    metric: str
    predictions: tuple[Prediction, ...]
    pilot_seconds: float
    compile_seconds: float
    window: tuple[float, float]
    seen: float
    elsewhere: str = ""

    @property
    def best(self) -> Prediction:
        """The prediction of the fastest method.

        Raises
        ------
        ValueError
            If no method is predicted to reach the accuracy.
        """
        if not self.predictions[0].reaches:
            reasons = "; ".join(f"{p.label}: {p.note}" for p in self.predictions)
            raise ValueError(f"accuracy {self.accuracy:g} is not reached by any method of this plan ({reasons}).")
        return self.predictions[0]

    def run(self, **options: Any) -> Solution:
        """Integrate with the method of `best`, and with its step or tolerance.

        `options` are options of `Problem.integrate`. By default about 2000 states are kept, fewer for a large system,
        and the energy is computed only if it is the metric.
        """
        best = self.best
        if options.get("t_eval") is None:
            options.setdefault("save_every", save_every(self.problem, best.n_steps))
        if self.metric == "trajectory":
            options.setdefault("invariants", {})
        return self.problem.integrate(**best.options, **options)

    def __repr__(self) -> str:
        names = [p.label for p in self.predictions]
        width = max(14, *map(len, names))
        lines = [self._title, *(f"  {line}" for line in self._extent)]
        for name, *cells in [("method", *_HEAD), *(p.cells for p in self.predictions)]:
            if len(cells) > 1:
                cells[: len(_HEAD)] = [" ".join(f"{x:>{n}}" for x, n in zip(cells, _HEAD.values(), strict=False))]
            lines.append(f"  {name:<{width}} {'  '.join(cells)}".rstrip())
        return "\n".join([*lines, f"  {self.elsewhere}"] if self.elsewhere else lines)

    def _repr_html_(self) -> str:
        ends = [(line,) for line in (*self._extent, self.elsewhere) if line]
        return grid(self._title, ("method", *_HEAD, ""), [*(p.cells for p in self.predictions), *ends])

    @property
    def _title(self) -> str:
        return (
            f"Plan for {self.problem.name}: {self.metric} error {self.accuracy:g} up to t = "
            f"{self.problem.t_span[1]:g} (pilot runs: {self.pilot_seconds:.2g} s, compilation: "
            f"{self.compile_seconds:.2g} s)"
        )

    @property
    def _extent(self) -> list[str]:
        """Return a sentence about the part of the span of the pilot runs, if it is not the whole span."""
        begin, end = self.window
        if (begin, end) == tuple(self.problem.t_span):
            return []
        later = f"; the motion after t = {self.seen:g} is not known" if self.seen < self.problem.t_span[1] else ""
        return [f"The pilot runs are from t = {begin:g} to {end:g}, and errors are extrapolated{later}."]


@with_solution
@with_suggestions()
def plan(
    problem: Problem, accuracy: float, *, metric: str = "trajectory", methods: Sequence[str | Method] | None = None
) -> Plan:
    """Find the method that reaches an accuracy over the whole span in the shortest time, and its step or tolerance.

    Parameters
    ----------
    problem : Problem
        The pilot runs apply events with `apply`. A terminal event raises an error.
    accuracy : float
        The largest relative error to allow, above 0 and below 1.
    metric : {"trajectory", "energy"}
        The error is max |u - u(t)| / max |u| over all degrees of freedom for "trajectory", and max |E - E0| / |E0| for
        "energy". For "trajectory", all degrees of freedom should have the same unit or be scaled.
    methods : sequence of str or Method, optional
        The methods to compare. Each method gets a prediction, and RK5, RK8 and RKN12 a second prediction with
        tolerances. By default the two to five methods are compared that are fast for this kind of motion.

    Returns
    -------
    Plan

    Raises
    ------
    TypeError, ValueError
        If an argument is not valid.
    KeyboardInterrupt
        After Ctrl-C. Its attribute `solution` is the interrupted pilot run; None between two runs.

    Notes
    -----
    The pilot runs of most problems take less than two seconds, and at most some ten times as long as the fastest stable
    run of the whole span if that takes longer than a tenth of a second. No pilot run begins that is expected to end
    after ten seconds of processor time. The first plan on a machine also compiles a kernel for each method that it
    tries: three to six seconds for a small system, and longer with events. `pilot_seconds` and `compile_seconds` of
    the plan are the two times. The page eig3/diagnosis/README.md says how the reference and the steps are found, and
    which methods are tried.
    """
    if not isinstance(problem, Problem):
        raise TypeError(f"problem must be an eig3.Problem, not {type(problem).__name__}.")
    if not (isinstance(accuracy, int | float) and 0 < accuracy < 1):
        raise ValueError(f"accuracy must be a number between 0 and 1, not {accuracy!r}.")
    if metric not in ("trajectory", "energy"):
        raise ValueError(f"metric must be 'trajectory' or 'energy', not {metric!r}.")
    if metric == "energy" and problem.energy is None:
        raise ValueError(f"metric 'energy' needs a problem with an energy, and {problem.name} has none.")
    if metric == "energy" and problem.energy_of(problem.u0, problem.v0, z=problem.z0 or None) == 0:
        raise ValueError(
            f"metric 'energy' is relative to the energy at the start, which is 0 in {problem.name}: choose "
            "metric='trajectory'."
        )
    for name, event in problem.events.items():
        if event.terminal:
            raise ValueError(
                f"problem must have no terminal event, such as {name!r} of {problem.name}: let t_span end where it "
                "occurs, and leave it out, with problem.with_(t_span=..., events={})."
            )
    records = [check_method(method) for method in (LIBRARY if methods is None else methods)]
    if methods is None:
        records = _for(problem, records)
    if not records:
        raise ValueError("methods must name at least one method.")
    for method in records:
        if method.is_stochastic:
            raise ValueError(f"methods must be deterministic, and {method!r} adds random numbers: leave it out.")
        if not _for(problem, [method]):  # it is refused before the pilot runs, unless the force only seems to read v
            prepared = problem.prepare(h=problem.t_span[1] - problem.t_span[0], method=method, invariants={}, events={})
            prepared.at_start(problem.t_span, *problem.start, check_params(problem.params))
    pilots = Pilots(problem, metric, _AIM[metric] * accuracy)
    first = guide(pilots)
    if isinstance(first, str):
        predictions = [_failure(method, first) for method in records]
    else:
        predictions = _choose(first, records) if methods is None else _predict_each(first, records)
    predictions.sort(key=lambda p: (not p.reaches, p.seconds))
    best = predictions[0]
    return Plan(
        problem,
        float(accuracy),
        metric,
        tuple(predictions),
        pilots.spent,
        pilots.compiling,
        pilots.window,
        pilots.seen,
        faster_elsewhere(pilots, accuracy, best.method, best.n_steps, best.rtol) if best.reaches else "",
    )


def _for(problem: Problem, methods: Sequence[Method]) -> list[Method]:
    """The methods that are valid for the problem."""
    fit = [method for method in methods if not (method.ignores_velocity and problem.uses_velocity)]
    return [method for method in fit if method.takes_constraints or not constraints_of(problem.rhs)]


def _choose(first: Search, records: list[Method]) -> list[Prediction]:
    """The predictions of the methods that may be the fastest, and the reasons why the others are not."""
    pilots, kind, enough = first.pilots, kind_of(first), _end_of_search(first)
    best: AnySearch = first
    variable = [ToleranceSearch(pilots, m) for m in _for(pilots.problem, VARIABLE) if m.name in kind.variable]
    for tolerant in variable:
        tolerant.run(first, longest=_SLOW * best.seconds, enough=enough)
        best = min(best, tolerant, key=lambda search: search.seconds)
    names = dict.fromkeys([first.method.name, *kind.fixed])
    fitting = [m for name in names for m in records if m.name == name] or records
    ruled_out = [_failure(m, f"{_RULED_OUT}usually slower where {kind.name}") for m in records if m not in fitting]
    fixed: list[Search] = []
    for method in fitting:
        search = first if method == first.method else Search(pilots, method)
        reason = "" if search is first else _ruled_out(method, fixed, best)
        if not reason and search is not first and pilots.spent > enough:
            reason = NO_TIME
        if not reason:
            search.run(best, longest=_SLOW * best.seconds, enough=enough)
            fixed.append(search)
            reason = _without_steps(search, best)
        if reason:
            ruled_out.append(_failure(method, _RULED_OUT + reason))
        best = min(best, search, key=lambda search: search.seconds)
    failed = [_failed(search) for search in variable if not search.steps]
    found: list[AnySearch] = [*variable, *fixed]
    return _timed([search for search in found if search.steps]) + failed + ruled_out


def _without_steps(search: Search, best: AnySearch) -> str:
    """The reason why the search has not found a number of steps; empty if it has."""
    if search.steps:
        return ""
    return f"in {_SLOW:g} times the time of {best.label}, {search.verdict}" if search.runs else NO_TIME


def _ruled_out(method: Method, tried: Sequence[Search], best: AnySearch) -> str:
    """The reason why the method cannot be the fastest; empty if it may be the fastest."""
    for search in tried:
        other = search.method
        if search.is_limited:
            graded = isinstance(method, EIG) and isinstance(other, EIG) and other.order not in _WEAK_ORDERS
            if graded and other.order < method.order:
                return f"stability limits its step more than the step of {other.label}"
        elif method.order <= other.order and search.pilots.evaluations(method) >= search.evaluations:
            if search.is_far_off:
                return (
                    f"{other.label}, of order {other.order}, is far from the accuracy in {_SLOW:g} times the best time"
                )
            factor = search.seconds / best.seconds
            if search.follows_order and factor > _HOPELESS:
                return f"{other.label}, of order {other.order}, takes {factor:.2g} times as long as {best.label}"
    return ""


def _predict_each(first: Search, records: list[Method]) -> list[Prediction]:
    """A prediction for every method, from runs within its share of the time."""
    pilots = first.pilots
    searches: list[AnySearch] = []
    end = _end_of_search(first)
    for i, method in enumerate(records):
        search = first if method == first.method else Search(pilots, method)
        until = pilots.spent + max(0.0, end - pilots.spent) / (len(records) - i)
        search.run(first, until=until, work=_WORK)
        searches.append(search)
        if method in VARIABLE:
            variable = ToleranceSearch(pilots, method)
            variable.run(first, longest=until - pilots.spent)
            searches.append(variable)
    return _timed(searches)


def _end_of_search(first: Search) -> float:
    """The time of the pilot runs after which no further method is tried."""
    pilots = first.pilots
    run = first.seconds * pilots.part if first.steps else 0.0
    return max(_SECONDS, pilots.spent + max(_LEAST_SECONDS, _RUNS * run))


def _timed(searches: Sequence[AnySearch]) -> list[Prediction]:
    """The predictions of all methods. The fastest methods are timed alternately."""
    shortest = min((search.seconds for search in searches), default=math.inf)
    close = [search for search in searches if search.steps and search.seconds <= _CLOSE * shortest]
    paces: dict[AnySearch, list[float]] = {search: [] for search in close}
    pilots, (fewest, most) = searches[0].pilots, _TIMED_RUNS
    until = pilots.spent + _TIMED_SECONDS
    for i in range(most):
        if i >= fewest and (len(close) == 1 or pilots.spent > until):
            break
        for search in close:
            paces[search].append(search.time_a_step())
    return [_prediction(search, min(paces.get(search, [search.pace]))) for search in searches]


def _prediction(search: AnySearch, pace: float) -> Prediction:
    if not search.steps:
        return _failed(search)
    contacts = " or by contacts" if search.pilots.have_jumps else ""
    note = f"the step is limited by stability{contacts}" if search.is_limited else ""
    from_rest: dict[str, Any] = {}
    if search.rtol is not None and search.pilots.sizes:
        from_rest = {"sizes": search.pilots.sizes, "h_max": search.pilots.h_max}
        note = "from rest, with atol and h_max as in options"
    return Prediction(
        method=search.method,
        h=search.pilots.span / search.steps,
        n_steps=search.steps,
        evaluations=round(search.steps * search.mean_evaluations),
        seconds=search.steps * pace,
        error=search.error,
        note=note if search.reaches else EXTRAPOLATED,
        rtol=search.rtol,
        **from_rest,
    )


def _failed(search: AnySearch) -> Prediction:
    return _failure(search.method, search.failure, search.rtol)


def _failure(method: Method, note: str, rtol: float | None = None) -> Prediction:
    return Prediction(method, math.nan, 0, 0, math.inf, math.nan, note, rtol)
