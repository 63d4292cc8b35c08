"""A user's own problem: which methods to measure, and with which steps, follows from the pilot runs of `eig3.plan`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eig3.named_problem import find, in_words, refused
from eig3.planning.planner import Plan, Prediction, plan
from eig3.problem import Problem

from .. import text
from ..modes import MODES, Mode, Timed
from ..problem_set import about, describe
from ..reference import Judge
from ..rivals import RIVALS
from ..rivals.rival import Rival
from ..sweep import Point, Repeatable, WorkPrecisionSet, is_stable, sweep_tolerances, timed_points, warm
from ..timing import Storage, kernel_run
from .true_motion import Grid, find_truth

_COMMAND = "eig3 bench report: --problem"
ACCURACIES = (1e-2, 1e-4, 1e-6, 1e-8)
_TIMING = 15.0  # seconds for the interleaved runs of the library, as predicted,
_RIVALS = 15.0  # and for the runs of all rivals
_FEWEST_REPEATS = 3
_LOOSER = 30.0  # a tolerance that is longer by this factor is measured too
_INLINED = 3  # methods of each plan, the fastest, are measured inlined too: to compile a kernel takes a second or more
_EVALUATION = 8e-6  # of SciPy in Python, s
_ENOUGH = 0.5  # s; a run that has taken so long in three rounds is not repeated
_NEARBY = 1.1  # the factor of u0 or v0 for the energy that is compared with the energy of the start
_TINY = 1e-4  # of that change; the relative errors of a smaller energy are mostly round-off


def load(name: str) -> tuple[Problem, str]:
    """The problem that `module:name` is, or returns, and the first paragraph of the function's docstring.

    Raises
    ------
    SystemExit
        If there is no such problem.
    """
    found, words = find(name, _COMMAND), ""
    if callable(found) and not isinstance(found, Problem):
        words = about(found)
        try:
            found = found()
        except Exception as error:
            raise refused(name, _COMMAND, f"{name.rpartition(':')[2]}() fails ({in_words(error)})") from None
    try:
        check(found)
    except (TypeError, ValueError) as error:
        raise refused(name, _COMMAND, str(error).rstrip(".")) from None
    return found, words


def check(problem: Any) -> None:
    """Refuse what is not a problem, and a problem that an event ends or that has first-order unknowns.

    Raises
    ------
    TypeError, ValueError
    """
    if not isinstance(problem, Problem):
        kind = type(problem).__name__
        raise TypeError(f"problem must be an eig3.Problem or a function that returns one, not {kind}.")
    if problem.unknowns.is_read:
        raise ValueError("problem must have no first-order unknowns that rhs reads, because the rivals have none.")
    for event in (event for event, what in problem.events.items() if what.terminal):
        raise ValueError(
            f"problem must have no terminal event, such as {event!r} of {problem.name}: let t_span end where it "
            "occurs, and leave it out, with problem.with_(t_span=..., events={})."
        )


def how_measured(repeats: int) -> str:
    return (
        f"Times of your own problem: medians of at most {repeats} interleaved runs, without compilation. Steps and "
        "tolerances are from eig3.plan for each accuracy, with longer ones. The methods keep 61 to 976 states, and the "
        "rivals compute half of 976 by their dense output. Runs that would take longer than their share of a minute "
        "are left out."
    )


def measure(
    problem: Problem,
    accuracies: Sequence[float],
    *,
    name: str,
    about: str = "",
    repeats: int,
    rivals: bool | Sequence[str],
    modes: Sequence[str],
    methods: Sequence[str] | None = None,
) -> WorkPrecisionSet:
    """Measure the methods that `eig3.plan` names for these accuracies, and the rivals, in one interleaved run.

    Each method runs with the steps or tolerances that the plans name, and with a longer one. Predicted times decide how
    often, and which runs take so long that they are left out.
    """
    targets = tuple(sorted(accuracies, reverse=True))
    judged, skipped = _judged(problem)
    text.status(f"{name}: plans")
    metrics = ("trajectory",) if judged.energy is None else ("trajectory", "energy")
    plans = [plan(judged, target, metric=metric, methods=methods) for metric in metrics for target in targets]
    text.status(f"{name}: reference")
    grid = Grid.of(judged)
    truth = find_truth(judged, grid, min(targets))
    judge = Judge(judged, truth)
    candidates, too_long, repeats = _affordable(_candidates(plans, grid), len(modes), repeats)
    fast = {p.method for each in plans for p in each.predictions[:_INLINED]}
    slow = [candidate.label for candidate in candidates if candidate.prediction.method not in fast]
    skipped += too_long + _ruled_out(plans, candidates)
    if any(MODES[mode].is_inline for mode in modes):
        skipped += _by_reason(dict.fromkeys(slow, f"not inlined, since not among the {_INLINED} fastest of a plan"))
    runs = _Runs(judged, grid, judge)
    found: list[Repeatable] = []
    for mode in modes:
        for candidate in candidates:
            if not MODES[mode].is_inline or candidate.prediction.method in fast:
                text.status(f"{name}, {candidate.label}, {mode}")
                found += runs.of(candidate, mode)
    asked = _asked(rivals)
    refused = {key: rival.refusal(judged, is_of_the_library=False) for key, rival in asked.items()}
    share = _RIVALS / max(1, sum(not why for why in refused.values()))
    fewest = min((p.evaluations for each in plans for p in each.predictions if p.reaches), default=0)
    reasons = {key: refused[key] or _unsuitable(rival, judged, fewest, share) for key, rival in asked.items()}
    unsuitable = {key: why for key, why in reasons.items() if why}
    skipped += _by_reason({RIVALS[key].label: why for key, why in unsuitable.items()})
    with np.errstate(over="ignore", invalid="ignore"):  # in steps that SciPy refuses
        for key in (key for key in asked if key not in unsuitable):
            limits = asked[key], share / (2 * repeats)
            found += sweep_tolerances(judged, targets, judge, key, *limits, states=grid.rival_states)
        points = timed_points(found, repeats, name, _ENOUGH)
    words = describe(problem, about or problem.source)
    return WorkPrecisionSet(
        name, problem.name, words, "trajectory", targets, True, truth.source, truth.uncertainty, points, skipped
    )


def _judged(problem: Problem) -> tuple[Problem, list[str]]:
    """The problem with the energy and the events that can be measured, and what was left out."""
    acting = {name: event for name, event in problem.events.items() if event.apply is not None}
    changes: dict[str, Any] = {"events": acting} if len(acting) < len(problem.events) else {}
    skipped = []
    if problem.energy is not None:
        start = float(problem.energy_of(problem.u0, problem.v0, z=problem.z0 or None))
        if "work" in problem.z0:
            skipped.append("the energy (it changes by the work)")
        elif acting:
            skipped.append("the energy (events may take some of it)")
        elif not math.isfinite(start) or abs(start) <= _TINY * _change_nearby(problem, start):
            size = f"{start:.2g} {problem.energy_unit}".removesuffix(" -")
            skipped.append(f"the energy (it is {size} at the start, so that relative errors have no meaning)")
        if skipped:
            changes["energy"] = None
    return problem.with_(**changes), skipped


def _change_nearby(problem: Problem, start: float) -> float:
    """The largest change of the energy that a tenth more displacement or velocity at the start makes."""
    u, v = np.asarray(problem.u0, dtype=np.float64), np.asarray(problem.v0, dtype=np.float64)
    changes = (abs(problem.energy_of(*state) - start) for state in ((_NEARBY * u, v), (u, _NEARBY * v)))
    return max((change for change in changes if math.isfinite(change)), default=0.0)


@dataclass(frozen=True)
class _Candidate:
    """A method with a number of steps or a tolerance, and the seconds that a run is predicted to take.

    The `rank` is its place in the plan, from 0 for the fastest.
    """

    rank: int
    prediction: Prediction
    n_steps: int
    rtol: float | None
    seconds: float

    @property
    def key(self) -> str:
        name = self.prediction.method.name
        return name if self.rtol is None else f"{name} tolerances"

    @property
    def label(self) -> str:
        label = self.prediction.method.label
        return label if self.rtol is None else f"{label}, tolerances"

    @property
    def setting(self) -> str:
        return f"{self.n_steps} steps" if self.rtol is None else f"rtol {self.rtol:.2g}"

    @property
    def longer(self) -> _Candidate:
        """With twice the step, or a tolerance that takes about as many steps as that."""
        if self.rtol is None:
            return replace(self, rank=self.rank + 1, n_steps=self.n_steps // 2, seconds=self.seconds / 2)
        return replace(self, rank=self.rank + 1, rtol=min(0.1, _LOOSER * self.rtol), seconds=self.seconds / 2)


def _candidates(plans: Sequence[Plan], grid: Grid) -> list[_Candidate]:
    """What the plans name, each with a longer step too, in the order of the methods and of their steps."""
    named = [
        _Candidate(rank, p, p.n_steps, p.rtol, p.seconds)
        for each in plans
        for rank, p in enumerate(each.predictions)
        if p.reaches
    ]
    named.sort(key=lambda candidate: candidate.rank)
    different: dict[tuple, _Candidate] = {}
    for candidate in (*named, *(candidate.longer for candidate in named)):
        if candidate.rtol is None:
            fitted = replace(candidate, n_steps=grid.fit(candidate.n_steps))
            different.setdefault((candidate.key, fitted.n_steps), fitted)
        else:
            different.setdefault((candidate.key, round(3 * math.log10(candidate.rtol))), candidate)
    return sorted(different.values(), key=lambda c: (c.key, c.n_steps if c.rtol is None else -c.rtol))


def _affordable(candidates: Sequence[_Candidate], modes: int, repeats: int) -> tuple[list[_Candidate], list[str], int]:
    """Those that can be measured in the time, what is left out, and how often the others run.

    The fastest of each plan come first, so that something is measured for each accuracy.
    """
    seconds = modes * sum(candidate.seconds for candidate in candidates)
    repeats = max(min(repeats, _FEWEST_REPEATS), min(repeats, int(_TIMING / max(seconds, 1e-9))))
    kept: list[_Candidate] = []
    left: list[_Candidate] = []
    spent = 0.0
    for candidate in sorted(candidates, key=lambda c: (c.rank, c.seconds)):
        cost = modes * repeats * candidate.seconds
        if spent + cost <= _TIMING or not kept:
            spent += cost
            kept.append(candidate)
        else:
            left.append(candidate)
    words = _by_reason({f"{c.label} with {c.setting}": "would take too long" for c in left})
    return [candidate for candidate in candidates if candidate in kept], words, repeats


def _ruled_out(plans: Sequence[Plan], candidates: Sequence[_Candidate]) -> list[str]:
    """The methods that no plan names, each with the reason of the plan for the smallest accuracy."""
    named = {candidate.prediction.method for candidate in candidates}
    reasons = {
        p.method.label: p.note.removeprefix("ruled out: ")
        for each in plans
        for p in each.predictions
        if not p.reaches and p.method not in named
    }
    return _by_reason(reasons)


def _by_reason(reasons: Mapping[str, str]) -> list[str]:
    """What was left out, from the reason of each, with what has the same reason together."""
    together: dict[str, list[str]] = {}
    for label, reason in reasons.items():
        together.setdefault(reason, []).append(label)
    return [f"{', '.join(labels)} ({reason})" for reason, labels in together.items()]


def _asked(rivals: bool | Sequence[str]) -> dict[str, Rival]:
    if isinstance(rivals, bool):
        return dict(RIVALS) if rivals else {}
    return {key: RIVALS[key] for key in rivals}


def _unsuitable(rival: Rival, problem: Problem, fewest: int, share: float) -> str:
    """Why a rival that can solve the problem is not measured; empty if it is."""
    if problem.events and (len(problem.events) > 1 or np.ndim(problem.u0)):
        return "only one event of one degree of freedom is written for it"
    seconds = fewest * _EVALUATION
    if rival.package == "scipy" and seconds > share:
        return f"about {seconds:.0f} s for its loosest tolerance"
    return ""


@dataclass(frozen=True)
class _Runs:
    """Runs of candidates on the times of the grid."""

    problem: Problem
    grid: Grid
    judge: Judge

    def of(self, candidate: _Candidate, mode: str) -> Iterable[Repeatable]:
        """The point of a candidate, and a function that repeats its run."""
        options: dict[str, Any] = {"method": candidate.prediction.method}
        if candidate.rtol is None:
            options |= self.grid.steps(candidate.n_steps)
        else:
            options |= replace(candidate.prediction, rtol=candidate.rtol).options
            options["t_eval"] = np.linspace(*self.problem.t_span, self.grid.rival_states)
        run = MODES[mode].timed(self.problem, options)
        _, solution = run()
        errors = self.judge.of_run(solution) if solution.success else {}
        setting = solution.h if candidate.rtol is None else candidate.rtol
        steps = solution.n_steps if candidate.rtol is None else None
        stable = is_stable(solution.success, errors)
        point = Point(candidate.key, candidate.label, mode, setting, steps, solution.n_rhs, stable, errors)
        yield point, self._again(candidate, options, MODES[mode], run)

    def _again(self, candidate: _Candidate, options: dict[str, Any], mode: Mode, run: Timed) -> Callable[[], float]:
        if mode.is_whole or candidate.rtol is not None or self.problem.events:
            return warm(lambda: run()[0])
        every = options["save_every"]
        start = self.problem.stepper(h=options["h"], method=options["method"], inline=mode.is_inline)
        storage = Storage.for_steps(self.problem, candidate.n_steps // every)
        return warm(kernel_run(start, candidate.n_steps, every=every, storage=storage))
