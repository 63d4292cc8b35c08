"""Measure the article's tables, C, work and precision with rivals, and the planner; write HTML and Markdown."""

from __future__ import annotations

import argparse
import base64
import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from eig3.methods import LIBRARY
from eig3.options import Files, add_methods, add_out

from . import c, paper, pictures, plan, precision
from .environment import in_words
from .options import add_problems, add_repeats, choose
from .problem_set import PROBLEM_SET
from .sweep import LONGEST, WorkPrecisionSet, measure

SUMMARY = "everything on one page"

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 1150px; margin: 2em auto; padding: 0 1em; color: #222; }
table { border-collapse: collapse; font-size: 13px; margin: 1em 0; display: block; overflow-x: auto; }
th, td { padding: 2px 9px; border-bottom: 1px solid #ddd; white-space: nowrap; }
th { border-bottom: 2px solid #888; } tbody tr:hover { background: #f4f4f4; }
img { max-width: 100%; } h2 { border-top: 1px solid #ccc; padding-top: 0.6em; margin-top: 2em; }
"""

_HOW_TO_READ = """## How to read it

Times from different machines cannot be compared. Ratios within one table can, since its runs are interleaved. No time
includes compiling. In a work-precision picture the lower left corner is best: less time and less error. A steep line
belongs to a method of high order; a line that ends early on the left is limited by stability. Read a column of "time
to reach" from top to bottom: the bold entry is the fastest way to that accuracy. Errors in different metrics mean
different things: a trajectory with exact energy can be far off in phase."""


def add_options(parser: argparse.ArgumentParser) -> None:
    add_problems(parser)
    add_methods(parser)
    add_repeats(parser, 7)
    add_out(parser, "where to write it", required=True)


def run(options: argparse.Namespace) -> None:
    benchmark(out=options.out, repeats=options.repeats, only=options.problems, methods=options.methods)


def benchmark(
    *,
    out: Path,
    repeats: int = 7,
    only: Sequence[str] | None = None,
    methods: Sequence[str] | None = None,
    write: Callable[[str], None] = print,
) -> None:
    """Measure everything and write report.html, report.md, precision.json and the pictures into `out`."""
    names, chosen = choose(only, list(PROBLEM_SET), "--problem"), choose(methods, LIBRARY)
    in_c = [name for name in chosen if name in c.METHODS_IN_C]
    if not pictures.is_possible():
        raise SystemExit("eig3 bench report: the pictures need matplotlib; install it with pip install 'eig3[bench]'.")
    c.build_all()  # a compiler that fails ends the report here, and not after minutes of measuring
    files = Files(out, "eig3 bench")
    page = Page(files)
    page.add("# eig3: what accuracy costs in time", f"Machine: {in_words()}", _HOW_TO_READ)
    page.add(*_article_tables(files, repeats))
    write("the article's tables: done")
    page.add("## Beside C", _collected(lambda line: c.benchmark(methods=in_c, repeats=repeats, write=line)))
    write("C: done")
    page.add("## Work and precision", precision.heading(repeats, LONGEST))
    results: list[WorkPrecisionSet] = []
    for name in names:
        results.append(measure(name, PROBLEM_SET[name], chosen, repeats, LONGEST, rivals=True))
        page.add(*_work_precision(files, results[-1]))
        precision.save(files, results)
    write("work and precision: done")
    swept = {result.name: result for result in results}
    page.add("## What eig3.plan predicts", _collected(lambda line: plan.benchmark(only=only, swept=swept, write=line)))
    files.finish(write)


class Page:
    """The report so far. Each addition writes it again, so that an interruption loses nothing.

    The numbers are not printed. So a file that cannot be written ends the measurements.
    """

    def __init__(self, files: Files) -> None:
        self.files = files
        self.sections: list[str] = []

    def add(self, *sections: str) -> None:
        self.sections += sections
        markdown = "\n\n".join(self.sections) + "\n"
        with self.files.writing("report.md") as path:
            path.write_text(markdown)
        with self.files.writing("report.html") as path:
            path.write_text(html(markdown, self.files.folder))
        self.files.check()


def html(markdown: str, folder: Path) -> str:
    """One page that contains its pictures."""
    from markdown import markdown as converted

    body = converted(markdown, extensions=["tables", "sane_lists"])

    def embedded(match: re.Match[str]) -> str:
        data = base64.b64encode((folder / match[1]).read_bytes()).decode()
        return f'src="data:image/svg+xml;base64,{data}"'

    body = re.sub(r'src="([^"]+\.svg)"', embedded, body)
    head = f'<meta charset="utf-8"><title>eig3: what accuracy costs in time</title><style>{_STYLE}</style>'
    return f'<!doctype html>\n<html lang="en"><head>{head}</head>\n<body>\n{body}\n</body></html>\n'


def _article_tables(files: Files, repeats: int) -> list[str]:
    lines: list[str] = []
    results = paper.benchmark(repeats=repeats, quick=True, write=lines.append)
    pages = ["## The article's tables and claims", *(line.strip("\n") for line in lines)]
    figures = {f"table{result.table.number}.svg": partial(pictures.article_table, result) for result in results}
    pictures.draw(figures, files)
    shown = zip(figures, results, strict=True)
    return pages + [f"![Table {result.table.number}: error against time]({name})" for name, result in shown]


def _work_precision(files: Files, result: WorkPrecisionSet) -> list[str]:
    name = f"precision_{result.name}.svg"
    pictures.draw({name: partial(pictures.work_precision, result)}, files)
    picture = f"![{result.title}: error against time and evaluations]({name})"
    return [precision.render(result).replace("## ", "### "), picture]


def _collected(measure: Callable[[Callable[[str], None]], None]) -> str:
    """What a benchmark prints, as paragraphs."""
    lines: list[str] = []
    measure(lines.append)
    return "\n\n".join(line.strip("\n") for line in lines if line.strip())
