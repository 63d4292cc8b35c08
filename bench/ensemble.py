"""Measure ensembles: ns a step and trajectory one at a time, in lanes and on all cores, and the time to an accuracy.

The heyoka, JAX and diffrax of the extra "rivals" are measured beside them where they are installed.
"""

from __future__ import annotations

import argparse
import math
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from eig3 import problems
from eig3.command_line import count
from eig3.ensembles.lanewise import layout_of
from eig3.ensembles.members import check_members
from eig3.kernels.lanes import compile_rhs
from eig3.methods import METHODS

from . import text
from .choices import add_problems, add_repeats, choose
from .ensemble_cases import CASES, CASES_WITH_TOLERANCES, SAMPLES, Case
from .ensemble_rivals import ENSEMBLE_RIVALS, Contestant, Run, jax_eig3
from .ensemble_tolerances import tolerance_tables
from .environment import in_words
from .rivals.rival import is_installed
from .timing import interleave, medians, seconds_of

SUMMARY = "ns a step of ensembles, and seconds to an accuracy beside heyoka, JAX and diffrax"

SPEED_METHODS = ("eig3", "eig9", "rk4")
ACCURACY_METHODS = ("eig3", "eig5", "eig9", "rk4", "rk8")
TOLERANCE_METHODS = ("rk5", "rk8")
TARGET = 1e-4  # the largest error at the end, relative to the member's largest displacement
_FEW = 50  # members that run one at a time
_PILOTS = 32  # members with which the step or the tolerance is searched
_LADDER = 2 ** (np.arange(52) / 4)  # the stability limit over the steps to try
_REFERENCE = 64  # the stability limit of RK8 over the step of the reference
_SAMPLES = SAMPLES - 1  # steps of the reference, or a multiple, so that they end at the samples of a record
_LEAST_RTOL = 1e-13  # of the reference with tolerances
_SAVED = 100  # states of the reference, for the largest displacement
_LONGEST = 5.0  # s: a rival that would take longer runs with fewer members

SPEED_HEADER = [
    "ensemble, method",
    "one at a time",
    "in the kernel",
    "lanes",
    "in the kernel",
    "all cores",
    "one core / all",
    "one at a time / lanes",
    "by hand",
    "JAX",
    "cores of JAX",
    "compile f (s)",
]


def add_options(parser: argparse.ArgumentParser) -> None:
    add_problems(parser)
    add_repeats(parser, 5)
    parser.add_argument("--members", type=count, default=4096, metavar="M", help="of the first table (4096)")
    parser.add_argument(
        "--steps", dest="n_steps", type=count, default=10_000, metavar="N", help="of the first table (10000)"
    )
    parser.add_argument(
        "--accurate", type=count, default=10_000, metavar="M", help="members of the second table (10000)"
    )
    parser.add_argument(
        "--million", action="store_true", help="only run a million Duffing members with reduce= in a new process"
    )


def benchmark(
    *,
    only: Sequence[str] | None = None,
    repeats: int = 5,
    members: int = 4096,
    n_steps: int = 10_000,
    accurate: int = 10_000,
    million: bool = False,
    write: Callable[[str], None] = print,
) -> None:
    """Print the tables, or with `million` only the line of a million members."""
    if million:
        write(_million())
        return
    every = {**CASES, **CASES_WITH_TOLERANCES}
    chosen = choose(only, tuple(every), "--problem")
    cases = [CASES[name] for name in chosen if name in CASES]
    write(f"Machine: {in_words()}")
    absent = [rival.label for rival in ENSEMBLE_RIVALS if not rival.is_installed]
    absent += [] if is_installed("jax") else ["JAX"]
    if absent:
        write(f'Not installed, and left out: {", ".join(absent)}. `pip install "eig3[rivals]"` installs them.')
    write("\n## The time of a step\n")
    write(
        f"ns a step and trajectory: {members} members of {n_steps} steps, {min(_FEW, members)} of them one at a time; "
        f"only the last state is kept; medians of {repeats} interleaved runs.\n"
    )
    rows = [speed_row(case, method, members, n_steps, repeats) for case in cases for method in SPEED_METHODS]
    write(text.table(SPEED_HEADER, rows))
    write("\n" + small_oscillator(repeats, n_steps))
    write("\n## Tolerances and events\n")
    write(tolerance_tables(members, repeats))
    write("\n## The time to an accuracy\n")
    write(
        f"Seconds for {accurate} members whose displacements at the end of the run have errors below {TARGET:g} of "
        f"their sizes, and the number of steps or the tolerance for it: medians of {repeats} interleaved runs.\n"
    )
    found = {name: at_equal_error(every[name], accurate, repeats) for name in chosen}
    write(text.table(["method", *found], accuracy_rows(found)))
    write("\n" + verdict(found))


