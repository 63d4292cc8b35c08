"""The report as one HTML file."""

from __future__ import annotations

from .comparison import Comparison
from .markdown import page
from .record import Record


def html(record: Record, comparison: Comparison | None) -> str:
    """The whole page."""
    from markdown import markdown

    body = markdown(page(record, comparison), extensions=["tables", "sane_lists", "fenced_code"])
    head = '<meta charset="utf-8"><title>eig3: what accuracy costs in time</title>'
    return f'<!doctype html>\n<html lang="en"><head>{head}</head>\n<body>\n{body}\n</body></html>\n'
