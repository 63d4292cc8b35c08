"""The page of a report: one HTML file with its charts, pictures and scripts, which needs no network."""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
import math
import re
import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..article_runs import MeasuredTable
from ..environment import in_words
from ..matrix import IN_WORDS, Matrix, abbreviated, in_units, lead, power, short
from ..modes import MODES
from ..paper import render as article_table
from ..paper import render_claims, render_footnotes, render_relative
from ..reference import METRICS
from ..rivals import RIVALS
from ..styles import SHAPES, in_order, style_of
from ..sweep import Point, WorkPrecisionSet
from ..tolerances import TOLERANCES
from .markdown import TITLES, how_measured

if TYPE_CHECKING:
    from .comparison import Comparison
    from .record import Record

_HERE = Path(__file__).parent
_START = 1e-6  # the accuracy that the slider shows first, if it was measured
_KNOWN = ("eig3", "cd", "rk4", "scipy dop853", "heyoka")
_DIGITS = 4  # of the numbers in charts


def html(record: Record, comparison: Comparison | None = None) -> str:
    """The page of a record, with a comparison if there is one."""
    import vl_convert
    from jinja2 import Environment, FileSystemLoader, StrictUndefined
    from markupsafe import Markup

    from .untrusted import to_html

    environment = Environment(
        loader=FileSystemLoader(_HERE), autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=StrictUndefined
    )
    environment.filters |= {
        "markdown": lambda source: Markup(to_html(source)),
        "power": power,
        "abbreviated": abbreviated,
        "short": short,
        "style": style_of,
        "time": in_units,
        "lead": lead,
        "anchor": anchor,
    }
    scripts = vl_convert.javascript_bundle().replace("</script", "<\\/script"), (_HERE / "page.js").read_text("utf-8")
    results = record.results
    modes = [mode for mode in MODES if any(mode in result.modes for result in results)]
    metrics = [metric for metric in METRICS if any(metric in result.metrics for result in results)]
    matrices = [Matrix.of(results, metric, mode) for metric in metrics for mode in modes]
    targets = matrices[0].targets if matrices else []
    sections = [Section(record, result, matrices) for result in results]
    return environment.get_template("page.html").render(
        record=record,
        summary=_summary(results),
        machine=in_words(record.run.environment),
        comparison=comparison,
        matrices=matrices,
        targets=targets,
        start=min(targets, key=lambda target: abs(math.log(target / _START)), default=None),
        metrics={metric: METRICS[metric] for metric in metrics},
        modes=modes,
        in_words=IN_WORDS,
        problems=sections,
        article=[(f"table{table.table.number}", article_table(table)) for table in record.article],
        claims="\n\n".join(page(record.article) for page in (render_footnotes, render_relative, render_claims)),
        how_measured=how_measured(record),
        titles=TITLES,
        labels=_labels(results),
        badges={method: f"b{i}" for i, (method, _) in enumerate(_labels(results))},
        shapes=SHAPES,
        css=Markup((_HERE / "page.css").read_text("utf-8")),
        policy=_policy(scripts),
        charts=Markup(scripts[0]),
        script=Markup(scripts[1]),
        data=Markup(_compressed(_data(sections, record.article))),
    )


class Section:
    """What the page shows of one problem."""

    def __init__(self, record: Record, result: WorkPrecisionSet, matrices: Sequence[Matrix]) -> None:
        self.result = result
        self.anchor = anchor(result.name)
        motion = record.motion(result.name)
        self.motion = f"data:image/webp;base64,{base64.b64encode(motion.read_bytes()).decode()}" if motion else None
        self.rows = {(m.metric, m.mode): row for m in matrices for row in m.rows if row.name == result.name}

    def methods(self, metric: str, mode: str) -> list[tuple[str, str]]:
        """The methods that reach an accuracy, in the order of legends."""
        reached = {found.method for contest in self.rows[metric, mode].contests for found in contest.reached}
        return [(method, self.result.methods[method]) for method in in_order(reached)]

    def reached(self, metric: str, mode: str) -> list[dict[str, Any]]:
        """For each accuracy, what reaches it by method."""
        return [{found.method: found for found in contest.reached} for contest in self.rows[metric, mode].contests]

    def leading(self) -> list[str]:
        """The methods that a chart shows first: the fastest, those that follow, and those that everyone knows."""
        held = [contest for row in self.rows.values() for contest in row.contests]
        leaders = {one.method for c in held for one in (c.fastest, c.next_own, c.next_rival) if one}
        return [method for method in self.result.methods if method in leaders or method in _KNOWN]