# The time of a step


def speed_row(case: Case, method: str, m: int, n_steps: int, repeats: int) -> list[str]:
    """The row of one method on one ensemble. Only EIG-3 has loops by hand and in JAX."""
    alone = case.one_by_one(min(_FEW, m))
    options: dict[str, Any] = {
        "h": case.h,
        "method": method,
        "t_end": case.problem.t_span[0] + n_steps * case.h,
        "save_every": None,
    }
    kernel: dict[str, list[float]] = {"alone": [], "lanes": []}

    def one_at_a_time() -> None:
        seconds = 0.0
        for problem in alone:
            seconds += problem.integrate(**options).kernel_seconds
        kernel["alone"].append(seconds)

    def lanes() -> None:
        kernel["lanes"].append(case.problem.ensemble(**case_members, threads=1, **options).kernel_seconds)

    case_members: dict[str, Any] = case.members(m)
    runs: dict[str, Callable[[], object]] = {
        "one at a time": one_at_a_time,
        "lanes": lanes,
        "all cores": lambda: case.problem.ensemble(**case_members, **options),
    }
    if method == "eig3":
        runs["by hand"] = case.run_by_hand(m, n_steps)
        if is_installed("jax"):
            runs["jax"] = jax_eig3(case, m, n_steps)
    cpu: list[float] = []
    title = f"{case.problem.name}, {METHODS[method]().label}"
    timed: dict[str, Callable[[], float]] = {name: partial(seconds_of, call) for name, call in runs.items()}
    if "jax" in timed:
        timed["jax"] = partial(_with_cpu, runs["jax"], cpu)
    seconds = medians(timed, repeats, title)
    steps = n_steps * m
    ns = {name: 1e9 * s / steps for name, s in seconds.items()}
    ns["one at a time"] *= m / len(alone)
    in_kernel = {name: 1e9 * statistics.median(s[1:]) / steps for name, s in kernel.items()}  # after the warm-up
    in_kernel["alone"] *= m / len(alone)
    return [
        title,
        text.number(ns["one at a time"]),
        text.number(in_kernel["alone"]),
        text.number(ns["lanes"]),
        text.number(in_kernel["lanes"]),
        text.number(ns["all cores"]),
        f"{ns['lanes'] / ns['all cores']:.2f}",
        f"{ns['one at a time'] / ns['lanes']:.1f}",
        text.number(ns.get("by hand")),
        text.number(ns.get("jax")),
        f"{statistics.median(cpu[1:]) / seconds['jax']:.1f}" if "jax" in ns else "-",
        f"{compile_seconds(case, method):.2f}",
    ]


def compile_seconds(case: Case, method: str) -> float:
    """The time to compile the right-hand side for the lanes of a method."""
    problem, values = case.problem, case.members(2)
    members = check_members(problem.rhs, problem.t_span, values["u0"], problem.v0, values["params"], case.h)
    layout: Any = layout_of(members, problem.stepper(h=case.h, method=method).running, 0, threads=1)
    begin = time.perf_counter()
    compile_rhs(problem.rhs.py_func, layout)
    return time.perf_counter() - begin


