"""`eig3 bench report`: every table and picture on one page, as HTML and as Markdown."""

from __future__ import annotations

import base64
import re
from collections.abc import Callable, Sequence
from pathlib import Path

from eig3.methods import METHODS

from . import baseline, hits, paper, precision, speed
from .environment import in_words

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 1150px; margin: 2em auto; padding: 0 1em; color: #222; }
table { border-collapse: collapse; font-size: 13px; margin: 1em 0; display: block; overflow-x: auto; }
th, td { padding: 2px 9px; border-bottom: 1px solid #ddd; white-space: nowrap; }
th { border-bottom: 2px solid #888; } tbody tr:hover { background: #f4f4f4; }
img { max-width: 100%; } h2 { border-top: 1px solid #ccc; padding-top: 0.6em; margin-top: 2em; }
"""

_HOW_TO_READ = """## How to read it

Times of different machines do not compare; ratios within one table do, for its runs are interleaved. Compiling is left
out everywhere. In a work-precision picture the lower left corner is best: less time, less error. A line that falls
steeply belongs to a method of high order; one that ends early on the left is limited by stability. A column of "time
to reach" is read downwards: the bold entry is what to use for that accuracy. Errors of different metrics are different
things: a trajectory may be far off in phase where its energy is exact."""


def run(
    *,
    out: Path,
    repeats: int = 7,
    only: Sequence[str] | None = None,
    methods: Sequence[str] | None = None,
    write: Callable[[str], None] = print,
) -> None:
    """Measure everything and write report.html, report.md, precision.json and the pictures into `out`."""
    names = speed.choose(only, list(precision.CASES), "--problem")
    compared = [name for name in speed.choose(methods, list(METHODS)) if name in baseline.METHOD_NAMES]
    page = Page(out)
    page.add("# eig3: what accuracy costs in time", f"Machine: {in_words()}", _HOW_TO_READ)
    page.add(*_articles_tables(out, repeats))
    write("the article's tables: done")
    page.add("## Beside C", _collected(lambda line: baseline.run(methods=compared, repeats=repeats, write=line)))
    write("C: done")
    page.add("## Work and precision", precision.heading(repeats, precision.LONGEST))
    results: list[precision.Result] = []
    for name in names:
        results.append(precision.measure(name, methods or list(METHODS), repeats, precision.LONGEST, rivals=True))
        page.add(*_set(out, results[-1]))
        precision.save(out, results)
    write("work and precision: done")
    page.add("## What eig3.plan predicts", _collected(lambda line: hits.run(only=only, write=line)))
    write(f"Written to {out}: report.html, report.md, precision.json and the pictures")


class Page:
    """The report so far, written anew as it grows, so that an interruption loses nothing."""

    def __init__(self, out: Path) -> None:
        self.out = out
        self.sections: list[str] = []

    def add(self, *sections: str) -> None:
        self.sections += sections
        markdown = "\n\n".join(self.sections) + "\n"
        (self.out / "report.md").write_text(markdown)
        (self.out / "report.html").write_text(html(markdown, self.out))


def html(markdown: str, folder: Path) -> str:
    """One page that holds its pictures."""
    from markdown import markdown as converted

    body = converted(markdown, extensions=["tables", "sane_lists"])

    def embedded(match: re.Match[str]) -> str:
        data = base64.b64encode((folder / match[1]).read_bytes()).decode()
        return f'src="data:image/svg+xml;base64,{data}"'

    body = re.sub(r'src="([^"]+\.svg)"', embedded, body)
    head = f'<meta charset="utf-8"><title>eig3: what accuracy costs in time</title><style>{_STYLE}</style>'
    return f'<!doctype html>\n<html lang="en"><head>{head}</head>\n<body>\n{body}\n</body></html>\n'


def _articles_tables(out: Path, repeats: int) -> list[str]:
    from .pictures import work_precision

    lines: list[str] = []
    results = paper.run(repeats=repeats, quick=True, write=lines.append)
    pages = ["## The article's tables and claims", *(line.strip("\n") for line in lines)]
    for result in results:
        name = f"table{result.table.number}.svg"
        work_precision(result, out / name)
        pages.append(f"![Table {result.table.number}: error against time]({name})")
    return pages


def _set(out: Path, result: precision.Result) -> list[str]:
    from .pictures import precision as draw

    name = f"precision_{result.name}.svg"
    draw(result, out / name)
    picture = f"![{result.case.title}: error against time and evaluations]({name})"
    return [precision.render(result).replace("## ", "### "), picture]


def _collected(measure: Callable[[Callable[[str], None]], None]) -> str:
    lines: list[str] = []
    measure(lines.append)
    return "\n\n".join(line.strip("\n") for line in lines if line.strip())