def anchor(name: str) -> str:
    """The address of a problem's section in the page."""
    return f"problem-{re.sub('[^a-zA-Z0-9_-]', '-', name)}"


def _summary(results: Sequence[WorkPrecisionSet]) -> str:
    measured, problems = dict(_labels(results)), len(results)
    rivals = sum(method in RIVALS for method in measured)
    methods = {method.partition(" ")[0] for method in measured if method not in RIVALS}  # in any form
    runs = sum(len(point.seconds) for result in results for point in result.points)
    points = sum(bool(point.seconds) for result in results for point in result.points)
    return (
        f"{len(methods)} methods of eig3 and {rivals} rivals on {problems} problem{'s' * (problems != 1)}: "
        f"{points:,} settings timed in {runs:,} interleaved runs, without compilation; a time is the median of its "
        "runs."
    )


def _policy(scripts: Sequence[str]) -> str:
    """The Content-Security-Policy of the page: its own scripts run and no others, and it loads nothing."""
    digests = (hashlib.sha256(script.encode()).digest() for script in scripts)
    own = " ".join(f"'sha256-{base64.b64encode(digest).decode()}'" for digest in digests)
    rules = {
        "default-src": "'none'",
        "script-src": own,
        "style-src": "'unsafe-inline'",
        "img-src": "data:",
        "base-uri": "'none'",
        "form-action": "'none'",
    }
    return "; ".join(f"{name} {allowed}" for name, allowed in rules.items())


def _labels(results: Sequence[WorkPrecisionSet]) -> list[tuple[str, str]]:
    """Every method and rival of the results, in the order of legends."""
    labels = {method: label for result in results for method, label in result.methods.items()}
    return [(method, labels[method]) for method in in_order(labels)]


def _compressed(data: Any) -> str:
    """Return data as JSON, compressed, in a string of JSON: three quarters less."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return f'"{base64.b64encode(gzip.compress(text.encode(), mtime=0)).decode()}"'


def _data(sections: Sequence[Section], article: Sequence[MeasuredTable]) -> dict[str, Any]:
    """What the charts show. A point is a list in the order of the names in `columns`."""
    labels = dict(_labels([section.result for section in sections]))
    labels |= {cell.method: cell.label for table in article for cell in table.cells}
    return {
        "shapes": SHAPES,
        "columns": ["method", "mode", "setting", "steps", "evaluations", "seconds", "low", "high", "errors"],
        "methods": {method: _described(method, label) for method, label in labels.items()},
        "metrics": METRICS,
        "charts": {
            **{section.result.name: _chart_of_problem(section) for section in sections},
            **{f"table{table.table.number}": _chart_of_table(table) for table in article},
        },
    }


def _described(method: str, label: str) -> dict[str, Any]:
    style = style_of(method)
    kind = "rival" if method in RIVALS else "tolerances" if method in TOLERANCES else "steps"
    drawn = {"color": style.color, "shape": style.shape, "sign": style.sign, "filled": style.is_filled}
    return {"label": label, "kind": kind, **drawn}


def _chart_of_problem(section: Section) -> dict[str, Any]:
    result = section.result
    return {
        "title": result.title,
        "metrics": result.metrics,
        "shown": section.leading(),
        "points": [_row(point) for point in result.points if point.stable and point.seconds],
    }


def _row(point: Point) -> list[Any]:
    errors = {metric: _short(error) for metric, error in point.errors.items() if math.isfinite(error)}
    counts = (point.n_steps, point.evaluations)
    return [point.method, point.mode, _short(point.setting), *counts, *_times(point.seconds), errors]


def _times(seconds: Sequence[float]) -> list[float]:
    """The median, and the range."""
    return [_short(value) for value in (statistics.median(seconds), min(seconds), max(seconds))]


def _chart_of_table(table: MeasuredTable) -> dict[str, Any]:
    """The chart of one of the article's tables. Its error is of the article's metric."""
    cells = [cell for cell in table.cells if 0 < cell.error < math.inf]
    points = [[c.method, "", c.h, c.n_steps, c.n_rhs, *_times(c.seconds), {"article": _short(c.error)}] for c in cells]
    return {
        "title": table.table.title,
        "metrics": ["article"],
        "error": table.table.metric,
        "shown": list({cell.method: None for cell in cells}),
        "points": points,
    }


def _short(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")
