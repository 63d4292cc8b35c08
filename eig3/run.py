"""`eig3 run`: one problem, its history in files, a picture, and what became of its energy."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .analysis.critical import NoCriticalStepError
from .bench.text import NO_PICTURES
from .checks import check_h, check_span
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
    balance = _Balance.of(problem, solution) if problem.energy is not None and solution.success else None
    if balance:
        write(balance.told())
    elif solution.success:
        write("  energy: none is known of this problem")
    if out is not None:
        write(f"\nWritten to {out}: {_save(problem, solution, balance, out)}")
    return solution


def _step(problem: Problem, method: str | Method, span: float) -> float:
    """The problem's own, or one that is short beside the span and what is stable at the start."""
    if problem.h is not None:
        return problem.h
    try:
        return min(span / _STATES, problem.critical_step(method=method).h / 10)
    except NoCriticalStepError:
        return span / _STATES


@dataclass(frozen=True)
class _Balance:
    """The mechanical energy and the work done so far, at the saved states; no work where it is not followed."""

    energy: np.ndarray
    work: np.ndarray | None
    unit: str

    @classmethod
    def of(cls, problem: Problem, solution: Solution) -> _Balance:
        unit = " J" if problem.note else ""  # scenes are in SI units, other problems often per mass
        energy = problem.energy_of(solution.u, solution.v, solution.t)
        return cls(energy, solution.integrals.get("work"), unit)

    def told(self) -> str:
        """The energy at both ends, and how far its change is from the work done, where that is followed."""
        energy, work, J = self.energy, self.work, self.unit
        change = energy if work is None else energy - work
        unaccounted = np.abs(change - change[0]).max()
        lines = [
            f"  energy: {energy[0]:.6g}{J} at the start, {energy[-1]:.6g}{J} at the end, "
            f"{energy.min():.6g} to {energy.max():.6g}{J} on the way"
        ]
        if work is None:
            lines.append(f"  change of energy: {unaccounted:.3g}{J} at most, where there should be none")
        else:
            lines.append(
                f"  work done: {work[-1]:.6g}{J} at the end, {work.min():.6g} to {work.max():.6g}{J} on the way; "
                f"change of energy less work: {unaccounted:.3g}{J} at most"
            )
        return "\n".join(lines)

    def draw(self, figure: Any, t: np.ndarray) -> None:
        """What has become of the energy since the start, and the work that accounts for it."""
        axes = figure.subplots()
        axes.plot(t, self.energy - self.energy[0], label="energy")
        if self.work is not None:
            axes.plot(t, self.work, "--", label="work done")
        axes.set_ylabel(f"since the start\n({self.unit.strip() or 'its own unit'})")
        axes.set_xlabel("t (s)")
        axes.legend(loc="center left", bbox_to_anchor=(1, 0.5))


def _save(problem: Problem, solution: Solution, balance: _Balance | None, out: Path) -> str:
    """Write what can be written; return the names."""
    t, u, v = solution.t, solution.u, solution.v
    names = [f"{problem.name}.npz"]
    arrays: dict[str, Any] = {"t": t, "u": u, "v": v, **solution.integrals}
    np.savez_compressed(out / names[0], **arrays)
    table = np.column_stack([t, u, v, *solution.integrals.values()])
    if table.size <= _CSV_VALUES:
        names.append(f"{problem.name}.csv")
        columns = [f"{x}{j}" for x in "uv" for j in range(np.size(problem.u0))]
        header = ",".join(["t", *columns, *solution.integrals])
        np.savetxt(out / names[-1], table, delimiter=",", header=header, comments="")
    try:
        from matplotlib.figure import Figure
    except ImportError:
        return ", ".join(names) + NO_PICTURES
    figure = Figure(figsize=(9, 8 if balance else 6), layout="constrained")
    figure.suptitle(f"{problem.name}, {solution.method.label}, h = {solution.h:.3g} s")
    response = figure
    if balance:
        response, below = figure.subfigures(2, 1, height_ratios=(3, 1))
        balance.draw(below, solution.t)
    (problem.draw or _draw)(response, solution)
    names.append(f"{problem.name}.png")
    figure.savefig(out / names[-1], dpi=130)
    return ", ".join(names)


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
