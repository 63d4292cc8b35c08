"""`eig3 bench speed`: ns/step of the kernels in both modes, beside the same loops written by hand."""

import statistics
import time
from collections.abc import Callable, Sequence
from typing import Any

import numba
import numpy as np
from numba.types import FunctionType

from eig3 import problems
from eig3.kernels.jit import OPTIONS, SCALAR, VECTOR
from eig3.methods import METHODS
from eig3.problem import Problem

from . import handwritten, text
from .environment import in_words
from .timing import Storage, interleave

N_STEPS = 500_000
CASES = (
    (problems.single_dof, 1e-3),
    (problems.hardening_spring, 1e-5),
    (problems.softening_spring, 1e-4),
    (problems.spring_pendulum, 1e-4),
)
HEADER = ["problem, method", "pointer", "by hand", "ratio", "inline", "by hand", "ratio"]


def run(*, methods: Sequence[str] | None = None, repeats: int = 9, write: Callable[[str], None] = print) -> None:
    """Print the table of `methods`, all if None."""
    chosen = choose(methods, list(METHODS))
    write(f"Machine: {in_words()}")
    write(f"ns/step with every state stored: medians of {repeats} interleaved runs of {N_STEPS} steps.\n")
    rows = [row for build, h in CASES for name in chosen for row in compare(build(), h, name, repeats)]
    text.status("")
    write(text.table(HEADER, rows))
    ratios = [float(row[i]) for row in rows for i in (3, 6) if row[i] != "-"]
    write(f"\nRatio of the kernel to the loop by hand: {min(ratios):.2f} to {max(ratios):.2f}.")


def choose(names: Sequence[str] | None, known: Sequence[str], option: str = "--method") -> Sequence[str]:
    """The names asked for on the command line, all those known if None."""
    unknown = [name for name in names or () if name not in known]
    if unknown:
        raise SystemExit(f"eig3 bench: {option} must be one of {', '.join(known)}, not {unknown[0]}.")
    return names or known


def compare(problem: Problem, h: float, name: str, repeats: int) -> list[list[str]]:
    """The row of one method on one problem; the pendulum has one more, for a loop in registers."""
    vector = np.ndim(problem.u0) == 1
    by_hand = getattr(handwritten, f"{name}_{'pair' if vector else 'scalar'}")
    storage = Storage(np.size(problem.u0) if vector else None, N_STEPS)
    runs = {
        "pointer": ours(problem, h, name, storage, inline=False),
        "pointer by hand": theirs(problem, h, by_hand, storage, inline=False),
        "inline": ours(problem, h, name, storage, inline=True),
        "inline by hand": theirs(problem, h, by_hand, storage, inline=True),
    }
    if vector and name == "eig3":
        runs["registers"] = theirs(problem, h, handwritten.pendulum_in_registers, storage, inline=True)
    seconds = interleave(runs, repeats, lambda what: text.status(f"{problem.name}, {METHODS[name].label}, {what}"))
    ns = {key: 1e9 * statistics.median(values) / N_STEPS for key, values in seconds.items()}
    title = f"{problem.name}, {METHODS[name].label}"
    cells = [[f"{ns[a]:.1f}", f"{ns[b]:.1f}", f"{ns[a] / ns[b]:.2f}"] for a, b in
             (("pointer", "pointer by hand"), ("inline", "inline by hand"))]  # fmt: skip
    rows = [[title, *cells[0], *cells[1]]]
    if "registers" in ns:
        rows.append([f"{title}, its equations in registers", "-", "-", "-", "-", f"{ns['registers']:.1f}", "-"])
    return rows


def ours(problem: Problem, h: float, name: str, storage: Storage, *, inline: bool) -> Callable[[], float]:
    start = problem.stepper(h=h, method=name, inline=inline)

    def run() -> float:
        stepper = start.fork()
        stepper.advance(N_STEPS, 1, storage.u, storage.v)
        return stepper.seconds

    return run


def initial_state(problem: Problem) -> tuple[Any, Any]:
    """u and v at the start: floats, or new arrays that a loop may change."""
    u, v = (np.array(x, dtype=np.float64) for x in (problem.u0, problem.v0))
    return (u, v) if u.ndim else (float(u), float(v))


def theirs(problem: Problem, h: float, function: Callable, storage: Storage, *, inline: bool) -> Callable[[], float]:
    form = VECTOR if np.ndim(problem.u0) else SCALAR
    params = np.array(problem.params, dtype=np.float64)
    if inline:
        loop = numba.njit(**OPTIONS)(function)
    else:
        array = numba.types.Array(numba.float64, 1, "C")
        state = array if form is VECTOR else numba.float64
        types = (FunctionType(form.rhs), state, state, array, numba.float64, numba.int64, form.rows, form.rows)
        loop = numba.njit(numba.void(*types), **OPTIONS)(function)

    def run() -> float:
        u, v = initial_state(problem)
        begin = time.perf_counter()
        loop(problem.rhs, u, v, params, h, N_STEPS, storage.u, storage.v)
        return time.perf_counter() - begin

    return run
