"""`eig3 run`: one problem, its history in files, a picture, and what became of its energy."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from .methods import Method
from .problem import Problem
from .solution import Solution

_STATES = 2000  # saved in a run, at most,
_VALUES = 4_000_000  # and no more numbers than this
_CSV_VALUES = 200_000  # a longer history goes to the NPZ file only
_LINES = 6  # degrees of freedom in a picture


def run(
    build: Callable[..., Problem],
    *,
    h: float | None = None,
    method: str | Method = "eig3",
    out: Path | None = None,
    write: Callable[[str], None] = print,
) -> Solution:
    """Run one of `eig3.problems`; write its history and picture to `out`.

    Raises
    ------
    TypeError, ValueError
        As `eig3.integrate` does.
    """
    problem = build(work=True) if "work" in inspect.signature(build).parameters else build()
    step = h or problem.h or problem.critical_step(method=method).h / 10
    span = problem.t_span[1] - problem.t_span[0]
    states = min(_STATES, _VALUES // (2 * np.size(problem.u0)))
    every = max(1, round(span / step / states))
    solution = problem.integrate(h=step, method=method, save_every=every, invariants={})
    write(f"{problem.name}: {problem.source}")
    write("".join(f"  {line}\n" for line in problem.note.splitlines()) + str(solution))
    write(energy_balance(problem, solution))
    if out is not None:
        write(f"\nWritten to {out}: {', '.join(_save(problem, solution, out))}")
    return solution


def energy_balance(problem: Problem, solution: Solution) -> str:
    """The energy at both ends, and how far its change is from the work done, where that is followed."""
    if problem.energy is None:
        return "  energy: none is known of this problem"
    states = zip(solution.u, solution.v, solution.t, strict=True)
    left = np.array([problem.energy_of(*state) for state in states])  # of a scene that follows it, less the work
    work = solution.v[:, -1] if problem.follows_work else np.zeros(len(solution.t))
    energy = left + work
    lines = [f"  energy: {energy[0]:.6g} at the start, {energy[-1]:.6g} at the end"]
    if problem.follows_work:
        lines.append(f"  work done: {work[-1]:.6g} at the end, {work.min():.6g} to {work.max():.6g} on the way")
    unaccounted = np.abs(left - left[0]).max()
    lines.append(f"  change of energy{' less work' * problem.follows_work}: {unaccounted:.3g} at most")
    return "\n".join(lines)


def _save(problem: Problem, solution: Solution, out: Path) -> list[str]:
    """Write what can be written; return the names."""
    t, u, v = solution.t, solution.u, solution.v
    names = [f"{problem.name}.npz"]
    np.savez_compressed(out / names[0], t=t, u=u, v=v)
    table = np.column_stack([t, u, v])
    if table.size <= _CSV_VALUES:
        names.append(f"{problem.name}.csv")
        columns = [f"{x}{j}" for x in "uv" for j in range(table.shape[1] // 2)]
        np.savetxt(out / names[-1], table, delimiter=",", header=",".join(["t", *columns]), comments="")
    try:
        from matplotlib.figure import Figure
    except ImportError:
        return [*names, "no picture, since matplotlib is not installed (pip install 'eig3[plot]')"]
    figure = Figure(figsize=(9, 6), layout="constrained")
    figure.suptitle(f"{problem.name}, {solution.method.label}, h = {solution.h:.3g} s")
    (problem.draw or _draw)(figure, solution)
    names.append(f"{problem.name}.png")
    figure.savefig(out / names[-1], dpi=130)
    return names


def _draw(figure: Any, solution: Solution) -> None:
    """The first degrees of freedom against time."""
    u, v = (x.reshape(len(solution.t), -1)[:, :_LINES] for x in (solution.u, solution.v))
    for axes, values, name in zip(figure.subplots(2, sharex=True), (u, v), "uv", strict=True):
        for j in range(values.shape[1]):
            label = f"${name}_{j}$" if solution.u.ndim > 1 else f"${name}$"
            axes.plot(solution.t, values[:, j], linewidth=1, label=label)
        axes.set_ylabel("displacement (the problem's unit)" if name == "u" else "velocity (that unit/s)")
        axes.legend(loc="center left", bbox_to_anchor=(1, 0.5))
    axes.set_xlabel("t (s)")
