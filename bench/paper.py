"""`eig3 bench paper`: the article's five tables, run natively and laid beside the printed ones."""

import dataclasses
import json
import statistics
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from eig3.methods import METHODS, CentralDifference, Method
from eig3.problem import Problem
from eig3.solution import Status

from . import text
from .article import FOOTNOTES, TABLES, Entry, Table
from .environment import environment, in_words
from .timing import Storage, interleave, time_run

QUICK_REPEATS = 3
_QUICK_LEAVES_OUT_SMALLEST = (1, 2, 3, 5)
_ERROR_BLOCK = 2**18
_CLAIM_TOLERANCE = 0.15  # of the ratio a claim names: what compilers and processors may differ in

# Table 4 shows CD at its best too: fixed-point iteration in place of the article's Newton.
EXTRA = {4: {"cd fixed-point": CentralDifference(solver="fixed-point")}}


@dataclass(frozen=True)
class Cell:
    """One method at one step: what was measured, and the article's entry where it has one."""

    h: float
    method: str
    n_steps: int
    n_rhs: int
    seconds: list[float]
    error: float
    status: str
    entry: Entry | None

    @property
    def mean(self) -> float:
        return statistics.fmean(self.seconds)

    @property
    def median(self) -> float:
        """For ratios: one run that the machine disturbs does not move it."""
        return statistics.median(self.seconds)

    @property
    def label(self) -> str:
        return label(self.method)


@dataclass(frozen=True)
class Result:
    """One table, measured."""

    table: Table
    cells: list[Cell]

    def cell(self, method: str, h: float | None = None) -> Cell:
        """The cell of a method at a step, or at the smallest one run."""
        found = [cell for cell in self.cells if cell.method == method and h in (None, cell.h)]
        if not found:
            raise LookupError(f"table {self.table.number} was not run with {method} at h = {h}")
        return min(found, key=lambda cell: cell.h)

    @property
    def steps(self) -> list[float]:
        return sorted({cell.h for cell in self.cells}, reverse=True)


def label(method: str) -> str:
    """A method's name in tables."""
    name, _, rest = method.partition(" ")
    return METHODS[name].label + (f" {rest}" if rest else "")


def run(
    *,
    only: int | None = None,
    repeats: int = 10,
    quick: bool = False,
    out: Path | None = None,
    write: Callable[[str], None] = print,
) -> list[Result]:
    """Measure, print each table when it is done, and keep everything in `out` as soon as it is there."""
    settings = {"table": only, "repeats": repeats, "quick": quick, "mode": "right-hand side through a pointer"}
    heading = (
        f"Machine: {in_words()}\n\n"
        f"Times: mean of {repeats} interleaved runs of the kernel alone, whole history stored; each holds one call "
        "from Python, some 20 microseconds, which shows at the largest steps."
    )
    write(heading)
    pages, results = [heading], []
    for table in TABLES:
        if only not in (None, table.number):
            continue
        results.append(measure(table, steps_of(table, quick), repeats))
        pages.append(render(results[-1]))
        write("\n" + pages[-1])
        if out is not None:
            save(out, results, pages, settings)
    pages += [render_footnotes(results), render_relative(results), render_claims(results)]
    for page in pages[-3:]:
        write("\n" + page)
    if out is not None:
        save(out, results, pages, settings)
        write(f"\nWritten to {out}: results.json, tables.md{draw(results, out)}")
    return results


def steps_of(table: Table, quick: bool) -> tuple[float, ...]:
    return table.steps[:-1] if quick and table.number in _QUICK_LEAVES_OUT_SMALLEST else table.steps


