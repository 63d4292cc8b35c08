"""`eig3 run`: integrate one problem, write its history and a picture, and report its energy balance."""

from __future__ import annotations

import csv
import inspect
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from . import drawing
from .animation import geometry
from .animation.film import is_resolved
from .animation.writers import check_writer
from .command_line import Files, file_name
from .files.export import check_export
from .functions.checks import check_h, check_time
from .methods import Method
from .planning.suggested_step import first_step
from .problem import Problem
from .result.frames import columns_of
from .result.labels import with_unit
from .result.solution import Solution
from .view.page import check_page

_STATES = 20_000  # approximate largest number of saved states
_VALUES = 4_000_000  # largest number of saved displacements and velocities
_EXPORTED = 500  # about the number of states in a file for another program
_CSV_VALUES = 200_000  # a longer history is written only to the NPZ file
_FIRST_STEPS = 500  # by which a step is judged before a run that is animated
_REFINEMENTS = 4
_PANEL = 6.5, 2.5  # width and height of a panel with its labels, inches


def run(
    build: Callable[..., Problem],
    *,
    h: float | None = None,
    rtol: float | None = None,
    accuracy: float | None = None,
    method: str | Method | None = None,
    t_end: float | None = None,
    check: bool = False,
    out: Path | None = None,
    export: Path | None = None,
    animate: str | None = None,
    show: str | None = None,
    write: Callable[[str], None] = print,
) -> Solution:
    """Integrate one of `eig3.problems` and report on the run.

    Parameters
    ----------
    build : callable
        A function of `eig3.problems`. It is called with `t_end` if given, and with ``work=True`` if it has this
        parameter.
    h : float, optional
        The step, s. The default is the step that the problem suggests, or a tenth of the critical step.
    rtol : float, optional
        The relative tolerance, instead of a step. The states are then saved at equal distances in time.
    accuracy : float, optional
        The largest error of u relative to the motion, instead of a step.
    method : str or Method, optional
        The default is "eig3", or with rtol or accuracy the default of `eig3.integrate`.
    t_end : float, optional
        Duration, s; by default the duration of the problem.
    check : bool
        Estimate the error of the run, as `eig3.integrate` does.
    out : Path, optional
        A folder for NAME.npz, NAME.csv (short histories only) and NAME.png (with matplotlib only).
    export : Path, optional
        A file for some hundred of the states, as `Problem.export` writes it.
    animate : {"gif", "mp4", "html"}, optional
        The format of an animation, which is written to `out` or to the current folder.
    show : str, optional
        The file of a page that shows the motion in three dimensions; "" to open it in the browser.
    write : callable
        Called with each part of the report.

    Returns
    -------
    Solution

    Raises
    ------
    OSError, TypeError, ValueError
        For bad arguments, as `eig3.integrate` raises them, and for a step that is too long for an animation.
    ImportError
        If a package or program for the animation is not installed.
    KeyboardInterrupt
        After Ctrl-C, once the run so far is reported and written.
    SystemExit
        If a file cannot be written, after the other files and the report.
    """
    options: dict[str, Any] = {"work": True} if "work" in inspect.signature(build).parameters else {}
    if t_end is not None:
        options["t_end"] = check_time(t_end, "t_end")
    if sum(x is not None for x in (h, rtol, accuracy)) > 1:
        raise ValueError("h, rtol and accuracy exclude each other: give one of them.")
    if animate:
        check_writer(animate)
    problem = build(**options)
    if export is not None:
        check_export(problem.shown_geometry, export, problem.name)
    if show is not None:
        geometry(problem.view, problem.name)  # a problem without one is an error now, and not after the run
        check_page(show or None)

    def steps(problem: Problem) -> dict[str, Any]:
        if accuracy is not None:
            return {"accuracy": accuracy, "method": method, "t_eval": _even_times(problem)}
        given = _steps(problem, h, rtol, method)
        if export is not None and export.suffix == ".dcd" and given.pop("save_every", 1) > 1:
            given["t_eval"] = _even_times(problem)  # a last state that does not follow at an equal time is refused
        return given

    if (animate or show is not None) and h is not None:
        _check_film(problem, check_h(h), "eig3" if method is None else method)
    interrupt = None
    try:
        solution = problem.integrate(**steps(problem), invariants={}, check=check)
    except KeyboardInterrupt as error:
        if not getattr(error, "solution", None):
            raise
        interrupt, solution = error, error.solution  # type: ignore[attr-defined]
    write(f"{problem.name}: {problem.source}")
    write("".join(f"  {line}\n" for line in problem.note.splitlines()) + str(solution))
    balance = Balance.of(problem, solution) if problem.energy is not None and solution.success else None
    if balance:
        write(balance.summary())
    elif solution.success:
        write("  energy: this problem defines none")
    if export is not None:
        problem.export(solution, export, every=max(1, len(solution.t) // _EXPORTED))
        write(f"\nWritten: {export}")
    if out is not None or animate:
        files = Files(out or Path(), "eig3 run")
        lacking = "" if out is None else _save(problem, solution, balance, files)
        if animate and not interrupt:
            resolved = _resolved(problem, solution, steps)
            with files.writing(f"{file_name(problem.name)}.{animate}") as path:
                problem.animate(resolved, path, t_end=solution.t[-1])
        files.finish(write, lacking)
    if show is not None and not interrupt:
        page = problem.show(_resolved(problem, solution, steps), show or None, t_end=solution.t[-1])
        write(f"\nShown in {page.path}")
    if interrupt:
        raise interrupt
    return solution


def _steps(problem: Problem, h: float | None, rtol: float | None, method: str | Method | None) -> dict[str, Any]:
    """Return the options of a run that saves some thousand states."""
    if rtol is not None:  # the number of steps is not known in advance
        return {"rtol": rtol, "method": method, "t_eval": _even_times(problem)}
    method = "eig3" if method is None else method
    span = problem.t_span[1] - problem.t_span[0]
    h = first_step(problem, method, span) if h is None else check_h(h)
    every = max(1, round(min(span / h, 2**53) / _most_states(problem)))
    return {"h": h, "method": method, "save_every": every}


def _check_film(problem: Problem, h: float, method: str | Method) -> None:
    """Refuse a step with which an animation could not show the first steps, if a shorter one could."""
    start, end = problem.t_span
    beginning = problem.with_(t_span=(start, min(end, start + _FIRST_STEPS * h)))

    def is_shown(step: float) -> bool:
        return is_resolved(beginning.integrate(h=step, method=method, invariants={}))

    if not is_shown(h):
        shorter = next((step for step in (h / 8**k for k in range(1, _REFINEMENTS)) if is_shown(step)), None)
        if shorter:
            raise ValueError(f"h = {h:g} is too long for an animation of the motion; take h = {shorter:.2g} or less.")


def _resolved(problem: Problem, solution: Solution, steps: Callable[[Problem], dict[str, Any]]) -> Solution:
    """Return a run with states that are dense enough for an animation; it may be shorter than `solution`."""
    while not is_resolved(solution) and solution.n_steps > len(solution.t):
        start, end = problem.t_span
        problem = problem.with_(t_span=(start, start + (end - start) / 10))
        solution = problem.integrate(**steps(problem), invariants={})
    return solution


def _even_times(problem: Problem) -> np.ndarray:
    return np.linspace(*problem.t_span, _most_states(problem) + 1)


def _most_states(problem: Problem) -> int:
    return min(_STATES, _VALUES // (2 * np.size(problem.u0)))


@dataclass(frozen=True)
class Balance:
    """The energy balance of a run.

    `energy` is the mechanical energy at the saved states, and `work` the work done up to each of them; it is None if
    the problem does not integrate it. `unit` is the unit of both.
    """

    t: np.ndarray
    energy: np.ndarray
    work: np.ndarray | None
    unit: str

    @classmethod
    def of(cls, problem: Problem, solution: Solution) -> Balance:
        energy = problem.energy_of(solution.u, solution.v, solution.t, solution.z or None)
        return cls(solution.t, energy, solution.z.get("work"), problem.energy_unit)

    def summary(self) -> str:
        """Describe the energy at both ends, and the largest change of the energy minus the work."""
        energy, work, unit = self.energy, self.work, "" if self.unit in ("", "-") else f" {self.unit}"
        change = energy if work is None else energy - work
        unexplained = np.abs(change - change[0]).max()
        lines = [
            f"  energy: {energy[0]:.6g}{unit} at the start, {energy[-1]:.6g}{unit} at the end, "
            f"between {energy.min():.6g} and {energy.max():.6g}{unit}"
        ]
        if work is None:
            lines.append(f"  change of energy: at most {unexplained:.3g}{unit}; the exact solution keeps its energy")
        else:
            lines.append(
                f"  work done: {work[-1]:.6g}{unit} at the end, between {work.min():.6g} and {work.max():.6g}{unit}; "
                f"change of energy minus work: at most {unexplained:.3g}{unit}"
            )
        return "\n".join(lines)

    def draw(self, figure: Any) -> None:
        """Draw the change of energy since the start, and the work done."""
        change = self.energy - self.energy[0]
        if self.work is None:
            label = with_unit("change of energy", self.unit).replace(" (", "\n(")
            drawing.lines(drawing.time_panel(figure, label), self.t, change)
            return
        axes = drawing.time_panel(figure, with_unit("since the start", self.unit).replace(" (", "\n("))
        drawing.lines(axes, self.t, np.column_stack([change, self.work]), ["change of\nenergy", "work done"])
        axes.lines[1].set_linestyle("--")
        drawing.legend(axes)


def _save(problem: Problem, solution: Solution, balance: Balance | None, files: Files) -> str:
    """Write the files; return a text to append to the list of written files."""
    t, u, v = solution.t, solution.u, solution.v
    name = file_name(problem.name)
    taken = {"file", "t", "u", "v"}  # an unknown may have any name, and NumPy takes the path as `file`
    of_z: dict[str, Any] = {f"z.{name}" if name in taken else name: x for name, x in solution.z.items()}
    with files.writing(f"{name}.npz") as path:
        np.savez_compressed(path, t=t, u=u, v=v, **of_z)
    columns: dict[str, np.ndarray] = {"t": t}
    for key, values, _ in columns_of(solution):
        columns[f"z.{key}" if key in columns else key] = values
    if len(t) * len(columns) <= _CSV_VALUES:
        with files.writing(f"{name}.csv") as path, path.open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerow(columns)
            np.savetxt(file, np.column_stack([*columns.values()]), delimiter=",")
    else:
        files.leave_out(f"{name}.csv")
    return files.draw(f"{name}.png", lambda figure: draw(figure, problem, solution, balance))


def draw(figure: Any, problem: Problem, solution: Solution, balance: Balance | None = None) -> None:
    """Draw the picture of the problem and the energy balance. If the run blew up, draw the part before the growth."""
    shown = drawing.before_growth(solution)
    (problem.draw or drawing.histories)(figure, shown)
    if balance:
        balance.draw(figure)
    step, second = "h" if solution.steps is None else "mean h", problem.labels.second
    title = f"{problem.name}, {solution.method.label}, {step} = {solution.h:.3g}{second}"
    if not solution.success:
        what, n = solution.status.value, len(shown.t)
        title += f"\n{what}; the last state is at t = {solution.t[-1]:.4g}{second}"
        if n < len(solution.t):
            title += f"\nshown up to t = {shown.t[-1]:.4g}{second}, where the growth begins"
            drawing.growth(figure, solution, n)
            what = "growth begins"
        drawing.mark(figure, shown.t[-1], what)
    for axes in drawing.time_panels(figure)[-1:]:
        axes.set_xlabel(with_unit("t", problem.labels.time))
    figure.suptitle(title, parse_math=False)  # the name of a problem may contain dollar signs
    width, height = _PANEL
    is_wide = bool(drawing.pictures(figure))
    figure.set_size_inches((2 if is_wide else 1.4) * width, max(2, len(drawing.time_panels(figure))) * height + 0.5)
