"""`eig3 run`: one problem, its history in files, a picture, and what became of its energy."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from .checks import check_h, check_span
from .critical import NoCriticalStepError
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
    t_end: float | None = None,
    out: Path | None = None,
    write: Callable[[str], None] = print,
) -> Solution:
    """Run one of `eig3.problems`; write its history and picture to `out`.

    Raises
    ------
    TypeError, ValueError
        As `eig3.integrate` does.
    """
    options: dict[str, Any] = {"work": True} if "work" in inspect.signature(build).parameters else {}
    if t_end is not None:
        options["t_end"] = check_span((0.0, t_end))[1]
    problem = build(**options)
    span = problem.t_span[1] - problem.t_span[0]
    h = _step(problem, method, span) if h is None else check_h(h)
    states = min(_STATES, _VALUES // (2 * np.size(problem.u0)))
    every = max(1, round(min(span / h, 2**53) / states))
    solution = problem.integrate(h=h, method=method, save_every=every, invariants={})
    write(f"{problem.name}: {problem.source}")
    write("".join(f"  {line}\n" for line in problem.note.splitlines()) + str(solution))
    if solution.success:
        write(_balance(problem, solution))
    if out is not None:
        write(f"\nWritten to {out}: {', '.join(_save(problem, solution, out))}")
    return solution


def _step(problem: Problem, method: str | Method, span: float) -> float:
    """The problem's own, or one that is short beside the span and what is stable at the start."""
    if problem.h is not None:
        return problem.h
    try:
        return min(span / _STATES, problem.critical_step(method=method).h / 10)
    except NoCriticalStepError:
        return span / _STATES


def _energy_and_work(problem: Problem, solution: Solution) -> tuple[np.ndarray, np.ndarray]:
    """The mechanical energy and the work done so far, at the saved states; no work where it is not followed."""
    work = solution.v[:, -1] if problem.follows_work else np.zeros(len(solution.t))
    return problem.energy_of(solution.u, solution.v, solution.t) + work, work


def _unit(problem: Problem) -> str:
    return " J" if problem.note else ""  # scenes are in SI units, other problems often per mass


def _balance(problem: Problem, solution: Solution) -> str:
    """The energy at both ends, and how far its change is from the work done, where that is followed."""
    if problem.energy is None:
        return "  energy: none is known of this problem"
    energy, work = _energy_and_work(problem, solution)
    J = _unit(problem)
    lines = [
        f"  energy: {energy[0]:.6g}{J} at the start, {energy[-1]:.6g}{J} at the end, "
        f"{energy.min():.6g} to {energy.max():.6g}{J} on the way"
    ]
    change = energy - work
    unaccounted = np.abs(change - change[0]).max()
    if problem.follows_work:
        lines.append(
            f"  work done: {work[-1]:.6g}{J} at the end, {work.min():.6g} to {work.max():.6g}{J} on the way; "
            f"change of energy less work: {unaccounted:.3g}{J} at most"
        )
    else:
        lines.append(f"  change of energy: {unaccounted:.3g}{J} at most, where there should be none")
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
        if problem.follows_work:
            columns[len(columns) // 2 - 1], columns[-1] = "integral of work", "work"
        np.savetxt(out / names[-1], table, delimiter=",", header=",".join(["t", *columns]), comments="")
    try:
        from matplotlib.figure import Figure
    except ImportError:
        return [*names, "no picture, since matplotlib is not installed (pip install 'eig3[plot]')"]
    with_energy = problem.energy is not None and solution.success
    figure = Figure(figsize=(9, 8 if with_energy else 6), layout="constrained")
    figure.suptitle(f"{problem.name}, {solution.method.label}, h = {solution.h:.3g} s")
    if with_energy:
        response, energy = figure.subfigures(2, 1, height_ratios=(3, 1))
        _draw_energy(energy, problem, solution)
    else:
        response = figure
    (problem.draw or _draw)(response, solution)
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
        axes.set_ylabel("displacement\n(its own unit)" if name == "u" else "velocity\n(that unit/s)")
        axes.legend(loc="center left", bbox_to_anchor=(1, 0.5))
    axes.set_xlabel("t (s)")


def _draw_energy(figure: Any, problem: Problem, solution: Solution) -> None:
    """What has become of the energy since the start, and the work that accounts for it."""
    energy, work = _energy_and_work(problem, solution)
    axes = figure.subplots()
    axes.plot(solution.t, energy - energy[0], label="energy")
    if problem.follows_work:
        axes.plot(solution.t, work, "--", label="work done")
    axes.set_ylabel(f"since the start\n({_unit(problem).strip() or 'its own unit'})")
    axes.set_xlabel("t (s)")
    axes.legend(loc="center left", bbox_to_anchor=(1, 0.5))