def measure(table: Table, steps: tuple[float, ...], repeats: int) -> Result:
    """Time every method at every step in interleaved runs; take the errors from runs of their own."""
    problem = table.problem()
    methods: dict[str, str | Method] = {name: name for name in table.entries}
    methods.update(EXTRA.get(table.number, {}))
    storage = Storage.for_runs(problem, steps)
    cells = []
    for i, h in enumerate(steps):
        runs = {name: partial(time_run, problem, h, method, storage) for name, method in methods.items()}
        where = f"table {table.number}, h = {h:g}"
        seconds = interleave(runs, repeats, partial(_tell, where))
        for name, method in methods.items():
            text.status(f"{where}, {name}: error over every step")
            solution, error = error_of(problem, h, method)
            entry = table.entries[name][i] if name in table.entries else None
            cells.append(
                Cell(h, name, solution.n_steps, solution.n_rhs, seconds[name], error, solution.status.value, entry)
            )
    text.status("")
    return Result(table, cells)


def _tell(where: str, what: str) -> None:
    text.status(f"{where}, {what}")


def error_of(problem: Problem, h: float, method: str | Method):
    """The run and its error in the article's metric: from the exact solution where there is one, else energy drift."""
    solution = problem.integrate(h=h, method=method, save_every=None if problem.exact is None else 1)
    if solution.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    if problem.exact is None:
        return solution, solution.drift["energy"]
    worst = largest = 0.0
    for begin in range(0, len(solution.t), _ERROR_BLOCK):
        block = slice(begin, begin + _ERROR_BLOCK)
        exact = problem.exact(solution.t[block])[0]
        worst = max(worst, float(np.abs(solution.u[block] - exact).max()))
        largest = max(largest, float(np.abs(exact).max()))
    return solution, worst / largest


def render(result: Result) -> str:
    header = ["h (s)", "method", "time (s)", "ns/step", "error", "article: time (s)", "error", "error / article's"]
    rows = []
    for h in result.steps:
        for cell in (cell for cell in result.cells if cell.h == h):
            entry = cell.entry
            mark = f" [{entry.mark}]" if entry and entry.mark else ""
            rows.append(
                [
                    f"{h:g}",
                    cell.label,
                    text.number(cell.mean),
                    text.number(1e9 * cell.mean / cell.n_steps),
                    text.number(cell.error, 4),
                    text.printed(entry.seconds if entry else None),
                    text.printed(entry.error if entry else None),
                    text.number(cell.error / entry.error if entry else None) + mark,
                ]
            )
    table = result.table
    return f"Table {table.number}: {table.title}; error is {table.metric}\n\n{text.table(header, rows)}"


def render_footnotes(results: list[Result]) -> str:
    """The marks that were used, and how far the unmarked errors are from those recomputed from the definitions."""
    entries = [(cell, cell.entry) for result in results for cell in result.cells if cell.entry]
    used = sorted({entry.mark for _, entry in entries} - {""})
    lines = [f"[{mark}] {FOOTNOTES[mark]}" for mark in used]
    unmarked = [abs(cell.error / entry.recomputed - 1) for cell, entry in entries if not entry.mark]
    if unmarked:
        lines.append(
            f"Each of the {len(unmarked)} errors without a mark is within {100 * max(unmarked):.1f} % of the value "
            "that the article's definitions give; the article prints two or three digits and truncates some."
        )
    return "\n\n".join(lines)


def render_relative(results: list[Result]) -> str:
    """Times over EIG-3's, here and in the article."""
    others = [name for name in TABLES[0].entries if name != "eig3"]
    rows = []
    for result in results:
        if set(result.table.entries) == {"eig3"}:
            continue
        for h in result.steps:
            base = result.cell("eig3", h)
            row = [f"Table {result.table.number}, h = {h:g}"]
            for name in others:
                cell = result.cell(name, h)
                row += [text.number(cell.median / base.median), text.number(_printed_ratio(cell.entry, base.entry))]
            rows.append(row)
    if not rows:
        return "Times relative to EIG-3: no table with other methods was run."
    header = ["time / EIG-3's"] + [f"{label(name)}{where}" for name in others for where in ("", ", article")]
    title = "Median times relative to EIG-3 in the same run; a dash where the article's clock shows 0.0"
    return f"{title}\n\n{text.table(header, rows)}"


def _printed_ratio(entry: Entry | None, base: Entry | None) -> float | None:
    return entry.seconds / base.seconds if entry and base and base.seconds else None


