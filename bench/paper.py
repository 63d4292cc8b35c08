"""Run the article's five tables, and print the results next to the article's values."""

import argparse
import json
from collections.abc import Callable
from functools import partial
from pathlib import Path

from eig3.command_line import Files, add_out, count

from . import pictures, text
from .article import FOOTNOTES, TABLES, Entry, Table
from .article_runs import MeasuredTable, label, measure
from .environment import environment, in_words

SUMMARY = "the article's five tables"
REPEATS, QUICK_REPEATS = 10, 3
_QUICK_LEAVES_OUT_SMALLEST = (1, 2, 3, 5)
_CLAIM_TOLERANCE = 0.15  # relative, for a ratio of times: compilers and processors change it this much


def add_options(parser: argparse.ArgumentParser, quick: bool = False) -> None:
    parser.add_argument("--table", type=int, choices=range(1, 6), help="only this one")
    parser.add_argument(
        "--repeats", type=count, help=f"runs for each mean time ({REPEATS}, or {QUICK_REPEATS} with --quick)"
    )
    parser.add_argument(
        "--quick",
        action="store_true",
        default=quick,
        help="fewer repeats, without the smallest steps of Tables 1-3 and 5",
    )
    add_out(parser, "folder for results.json, tables.md and pictures")


def run(options: argparse.Namespace) -> None:
    repeats = options.repeats or (QUICK_REPEATS if options.quick else REPEATS)
    benchmark(only=options.table, repeats=repeats, quick=options.quick, out=options.out)


def benchmark(
    *,
    only: int | None = None,
    repeats: int = REPEATS,
    quick: bool = False,
    out: Path | None = None,
    write: Callable[[str], None] = print,
) -> list[MeasuredTable]:
    """Measure, print each table as soon as it is complete, and save after each table in `out`."""
    settings = {"table": only, "repeats": repeats, "quick": quick, "mode": "right-hand side through a pointer"}
    heading = f"Machine: {in_words()}\n\n{how_measured(repeats)}"
    write(heading)
    files = None if out is None else Files(out, "eig3 bench")
    pages, results = [heading], []
    for table in TABLES:
        if only not in (None, table.number):
            continue
        results.append(measure(table, steps_of(table, quick), repeats))
        pages.append(render(results[-1]))
        write("\n" + pages[-1])
        if files:
            save(files, results, pages, settings)
    pages += [render_footnotes(results), render_relative(results), render_claims(results)]
    for page in pages[-3:]:
        write("\n" + page)
    if files:
        save(files, results, pages, settings)
        figures = {f"table{result.table.number}.png": partial(pictures.article_table, result) for result in results}
        files.finish(write, pictures.draw(figures, files))
    return results


def how_measured(repeats: int) -> str:
    return (
        f"Times: mean of {repeats} interleaved runs of the kernel alone, whole history stored. Each includes one call "
        "from Python, about 20 microseconds, which is visible at the largest steps."
    )


def steps_of(table: Table, quick: bool) -> tuple[float, ...]:
    return table.steps[:-1] if quick and table.number in _QUICK_LEAVES_OUT_SMALLEST else table.steps


def render(result: MeasuredTable) -> str:
    """A table: the measured times and errors, and the article's."""
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


def render_footnotes(results: list[MeasuredTable]) -> str:
    """The footnotes in use, and how close the errors without a footnote are to the recomputed errors."""
    entries = [(cell, cell.entry) for result in results for cell in result.cells if cell.entry]
    used = sorted({entry.mark for _, entry in entries} - {""})
    lines = [f"[{mark}] {FOOTNOTES[mark]}" for mark in used]
    unmarked = [abs(cell.error / entry.recomputed - 1) for cell, entry in entries if not entry.mark]
    if unmarked:
        lines.append(
            f"Each of the {len(unmarked)} errors without a footnote is within {100 * max(unmarked):.1f} % of the value "
            "that follows from the article's definitions. The article prints two or three digits and truncates some."
        )
    return "\n\n".join(lines)


def render_relative(results: list[MeasuredTable]) -> str:
    """Times divided by EIG-3's, here and in the article."""
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


def render_claims(results: list[MeasuredTable]) -> str:
    """The article's claims that the measured tables can decide, and whether each holds."""
    by_number = {result.table.number: result for result in results}
    lines = [
        "The article's claims, each at the smallest step that was run. A ratio holds if it is within "
        f"{100 * _CLAIM_TOLERANCE:.0f} % of the claimed ratio:"
    ]
    for i, (claim, verdict) in enumerate(CLAIMS, start=1):
        try:
            holds, numbers = verdict(by_number)
        except LookupError:  # one of its tables was not run
            continue
        lines.append(f"{i}. {claim}: {'holds here' if holds else 'does not hold here'}; {numbers}.")
    if len(lines) == 1:
        return "No claim of the article can be judged from these tables alone."
    return "\n\n".join(lines)


def _ratios(results: dict[int, MeasuredTable], numbers: tuple[int, ...], method: str) -> dict[int, float]:
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


def save(files: Files, results: list[MeasuredTable], pages: list[str], settings: dict) -> None:
    """Write results.json and tables.md. Both are complete after every table, so an interrupted run loses nothing."""
    tables = [result.as_json() for result in results]
    content = {"environment": environment(), "settings": settings, "tables": tables}
    with files.writing("results.json") as path:
        path.write_text(json.dumps(content, indent=1))
    with files.writing("tables.md") as path:
        path.write_text("\n\n".join(pages) + "\n")
