"""Compare the errors that runs estimate of themselves with their true errors, and time what `accuracy=` costs.

Each problem runs with several methods, steps and tolerances. The true errors are measured against the references of
`eig3 bench precision`, or, of problems that it does not have, against a run with tiny tolerances.
"""

from __future__ import annotations

import argparse
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eig3 import problems
from eig3.command_line import Files, add_out
from eig3.methods import METHODS, RK5, RK8, RKN12
from eig3.problem import Problem
from eig3.result.solution import Solution

from . import pictures, text
from .choices import add_problems, add_repeats, choose
from .problem_set import PROBLEM_SET, VARIABLE_SPEED
from .reference import Judge, Reference, exact_reference, reference
from .timing import medians, seconds_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SUMMARY = "whether the errors that runs estimate of themselves are true, and what accuracy= costs"
FIXED = ("eig3", "cd", "rk2", "rk3", "rk4", "ab2", "ab3", "eig5", "rk8")
TOLERANCES = (1e-3, 1e-5, 1e-7, 1e-9, 1e-11)
ACCURACIES = (1e-4, 1e-6, 1e-8)
PICTURE = "trust.svg"
TWICE, THRICE, TENTH = 2.0, 3.0, 0.1
_STATES = 200  # saved states of a run with a fixed step
_REFINED = 4  # from one number of steps to the next
_LONGEST = 0.1  # s; a longer run is not refined
_LEAST = 1e-11  # a smaller true error may be the error of the reference
_TINY = 1e-13  # the tolerance of the reference of a hard case
_TRIALS = 12  # bisections of the tolerance by hand
_STEPS = 2000  # of the first run, if the problem names no step
_FIRST = 0.5  # omega h of the first run with a fixed step
_CERTAIN = 10.0  # least error that is compared, relative to the uncertainty of the reference

#: Problems besides the sets of `eig3 bench precision`: whether they are smooth, and what builds them.
FURTHER: dict[str, tuple[bool, Callable[[], Problem]]] = {
    "two frequencies": (True, problems.two_frequency_oscillator),
    "spinning top": (True, problems.spinning_top),
    "tumbling box": (True, problems.tumbling_box),
    "slider-crank": (True, problems.slider_crank),
    "four-bar": (True, problems.four_bar),
    "squeezer": (True, problems.squeezer),
    "chain of rods": (True, problems.rod_chain),
    "double wishbone": (True, problems.double_wishbone),
    "quarter car": (False, problems.quarter_car),
    "ten-storey frame": (False, problems.ten_storey_frame),
    "building, a record": (False, problems.shear_building),
    "pounding buildings": (False, problems.pounding_buildings),
    "friction oscillator": (False, problems.friction_oscillator),
    "rail joint": (False, problems.rail_joint),
    "double pendulum, 60 s": (False, partial(problems.double_pendulum, t_end=60.0)),
}
_KINKED = ("hertz_impact", "bouncing_ball")  # of the sets


@dataclass(frozen=True)
class Checked:
    """A run with its estimated and its true error, relative to the largest |u|."""

    problem: str
    is_smooth: bool
    method: str
    estimated: float
    true: float
    is_noted: bool

    @property
    def ratio(self) -> float:
        return self.estimated / self.true


def add_options(parser: argparse.ArgumentParser) -> None:
    add_problems(parser)
    add_repeats(parser, 5)
    add_out(parser, "write trust.md and a picture there")


def benchmark(
    *,
    only: Sequence[str] | None = None,
    repeats: int = 5,
    out: Path | None = None,
    write: Callable[[str], None] = print,
) -> list[Checked]:
    """Print the tables; with `out`, write them and a picture there. Return the runs."""
    of_set = PROBLEM_SET | VARIABLE_SPEED
    found: list[Checked] = []
    names = choose(only, [*of_set, *FURTHER], "--problem")
    for name in names:
        if name in FURTHER:
            is_smooth, build = FURTHER[name]
            problem = build()
            found += _runs(problem, problem.h or _span(problem) / _STEPS, name, _own_truth(problem), is_smooth)
        else:
            problem, omega = of_set[name].build(), of_set[name].omega
            found += _runs(problem, _FIRST / omega, name, reference(problem, omega), name not in _KINKED)
    timed = [name for name in names if name in of_set and of_set[name].tolerances and name not in _KINKED]
    costs = [row for name in timed for row in _costs(name, of_set[name].build(), repeats)]
    text.status("")
    page = [verdict(found), render(found)]
    page += [f"## What accuracy= costs\n\n{_COSTS}", text.table(_COST_HEADER, costs)] if costs else []
    for part in page:
        write(part + "\n")
    if out is not None:
        files = Files(out, "eig3 bench")
        note = pictures.draw({PICTURE: lambda: picture(found)}, files)
        with files.writing("trust.md") as path:
            path.write_text("\n\n".join(["# Can the error be trusted?", *page]) + "\n")
        files.finish(write, note)
    return found


