"""The report as Markdown with static pictures, drawn from a record."""

from __future__ import annotations

from functools import partial
from itertools import groupby

from eig3.options import Files

from .. import paper, pictures, precision, text
from ..environment import in_words
from ..reach import fastest
from ..sweep import WorkPrecisionSet
from .comparison import Comparison
from .record import Record, part_name

_HOW_TO_READ = """## How to read it

Times from different machines cannot be compared. Ratios within one table can, since its runs are interleaved. No time
includes compiling. In a work-precision picture the lower left corner is best: less time and less error. A steep line
belongs to a method of high order; a line that ends early on the left is limited by stability. Read a column of "time
to reach" from top to bottom: the bold entry is the fastest way to that accuracy. Errors in different metrics mean
different things: a trajectory with exact energy can be far off in phase."""
_TITLES = {
    "plan": "What eig3.plan predicts",
    "c": "Beside C",
    "stability": "Stability limits",
    "hard": "Hard cases",
}


def page(record: Record, comparison: Comparison | None) -> str:
    """The report: the answer, then each problem, the article, and the other parts."""
    parts = ["# eig3: what accuracy costs in time", f"Machine: {in_words(record.environment)}"]
    parts.append(f"Measured by `{record.command}`.")
    if record.missing:
        parts.append(f"Not measured yet: {', '.join(record.missing)}.")
    parts += _answer(record.results)
    parts.append(_HOW_TO_READ)
    if comparison:
        parts += ["## Beside another run", comparison.markdown]
    if record.results:
        parts.append("## Work and precision")
    for result in record.results:
        parts += _problem(record, result)
    if record.article:
        parts += _article(record)
    texts = record.texts
    for name in (name for name in _TITLES if name in texts):
        parts += [f"## {_TITLES[name]}", f"Measured by `{texts[name].command}`.", texts[name].markdown]
    return "\n\n".join(parts) + "\n"


def draw_pictures(record: Record, files: Files) -> None:
    """Draw the static pictures of the page."""
    figures = {
        **{picture(result): partial(pictures.work_precision, first_mode(result)) for result in record.results},
        **{f"table{r.table.number}.svg": partial(pictures.article_table, r) for r in record.article},
    }
    pictures.draw(figures, files)


def picture(result: WorkPrecisionSet) -> str:
    """The name of the file with the work-precision picture of a problem."""
    return f"{part_name('precision', result.name)}.svg"


def first_mode(result: WorkPrecisionSet) -> WorkPrecisionSet:
    """The points of the first mode that was measured, "pointer" if it is there."""
    return result.in_mode(result.modes[0]) if result.modes else result


def _answer(results: list[WorkPrecisionSet]) -> list[str]:
    """The fastest method of the library for each problem and accuracy, in tables of the same accuracies."""
    if not results:
        return []
    parts = ["## The fastest method for each accuracy of the trajectory"]
    for targets, group in groupby(results, key=lambda result: result.targets):
        rows = [[result.name, *(_fastest(first_mode(result), target) for target in targets)] for result in group]
        parts.append(text.table(["time in ms", *(f"{target:g}" for target in targets)], rows))
    return parts


def _fastest(result: WorkPrecisionSet, target: float) -> str:
    found = fastest(result, "trajectory", target, lambda method: True)
    return f"{found.label} {text.number(1e3 * found.seconds, 2)}" if found else "-"


def _problem(record: Record, result: WorkPrecisionSet) -> list[str]:
    motion = record.motion(result.name)
    shown = [f"![The motion of {result.title}]({motion.name})"] if motion else []
    parts = []
    for mode in result.modes or ["pointer"]:
        of_mode = result.in_mode(mode)
        heading, *rest = precision.render(of_mode).split("\n\n")
        if not parts:
            parts += [f"#{heading}", *shown]
        command = f"{result.command}{' --inline' * (mode == 'inline' and result.command.startswith(_WITH_MODE))}"
        parts += [f"#### Right-hand side {precision.IN_WORDS[mode]}", f"Measured by `{command}`."]
        parts += rest
    return [*parts, f"![{result.title}: error against time and evaluations]({picture(result)})"]


_WITH_MODE = "eig3 bench precision"


def _article(record: Record) -> list[str]:
    results = record.article
    commands = [part.command for name, part in record.measured.items() if name.startswith("article_")]
    parts = ["## The article's tables and claims", paper.how_measured(record.run.settings["repeats"])]
    for result, command in zip(results, commands, strict=True):
        parts += [paper.render(result), f"Measured by `{command}`."]
        parts.append(f"![Table {result.table.number}: error against time](table{result.table.number}.svg)")
    return [*parts, paper.render_footnotes(results), paper.render_relative(results), paper.render_claims(results)]
