"""Tables that are readable in a terminal and in Markdown, and a line that shows the progress of a benchmark."""

import sys
from collections.abc import Sequence


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """An aligned Markdown table: the first column is aligned left, the others right."""
    widths = [max(len(row[i]) for row in (header, *rows)) for i in range(len(header))]

    def line(cells: Sequence[str]) -> str:
        padded = (
            cell.ljust(w) if i == 0 else cell.rjust(w) for i, (cell, w) in enumerate(zip(cells, widths, strict=True))
        )
        return f"| {' | '.join(padded)} |"

    rule = (("-" * w if i == 0 else "-" * (w - 1) + ":") for i, w in enumerate(widths))
    return "\n".join([line(header), f"| {' | '.join(rule)} |", *map(line, rows)])


def number(value: float | None, digits: int = 3) -> str:
    """A number with this many significant digits, trailing zeros included; a dash for None."""
    if value is None:
        return "-"
    return "0.0" if value == 0 else f"{value:#.{digits}g}".removesuffix(".")


def ratio(value: float, decimals: int = 2) -> str:
    """A ratio with this many decimals, or with one significant digit if it is smaller."""
    return f"{value:.{decimals}f}" if value >= 10**-decimals else f"{value:.1g}"


def printed(value: float | None) -> str:
    """A number of the article with the digits that the article prints; a dash for None."""
    return "-" if value is None else f"{value:g}" if value else "0.0"


def status(text: str) -> None:
    """Overwrite the progress line on a terminal; an empty text clears it."""
    if sys.stderr.isatty():
        print(f"\r\033[K{text}", end="", file=sys.stderr, flush=True)