def render_claims(results: list[Result]) -> str:
    by_number = {result.table.number: result for result in results}
    lines = [
        "The article's claims, each at the smallest step run; a ratio holds when it is within "
        f"{100 * _CLAIM_TOLERANCE:.0f} % of the one claimed:"
    ]
    for i, (claim, verdict) in enumerate(CLAIMS, start=1):
        try:
            holds, numbers = verdict(by_number)
        except LookupError:  # not all of its tables were run
            continue
        lines.append(f"{i}. {claim}: {'holds here' if holds else 'does not hold here'}; {numbers}.")
    if len(lines) == 1:
        return "No claim of the article can be judged from these tables alone."
    return "\n\n".join(lines)


def _ratios(results: dict[int, Result], numbers: tuple[int, ...], method: str) -> dict[int, float]:
    return {n: results[n].cell(method).median / results[n].cell("eig3").median for n in numbers}


def _near(ratio: float, claimed: float) -> bool:
    return abs(ratio / claimed - 1) <= _CLAIM_TOLERANCE


def _in_words(ratios: dict[int, float]) -> str:
    return ", ".join(f"{ratio:.2f} in Table {n}" for n, ratio in ratios.items())


def _same_cost(results):
    ratios = _ratios(results, (1, 2, 3), "cd")
    return all(_near(ratio, 1.0) for ratio in ratios.values()), f"CD / EIG-3 is {_in_words(ratios)}"


def _rk2_twice(results):
    ratios = _ratios(results, (1, 2, 3, 4), "rk2")
    return all(_near(ratio, 2.0) for ratio in ratios.values()), f"RK2 / EIG-3 is {_in_words(ratios)}"


def _newton_cost(results):
    newton, fixed_point = (_ratios(results, (4,), method)[4] for method in ("cd", "cd fixed-point"))
    by_step = ", ".join(
        f"{results[4].cell('cd', h).median / results[4].cell('eig3', h).median:.2f} at h = {h:g}"
        for h in results[4].steps
    )
    return _near(newton, 5.6), (
        f"CD / EIG-3 is {by_step} with Newton's method, and {fixed_point:.2f} at the smallest step with fixed-point "
        "iteration"
    )


def _beats_cd(results):
    fine = results[5].cell("eig3", 2e-6)
    newton, fixed_point = (results[4].cell(method, 1e-5) for method in ("cd", "cd fixed-point"))
    return fine.median < newton.median and fine.error < newton.error, (
        f"EIG-3 takes {fine.median / newton.median:.2f} of the time of CD with Newton's method and "
        f"{fine.median / fixed_point.median:.2f} of that with fixed-point iteration, for "
        f"{fine.error / newton.error:.2f} of the drift"
    )


CLAIMS = (
    ("EIG-3 and CD cost the same where f has no velocity", _same_cost),
    ("RK2 takes about twice EIG-3", _rk2_twice),
    ("With velocity terms CD takes 5.6 times EIG-3", _newton_cost),
    ("On the pendulum EIG-3 at h = 2e-6 beats CD at h = 1e-5 in both time and drift", _beats_cd),
)


def save(out: Path, results: list[Result], pages: list[str], settings: dict) -> None:
    """results.json and tables.md, whole after every table, so that an interrupted run loses nothing."""
    tables = [
        {
            "number": result.table.number,
            "title": result.table.title,
            "metric": result.table.metric,
            "cells": [
                {**dataclasses.asdict(cell), "mean_seconds": cell.mean, "median_seconds": cell.median}
                for cell in result.cells
            ],
        }
        for result in results
    ]
    content = {"environment": environment(), "settings": settings, "tables": tables}
    (out / "results.json").write_text(json.dumps(content, indent=1))
    (out / "tables.md").write_text("\n\n".join(pages) + "\n")


def draw(results: list[Result], out: Path) -> str:
    """A work-precision picture a table; returns what to say of them."""
    try:
        from .pictures import work_precision
    except ImportError:
        return text.NO_PICTURES
    for result in results:
        work_precision(result, out / f"table{result.table.number}.png")
    return f" and {len(results)} picture{'s' * (len(results) > 1)}"