def small_oscillator(repeats: int, n_steps: int) -> str:
    """The line of a thousand members of the smallest problem."""
    problem = replace(problems.single_dof(), energy=None)
    options: dict[str, Any] = {
        "u0": np.linspace(0.5, 1.5, 1000),
        "h": 1e-3,
        "t_end": 1e-3 * n_steps,
        "save_every": None,
    }
    runs = {
        "on one core": partial(seconds_of, lambda: problem.ensemble(**options, threads=1)),
        "on all cores": partial(seconds_of, lambda: problem.ensemble(**options)),
    }
    seconds = medians(runs, repeats, problem.name)
    times = " and ".join(f"{text.number(1e3 * s)} ms {where}" for where, s in seconds.items())
    return f"{problem.name}, EIG-3, 1000 members of {n_steps} steps: {times}."


def _with_cpu(call: Callable[[], object], cpu: list[float]) -> float:
    """Return the seconds of a call; append its processor time to `cpu`."""
    used = time.process_time()
    seconds = seconds_of(call)
    cpu.append(time.process_time() - used)
    return seconds


# The time to an accuracy


@dataclass(frozen=True)
class Found:
    """The seconds of a contestant at its fastest setting that reaches the accuracy, or the word that says why not."""

    is_ours: bool
    seconds: float | None = None
    setting: str = ""
    members: int | None = None  # that ran, if they were fewer
    word: str = ""


def contestants(case: Case) -> list[Contestant]:
    fixed = [
        Contestant(METHODS[name]().label, partial(_ours, name), _steps(case, name))
        for name in ACCURACY_METHODS
        if case.by_hand
    ]
    controlled = [
        Contestant(f"{METHODS[name]().label}, tolerances", partial(_with_tolerances, name))
        for name in TOLERANCE_METHODS
    ]
    rivals = [rival for rival in ENSEMBLE_RIVALS if rival.is_installed and not rival.cannot(case)]
    return [*fixed, *controlled, *rivals]


def _steps(case: Case, method: str) -> list[int]:
    """Numbers of steps from the stability limit on. A run above it diverges, which takes long to explain."""
    fewest = np.ptp(case.problem.t_span) / case.longest_step(method)
    return [int(n) for n in np.ceil(fewest * _LADDER)]


def _ours(method: str, case: Case, m: int) -> Callable[[int], Run]:
    span = np.ptp(case.problem.t_span)
    options: dict[str, Any] = {**case.members(m), "method": method, "save_every": None}

    def at(n_steps: int) -> Run:
        return lambda: _rows(case.problem.ensemble(h=span / n_steps, **options).u, case)[:, -1]

    return at


def _with_tolerances(method: str, case: Case, m: int) -> Callable[[float], Run]:
    options: dict[str, Any] = {**case.members(m), "method": method}
    return lambda rtol: lambda: _rows(case.problem.ensemble(rtol=rtol, **options).u, case)[:, -1]


def _rows(u: np.ndarray, case: Case) -> np.ndarray:
    """Displacements of shape (m, s, n), also for the scalar form."""
    return u.reshape(*u.shape[:2], np.size(case.problem.u0))