def verdict(found: Sequence[Checked]) -> str:
    """Say how often the estimates are near the true errors."""
    sentences = []
    for kind, some in (("smooth problems", True), ("problems with kinks, impacts, friction, records or chaos", False)):
        mine = [x.ratio for x in found if x.is_smooth is some and not x.is_noted]
        noted = sum(x.is_smooth is some and x.is_noted for x in found)
        within = [sum(1 / factor <= ratio <= factor for ratio in mine) for factor in (TWICE, THRICE)]
        if mine or noted:
            sentences.append(
                f"On {kind}, the estimated error is within a factor of {TWICE:g} of the true error in {within[0]} and "
                f"within a factor of {THRICE:g} in {within[1]} of {len(mine)} runs without a note; {noted} runs have a "
                "note."
            )
    low = sum(x.ratio < TENTH and not x.is_noted for x in found)
    sentences.append(
        f"Of all {len(found)} runs, {low} have an estimate below a tenth of the true error without a note. Errors are "
        "of u, relative to the largest |u|, at the saved times up to `reliable_until`. Runs whose true error is near "
        "the uncertainty of the reference are left out."
    )
    return " ".join(sentences)


def render(found: Sequence[Checked]) -> str:
    """The runs of each problem in a table."""
    rows = []
    for name in dict.fromkeys(x.problem for x in found):
        mine = [x for x in found if x.problem == name]
        ratios, noted = [x.ratio for x in mine], sum(x.is_noted for x in mine)
        plain = [x.ratio for x in mine if not x.is_noted]
        within = [sum(1 / factor <= ratio <= factor for ratio in ratios) for factor in (TWICE, THRICE)]
        span = f"{min(x.true for x in mine):.0e} to {max(x.true for x in mine):.0e}"
        ends = [text.number(x, 2) for x in (min(plain), max(plain))] if plain else ["-", "-"]
        rows.append([name, str(len(mine)), span, *map(str, within), str(noted), *ends])
    return text.table(_HEADER, rows)


_HEADER = ["problem", "runs", "true errors", "within 2", "within 3", "with notes", "least ratio without", "largest"]


def _runs(problem: Problem, h: float, name: str, truth: Reference, is_smooth: bool) -> Iterator[Checked]:
    """Yield the runs of a problem that succeed and whose true errors are known."""
    least = max(_LEAST, _CERTAIN * truth.uncertainty)
    for solution in _solutions(problem, h):
        text.status(f"{name}, {solution.method.label}")
        error = solution.check()
        assert error  # nothing interrupts it
        true = np.abs(solution.u - truth.u(solution.t)).reshape(len(solution.t), -1)
        reliable = solution.t <= (math.inf if error.reliable_until is None else error.reliable_until)
        size = np.abs(solution.u).max()
        estimated, actual = (float(np.nanmax(np.abs(x[reliable]), initial=0.0) / size) for x in (error.u, true))
        if max(actual, estimated) > least and actual > 0:
            yield Checked(name, is_smooth, solution.method.label, estimated, actual, bool(error.notes))


