"""The report as Markdown with static pictures, drawn from a record."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import partial
from urllib.parse import quote

from eig3.command_line import Files

from .. import paper, pictures, precision, text
from ..environment import in_words
from ..matrix import Matrix, in_units, power
from ..modes import MODES
from ..reach import Contest
from ..sweep import WorkPrecisionSet
from . import own_problem
from .comparison import Comparison
from .record import Record, part_name

MATRIX = "matrix.svg"
_TAG = re.compile("<(?=[a-zA-Z/!?])")
_HOW_TO_READ = """## How to read it

Times from different machines cannot be compared. Ratios within one table can, since its runs are interleaved. No time
includes compilation. In a work-precision picture the lower left corner is best: less time and less error. A steep line
belongs to a method of high order; a line that ends early on the left is limited by stability. Read a column of "time
to reach" from top to bottom: the bold entry is the fastest way to that accuracy. Errors in different metrics mean
different things: a trajectory with exact energy can be far off in phase."""
TITLES = {
    "plan": "What eig3.plan predicts",
    "c": "Beside C",
    "stability": "Stability limits",
    "hard": "Hard cases",
    "trust": "Can the error be trusted?",
}


def page(record: Record, comparison: Comparison | None) -> str:
    """The report: the answer, then each problem, the article, and the other parts."""
    parts = ["# eig3: what accuracy costs in time", f"Machine: {in_words(record.run.environment)}"]
    parts.append(f"Measured by `{record.run.command}`.")
    if record.unsolved:
        parts.append(f"No method that was chosen solves {', '.join(record.unsolved)}.")
    if record.missing:
        parts.append(f"Not measured yet: {', '.join(record.missing)}.")
    parts += _answer(record.results)
    parts.append(_HOW_TO_READ)
    if comparison:
        parts += ["## Beside another run", comparison.markdown, "All pairs:", comparison.everything]
    if record.results:
        parts += ["## Work and precision", *how_measured(record)]
    for result in record.results:
        parts += _problem(record, result)
    if record.article:
        parts += _article(record)
    texts = record.texts
    for name in (name for name in TITLES if name in texts):
        parts += [f"## {TITLES[name]}", f"Measured by `{texts[name].command}`.", texts[name].markdown]
    # Titles and texts may be from someone else: what looks like a tag is text.
    return _TAG.sub("&lt;", "\n\n".join(parts)) + "\n"


def how_measured(record: Record) -> list[str]:
    """Return how the times were measured, for problems of the library and for a problem of the user."""
    settings = record.run.settings
    repeats, modes = settings["repeats"], settings["modes"] or list(MODES)
    found = []
    if any(result.is_of_the_library for result in record.results):
        found.append(precision.how_measured(repeats, settings["longest"], modes))
    if not all(result.is_of_the_library for result in record.results):
        found.append(own_problem.how_measured(repeats))
    return found


def draw_pictures(record: Record, files: Files) -> None:
    """Draw the static pictures of the page."""
    shown = matrix(record.results)
    figures = {
        **({MATRIX: partial(pictures.matrix, shown)} if shown.rows else {}),
        **{picture(result): partial(pictures.work_precision, first_mode(result)) for result in record.results},
        **{f"table{r.table.number}.svg": partial(pictures.article_table, r) for r in record.article},
    }
    pictures.draw(figures, files)


def picture(result: WorkPrecisionSet) -> str:
    """The name of the file with the work-precision picture of a problem."""
    return f"{part_name('precision', result.name)}.svg"


def first_mode(result: WorkPrecisionSet) -> WorkPrecisionSet:
    """The points of the first mode that was measured, in the order of `MODES`."""
    return result.in_mode(result.modes[0]) if result.modes else result


def matrix(results: Sequence[WorkPrecisionSet]) -> Matrix:
    """The matrix for the trajectory, in the first mode that was measured."""
    modes = [mode for mode in MODES if any(mode in result.modes for result in results)]
    return Matrix.of(results, "trajectory", modes[0] if modes else next(iter(MODES)))


def _answer(results: Sequence[WorkPrecisionSet]) -> list[str]:
    """The fastest of all to reach each accuracy on each problem."""
    shown = matrix(results)
    if not shown.rows:
        return []
    rows = [[row.title, *(_fastest(row.at(target)) for target in shown.targets)] for row in shown.rows]
    return [
        "## The fastest way to each accuracy of the trajectory",
        "\n".join(f"- {shown.answer(target)}" for target in shown.targets),
        f"![The fastest way to each accuracy]({MATRIX})",
        text.table(["problem", *map(power, shown.targets)], rows),
    ]


def _fastest(contest: Contest | None) -> str:
    return f"{contest.fastest.label} {in_units(contest.fastest.seconds)}" if contest and contest.fastest else "-"


def _problem(record: Record, result: WorkPrecisionSet) -> list[str]:
    motion = record.motion(result.name)
    shown = [f"![The motion of {result.title}]({quote(motion.name)})"] if motion else []
    parts: list[str] = []
    for mode in result.modes or list(MODES)[:1]:
        of_mode = result.in_mode(mode)
        heading, *rest = precision.render(of_mode).split("\n\n")
        if not parts:
            parts += [f"#{heading}", *shown]
        parts += [f"#### Counting {MODES[mode].words}", f"Measured by `{of_mode.command}`."]
        parts += rest
    return [*parts, f"![{result.title}: error against time and evaluations]({quote(picture(result))})"]


def _article(record: Record) -> list[str]:
    results = record.article
    parts = ["## The article's tables and claims", paper.how_measured(record.run.settings["repeats"])]
    for result, command in zip(results, record.article_commands, strict=True):
        parts += [paper.render(result), f"Measured by `{command}`."]
        parts.append(f"![Table {result.table.number}: error against time](table{result.table.number}.svg)")
    return [*parts, paper.render_footnotes(results), paper.render_relative(results), paper.render_claims(results)]