class Reference:
    """The displacements at the end by RK8 with small steps or tolerances, and the largest ones of each member."""

    def __init__(self, case: Case, m: int) -> None:
        if not case.by_hand:
            u = _rows(case.problem.ensemble(rtol=_LEAST_RTOL, method="rk8", save_every=1, **case.members(m)).u, case)
            last = np.isfinite(u[..., 0]).sum(axis=1) - 1
            self.ends, self.sizes = u[np.arange(m), last], np.nanmax(np.abs(u), axis=1)
            return
        span = np.ptp(case.problem.t_span)
        n_steps = _SAMPLES * math.ceil(_REFERENCE * span / case.longest_step("rk8") / _SAMPLES)
        options: dict[str, Any] = {"h": span / n_steps, "method": "rk8", "save_every": n_steps // _SAVED}
        options |= case.members(m)
        u = _rows(case.problem.ensemble(**options).u, case)
        self.ends, self.sizes = u[:, -1].copy(), np.abs(u).max(axis=1)

    def error(self, ends: np.ndarray) -> float:
        """The largest error of some first members, relative to the size of each displacement; NaN if one diverged."""
        m = len(ends)
        return float((np.abs(ends - self.ends[:m]) / self.sizes[:m]).max())


def at_equal_error(case: Case, m: int, repeats: int) -> dict[str, Found]:
    """What each method and rival needs, by its label."""
    reference = Reference(case, m)
    found: dict[str, Found] = {}
    runs: dict[str, tuple[Callable[[], float], bool, str, int]] = {}
    for contestant in contestants(case):
        text.status(f"{case.problem.name}, {contestant.label}: looking for the setting")
        reached = _search(contestant, case, m, reference)
        if reached is None:
            found[contestant.label] = Found(contestant.is_ours, word="not reached")
        else:
            run, setting, ran = reached
            shown = str(setting) if isinstance(setting, int) else f"{setting:.2g}"
            runs[contestant.label] = partial(seconds_of, run), contestant.is_ours, shown, ran
    enough = repeats * _LONGEST
    timed = interleave({label: run for label, (run, *_) in runs.items()}, repeats, case.problem.name, enough)
    for label, (_, is_ours, shown, ran) in runs.items():
        seconds = statistics.median(timed[label]) * m / ran
        found[label] = Found(is_ours, seconds, shown, ran if ran < m else None)
    for rival in ENSEMBLE_RIVALS:
        if not rival.is_installed:
            found[rival.label] = Found(False, word="not installed")
        elif rival.cannot(case):
            found[rival.label] = Found(False, word=rival.cannot(case))
    return found


def _search(contestant: Contestant, case: Case, m: int, reference: Reference) -> tuple[Run, float, int] | None:
    """The run with the first setting that reaches the accuracy, this setting, and the members of the run.

    A few members choose the setting; if it is not enough for all, the next one follows.
    """
    pilots = min(_PILOTS, m)
    settings = iter(contestant.settings)
    at, all_at, ran = contestant.prepare(case, pilots), None, m
    for setting in settings:
        run = at(setting)
        if not reference.error(run()) <= TARGET:
            continue
        if all_at is None:
            ran = _affordable(seconds_of(run), pilots, m)
            all_at = contestant.prepare(case, ran)
        run = all_at(setting)
        if reference.error(run()) <= TARGET:
            return run, setting, ran
    return None


def _affordable(seconds: float, pilots: int, m: int) -> int:
    """As many members as run in the longest time, if so many pilots take this time."""
    return min(m, max(pilots, int(pilots * _LONGEST / seconds)))


def accuracy_rows(found: dict[str, dict[str, Found]]) -> list[list[str]]:
    labels = list(dict.fromkeys(label for cells in found.values() for label in cells))
    return [[label, *(_cell(cells[label]) for cells in found.values())] for label in labels]


def _cell(found: Found) -> str:
    if found.seconds is None:
        return found.word
    scaled = f", from {found.members}" if found.members else ""
    return f"{text.number(found.seconds)} ({found.setting}{scaled})"


def _fastest(cells: dict[str, Found], is_ours: bool) -> list[tuple[float, str]]:
    """The seconds and labels of our methods or of the rivals, the fastest first."""
    return sorted((f.seconds, label) for label, f in cells.items() if f.seconds is not None and f.is_ours == is_ours)


def verdict(found: dict[str, dict[str, Found]]) -> str:
    """The sentences that name the fastest of our methods and of the rivals, and where a rival is ahead."""
    sentences = []
    for name, cells in found.items():
        ours, *_ = _fastest(cells, is_ours=True)
        rival = next(iter(_fastest(cells, is_ours=False)), None)
        if rival is None:
            sentences.append(f"{name}: {ours[1]} takes {text.number(ours[0])} s, and no rival ran.")
        else:
            ahead = "A rival is ahead: " if rival[0] < ours[0] else ""
            sentences.append(
                f"{name}: {ahead}{ours[1]} takes {text.number(ours[0] / rival[0])} of the time of {rival[1]}."
            )
    return "\n".join(sentences)


# A million members


def _million() -> str:
    """Run a million members in a new process, and return the line that it prints."""
    command = [sys.executable, "-m", "eig3.bench.ensemble_million"]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()
