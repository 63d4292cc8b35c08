"""Time per step on elastic cubes of 10^3 to 10^6 degrees of freedom, with lumped and with consistent masses.

Beside EIG-3 and the central difference of eig3, with one thread and with all, the table has the same methods in C with
compressed rows and in Python with SciPy's product, the methods of OpenSees, and the time in which the memory delivers
the stiffness. A second table says which method reaches a per cent first, measured against the exact motion by modes.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from eig3 import problems
from eig3.command_line import count
from eig3.methods import METHODS
from eig3.problem import Problem

from . import text
from .c import compile_with, has_compiler, version
from .choices import add_repeats
from .environment import in_words
from .rivals import opensees
from .solids import cube, size
from .timing import continued_run, medians

SUMMARY = "structures with up to a million degrees of freedom, beside C, SciPy and OpenSees"
SIDES = 6, 14, 32, 69  # elements of a side of the cube: 10^3, 10^4, 10^5 and 10^6 degrees of freedom
_SOURCE = Path(__file__).parent / "c_sources" / "structure.c"
_CONSISTENT = 20_000  # degrees of freedom up to which the consistent mass is factored
_IN_MEMORY = 5_000  # degrees of freedom; with a smaller stiffness, the call of NumPy takes most of the time
_OPENSEES = {"CentralDifference": 10_000, "Newmark": 1_000}  # degrees of freedom; beyond, a step takes seconds
_STEPS_OF_OPENSEES = 10
_SECONDS = 0.2  # of a run
_PER_CENT = 0.01
_METHODS = "eig3", "cd", "rk2", "rk3", "rk4", "ab2", "ab3", "rk5", "rk8"
_WITHOUT_DAMPING = "bm6", "rkn12"
HEADER = ["degrees of freedom, run", "us/step", "/ C with rows", "ns/step and entry"]
_ERRORS = 1e-2, 1e-3, 1e-4  # of the frame that yields, relative to its largest displacement
_TRUTH = 2e-5  # s: the step of EIG-3 for its true motion, whose error is below 1e-6
_SAMPLE = 0.02  # s, between the compared states
YIELDS = ["error", "run", "h (s)", "error reached", "ms", "/ EIG-3"]
REACHED = ["structure, method", "h (s)", "steps", "ms", "/ fastest"]


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--sides", nargs="+", type=count, default=SIDES, metavar="N", help="elements of a side of the cubes"
    )
    add_repeats(parser, 9)


def benchmark(
    *, sides: tuple[int, ...] = SIDES, repeats: int = 9, write: Callable[[str], None] = print
) -> dict[str, dict[str, float]]:
    """Print the tables; return the seconds of a step of each run, by cube."""
    threads = os.cpu_count() or 1
    write(f"Machine: {in_words()}")
    write(f"C: {version()}, -O3 -march=native")
    write(f"OpenSees: {opensees.version()}")
    write("Elastic cubes, no state stored; medians of interleaved runs. Entries: nonzeros of the stiffness.\n")
    rows, found = [], {}
    for side in sides:
        seconds, entries = compare(side, threads, repeats)
        found[str(size(side))] = seconds
        c = seconds.get("EIG-3 in C, rows")
        rows += [
            [
                f"{size(side)}, {name}",
                text.number(1e6 * value),
                text.ratio(value / c) if c else "-",
                text.number(1e9 * value / entries),
            ]
            for name, value in seconds.items()
        ]
    write(text.table(HEADER, rows))
    write("\nThe fastest method for an error of 1 % of the largest displacement, over the whole motion:\n")
    write(text.table(REACHED, [row for name, problem in motions().items() for row in reach(name, problem, repeats)]))
    write("\nA frame of 94 degrees of freedom with 34 plastic hinges, 10 s, at equal error of its joints:\n")
    write(text.table(YIELDS, yielding(repeats)))
    return found


def yielding(repeats: int, t_end: float = 10.0) -> list[list[str]]:
    """Return the rows of the frame that yields: the longest steps of EIG-3 and of OpenSees that reach each error."""
    problem = problems.yielding_frame(t_end=t_end)
    times = np.arange(0, t_end + _SAMPLE / 2, _SAMPLE)
    columns = [problem.names.index(name) for name in opensees.frame_names(problem)]

    def histories(h: float) -> np.ndarray:
        return problem.integrate(h=h, t_eval=times, invariants={}, raise_on_failure=False).u[:, columns]

    def of_opensees(h: float, method: str) -> np.ndarray:
        return opensees.frame_history(problem, method, h, round(_SAMPLE / h), len(times))

    def timed_opensees(h: float, method: str) -> Callable[[], float]:
        return opensees.frame_run(problem, method, h, round(t_end / h))

    def timed(h: float) -> Callable[[], float]:
        prepared = problem.prepare(h=h, save_every=None, invariants={})
        return lambda: prepared().kernel_seconds

    truth = histories(_TRUTH)
    codes: dict[str, tuple[Any, Any, float]] = {"EIG-3": (histories, timed, problem.critical_step().limit)}
    for method, longest in (("Newmark", _SAMPLE), ("CentralDifference", 1e-3)) if opensees.is_there() else ():
        both = partial(of_opensees, method=method), partial(timed_opensees, method=method)
        codes[f"OpenSees, {method}"] = *both, longest
    runs: dict[str, Callable[[], float]] = {}
    chosen: dict[str, tuple[float, str, float, float]] = {}
    for code, (history, run, longest) in codes.items():
        for wanted, (h, error) in _reaching(history, truth, longest).items():
            name = f"{wanted:g}, {code}"
            runs[name], chosen[name] = run(h), (wanted, code, h, error)
    seconds = medians(runs, repeats, "the frame that yields")
    rows = []
    for name, (wanted, code, h, error) in sorted(chosen.items(), key=lambda pair: (-pair[1][0], pair[1][1])):
        ratio = seconds[name] / seconds[f"{wanted:g}, EIG-3"]
        numbers = map(text.number, (h, error, 1e3 * seconds[name]))
        rows.append([f"{wanted:g}", code, *numbers, text.ratio(ratio)])
    return rows


def _reaching(
    history: Callable[[float], np.ndarray], truth: np.ndarray, longest: float
) -> dict[float, tuple[float, float]]:
    """Return for each error the longest step that reaches it, a part of the time between samples, and its error."""
    found: dict[float, tuple[float, float]] = {}
    parts, largest = int(np.ceil(_SAMPLE / longest)), np.abs(truth).max()
    while len(found) < len(_ERRORS) and parts <= _SAMPLE / _TRUTH:
        u = history(_SAMPLE / parts)
        error = np.abs(u - truth).max() / largest if u.shape == truth.shape else np.nan
        for wanted in _ERRORS:
            if wanted not in found and error <= wanted:
                found[wanted] = _SAMPLE / parts, float(error)
        parts = max(parts + 1, round(1.15 * parts))
    return found


def compare(side: int, threads: int, repeats: int) -> tuple[dict[str, float], int]:
    """Return the median seconds of a step of each run on a cube, and the entries of its stiffness."""
    import eig3

    masses, K = cube(side)
    n, h = masses.size, 0.2 / (side * np.sqrt(1.5e3))  # two thirds of the time in which a wave crosses an element
    v0 = np.random.default_rng(0).normal(size=n)
    given: dict[str, Any] = {"t_span": (0.0, 1.0), "v0": v0}
    steps = max(2, int(_SECONDS / (2e-9 * K.nnz)))
    runs: dict[str, Callable[[], float]] = {}
    per_step: dict[str, int] = {}

    def add(name: str, run: Callable[[], float], n_steps: int = steps) -> None:
        runs[name], per_step[name] = run, n_steps

    one = eig3.linear(masses, None, K, **given)
    for method in ("eig3", "cd"):
        add(METHODS[method]().label, continued_run(one.stepper(h=h, method=method), steps))
    if threads > 1:
        shared = eig3.linear(masses, None, K, **given, threads=threads)
        add(f"EIG-3, {threads} threads", continued_run(shared.stepper(h=h), steps))
    rows = K.tocsr()
    rows.eliminate_zeros()
    if n <= _CONSISTENT:
        consistent = eig3.linear(_consistent(side), None, K, **given)
        add("EIG-3, consistent mass", continued_run(consistent.stepper(h=h / 2), steps))
    if has_compiler():
        for method, label in (("eig3", "EIG-3"), ("cd", "CD")):
            state = np.zeros((4, n))
            state[1] = v0 if method == "eig3" else h * v0
            add(f"{label} in C, rows", in_c(method, masses, rows, h, steps, state))
    add("CD, SciPy's product", partial(_in_python, masses, rows, h, max(2, steps // 10), v0), max(2, steps // 10))
    if n >= _IN_MEMORY:
        add("memory alone", partial(_read, K.data.nbytes + K.indices.nbytes, steps))
    for method, most in _OPENSEES.items():
        if opensees.is_there() and n <= most:
            add(f"OpenSees {method}", opensees.cube_run(side, method, h, _STEPS_OF_OPENSEES), _STEPS_OF_OPENSEES)
    seconds = medians(runs, repeats, f"{n} degrees of freedom")
    return {name: value / per_step[name] for name, value in seconds.items()}, rows.nnz


def in_c(method: str, masses: np.ndarray, K: Any, h: float, steps: int, state: np.ndarray) -> Callable[[], float]:
    """Return a run of the C loop, which moves `state`, shape (4, n): u, v and room for accelerations.

    In the central difference, increments of u take the place of v.
    """
    with tempfile.TemporaryDirectory() as folder:  # code that is loaded no longer needs its file
        target = Path(folder) / "structure.so"
        compile_with("-std=c99", "-O3", "-march=native", "-shared", "-fPIC", str(_SOURCE), "-o", str(target))
        function = getattr(ctypes.CDLL(str(target)), method)
    matrix = K.data, K.indices.astype(np.int32), K.indptr.astype(np.int64), masses
    pointers = [ctypes.c_void_p(array.ctypes.data) for array in (*matrix, *state)]
    keep = matrix, state

    def run() -> float:
        assert keep  # the arrays must live as long as their addresses
        begin = time.perf_counter()
        function(ctypes.c_long(masses.size), *pointers[:4], ctypes.c_double(h), ctypes.c_long(steps), *pointers[4:])
        return time.perf_counter() - begin

    return run


def _in_python(masses: np.ndarray, K: Any, h: float, steps: int, v0: np.ndarray) -> float:
    """The central difference as one writes it in Python."""
    u, change = np.zeros_like(v0), h * v0
    begin = time.perf_counter()
    for _ in range(steps):
        change -= h * h * (K @ u) / masses
        u += change
    return time.perf_counter() - begin


def _read(size: int, steps: int) -> float:
    """The time to read so many bytes, steps times: their sum, which NumPy vectorises."""
    array = np.ones(size // 8)
    begin = time.perf_counter()
    for _ in range(min(steps, 20)):
        array.sum()
    return (time.perf_counter() - begin) * steps / min(steps, 20)


def _consistent(side: int) -> Any:
    """Return the consistent mass of the cube: the product of the masses of bars in the three directions."""
    import scipy.sparse

    n = side + 1
    bar = scipy.sparse.diags_array([np.r_[2.0, np.full(n - 2, 4.0), 2.0], *[np.ones(n - 1)] * 2], offsets=[0, 1, -1])
    bar = scipy.sparse.csr_array(bar) / (6 * side)
    nodes = scipy.sparse.kron(bar[1:][:, 1:], scipy.sparse.kron(bar, bar))
    return scipy.sparse.kron(nodes, scipy.sparse.eye_array(3)).tocsr()


def motions() -> dict[str, Problem]:
    """Return the structures of the second table: a smooth motion, and one with all modes."""
    frame = problems.ten_storey_frame(t_end=10.0)
    hit = np.random.default_rng(1).normal(size=np.size(frame.u0))
    hit[2::3] = 0.0  # joints are hit, and not turned
    shaken = problems.ten_storey_frame(t_end=1.0, peak=0.0, xi=0.0)
    struck = shaken.with_(v0=hit, exact=None)
    from eig3.structures import modal_solution

    return {"frame, record": frame, "frame, struck": struck.with_(exact=partial(modal_solution, struck))}


def reach(name: str, problem: Problem, repeats: int) -> list[list[str]]:
    """The rows of a structure: the longest step of each method that reaches a per cent, by factors of the root of 2."""
    runs, chosen = {}, {}
    for method in (*_METHODS, *(() if problem.uses_velocity else _WITHOUT_DAMPING)):
        h = longest_step(problem, method)
        if h:
            chosen[METHODS[method]().label] = h
            prepared = problem.prepare(h=h, method=method, save_every=None, invariants={}, events=None)
            runs[METHODS[method]().label] = lambda prepared=prepared: prepared().kernel_seconds
    seconds = medians(runs, repeats, name)
    fastest, span = min(seconds.values()), problem.t_span[1] - problem.t_span[0]
    return [
        [
            f"{name}, {label}",
            text.number(chosen[label]),
            f"{span / chosen[label]:.0f}",
            text.number(1e3 * value),
            text.ratio(value / fastest),
        ]
        for label, value in sorted(seconds.items(), key=lambda pair: pair[1])
    ]


def longest_step(problem: Problem, method: str) -> float | None:
    """Return the longest step with which a method reaches a per cent, or None if none of a thousandth of it does."""
    assert problem.exact
    times = np.linspace(*problem.t_span, 401)
    exact = problem.exact(times)[0]
    largest = np.abs(exact).max()
    h = (problem.t_span[1] - problem.t_span[0]) / 400
    for _ in range(24):
        run = problem.integrate(h=h, method=method, t_eval=times, invariants={}, raise_on_failure=False, events=None)
        if run.success and np.abs(run.u - exact).max() <= _PER_CENT * largest:
            return h
        h /= np.sqrt(2)
    return None