def _solutions(problem: Problem, h: float) -> Iterator[Solution]:
    """Yield the runs of a problem with fixed steps, from about h on, and with tolerances."""
    span = _span(problem)
    for name in FIXED:
        if METHODS[name]().ignores_velocity and problem.uses_velocity:
            continue
        n_steps = 2 * _STATES * max(1, math.ceil(span / h / (2 * _STATES)))
        while True:
            try:
                solution = problem.integrate(h=span / n_steps, method=name, save_every=n_steps // _STATES)
            except ValueError:  # the method does not support constraints
                break
            if solution.success:
                yield solution
            if solution.kernel_seconds * _REFINED > _LONGEST:
                break
            n_steps *= _REFINED
    for method in (RK5(), RK8(), RKN12()):
        if method.ignores_velocity and problem.uses_velocity:
            continue
        for rtol in TOLERANCES:
            solution = problem.integrate(rtol=rtol, method=method)
            if solution.success:
                yield solution


def _span(problem: Problem) -> float:
    return problem.t_span[1] - problem.t_span[0]


def _own_truth(problem: Problem) -> Reference:
    """The exact motion, or by RK8 with a tiny tolerance, and its difference from a run with a larger one."""
    if problem.exact:
        return exact_reference(problem)

    def u(t: np.ndarray, rtol: float = _TINY) -> np.ndarray:
        times, places = np.unique(t, return_inverse=True)  # a state before and one after a reset have one time
        return problem.integrate(rtol=rtol, method=RK8(), t_eval=times).u[places]

    t = np.linspace(*problem.t_span, _STATES)
    return Reference(u, f"RK8 at rtol {_TINY:g}", float(np.abs(u(t) - u(t, 10 * _TINY)).max() / np.abs(u(t)).max()))


_COSTS = (
    "`accuracy=` runs until the estimated error is small enough: a first call, and a later call that begins with what "
    "was learned, relative to a run by hand. By hand: the fastest of RK5, RK8 and RKN12, with the largest tolerance "
    "whose true error meets the accuracy, which was found before. All code was compiled before. Medians of interleaved "
    "calls, with their Python."
)
_COST_HEADER = ["problem", "accuracy", "by hand", "ms", "first call", "later call", "true / asked"]


def _costs(name: str, problem: Problem, repeats: int) -> Iterator[list[str]]:
    """Yield the rows of a problem: the times of `accuracy=` over the time of the best run by hand."""
    judge = Judge(problem, reference(problem, (PROBLEM_SET | VARIABLE_SPEED)[name].omega))
    for accuracy in ACCURACIES:
        text.status(f"{name}, {accuracy:g}")
        best = _by_hand(problem, judge, accuracy)
        if best is None:
            continue
        method, rtol = best
        asked = problem.integrate(accuracy=accuracy)
        if not asked.success:
            yield [name, f"{accuracy:g}", METHODS[method]().label, "-", "-", "-", "not reached"]
            continue

        others = itertools.count(1)  # a call with another accuracy has learned nothing

        def first(accuracy: float = accuracy, others: Iterator[int] = others) -> Solution:
            return problem.integrate(accuracy=accuracy * (1 - 1e-6 * next(others)))

        calls: dict[str, Callable[[], Any]] = {
            "by hand": partial(problem.integrate, rtol=rtol, method=method),
            "first": first,
            "later": partial(problem.integrate, accuracy=accuracy),
        }
        seconds = medians({call: partial(seconds_of, each) for call, each in calls.items()}, repeats, name)
        true = _error(asked, judge)
        ratios = [f"{seconds[call] / seconds['by hand']:.1f}" for call in ("first", "later")]
        cells = [METHODS[method]().label, text.number(1e3 * seconds["by hand"]), *ratios]
        yield [name, f"{accuracy:g}", *cells, text.number(true / accuracy, 2)]


def _by_hand(problem: Problem, judge: Judge, accuracy: float) -> tuple[str, float] | None:
    """Return the method and the largest tolerance that meet the accuracy in the shortest time of the kernel."""
    best: tuple[float, str, float] | None = None
    for name in ("rk5", "rk8", "rkn12"):
        if METHODS[name]().ignores_velocity and problem.uses_velocity:
            continue
        low, high = math.log(1e-13), math.log(0.1)
        for _ in range(_TRIALS):
            middle = (low + high) / 2
            solution = problem.integrate(rtol=math.exp(middle), method=name)
            meets = solution.success and _error(solution, judge) <= accuracy
            low, high = (middle, high) if meets else (low, middle)
        rtol = math.exp(low)
        runs = [problem.integrate(rtol=rtol, method=name) for _ in range(3)]
        if runs[0].success and _error(runs[0], judge) <= accuracy:
            best = min(best or (math.inf, "", 0.0), (min(x.kernel_seconds for x in runs), name, rtol))
    return best and best[1:]


def _error(solution: Solution, judge: Judge) -> float:
    return judge.errors(solution.t, solution.u)["trajectory"]


def picture(found: Sequence[Checked]) -> Figure:
    """The ratio of the estimated to the true error, against the true error."""
    figure = pictures.new_figure(9.0, 5.2)
    axes = figure.subplots()
    axes.axhspan(1 / TWICE, TWICE, color="tab:green", alpha=0.12, label="within a factor of 2")
    axes.axhline(1.0, color="0.4", linewidth=0.8)
    kinds = {
        "smooth problems": ([x for x in found if x.is_smooth and not x.is_noted], "tab:blue", "."),
        "smooth, with a note": ([x for x in found if x.is_smooth and x.is_noted], "tab:cyan", "x"),
        "kinks, impacts, friction, chaos": ([x for x in found if not x.is_smooth and not x.is_noted], "tab:red", "."),
        "the same, with a note": ([x for x in found if not x.is_smooth and x.is_noted], "tab:orange", "x"),
    }
    for label, (some, color, marker) in kinds.items():
        axes.loglog(
            [x.true for x in some],
            [min(max(x.ratio, 1e-3), 1e3) for x in some],
            color=color,
            marker=marker,
            linestyle="none",
            markersize=5,
            alpha=0.7,
            label=f"{label} ({len(some)})",
        )
    axes.set_ylim(0.8e-3, 1.2e3)
    axes.set_xlabel("true error: max |u - u(t)| / max |u|")
    axes.set_ylabel("estimated error / true error (beyond 1000: at the edge)")
    axes.set_title("Can the error be trusted? Runs with check=True", fontsize=11)
    axes.grid(which="major", alpha=0.35)
    axes.legend(loc="upper right", fontsize=8)
    return figure
