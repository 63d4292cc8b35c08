"""Tables in HTML of what `repr` says, which notebooks show."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

_MOST = 8  # values that are shown
_NUMBER = r"(?:-?\d[\d.,]*(?:e[-+]?\d+)?|-?inf|nan)"
_RANGE = rf"{_NUMBER}(?: to {_NUMBER})?"
_COUNT = re.compile(rf"({_RANGE}) ((?:n?s )?)(.+)")  # such as "100 steps" or "0.2 s in the kernel"
_NAMED = re.compile(r"([^:=]+?)(?::| =) (.+)")
_MEASURED = re.compile(rf"({_RANGE})(?: (.+))?")  # a value, perhaps with its error, or what it is taken over
_BETWEEN_FACTS = re.compile(r", (?![^(]*\))")  # not within parentheses

_TABLE = "border-collapse: collapse; font-variant-numeric: tabular-nums; margin: 0.5em 0; min-width: 20em"
_TITLE = "caption-side: top; text-align: left; color: inherit; padding: 0 0 0.3em; white-space: normal"
_CELL = (
    "text-align: left; padding: 0.15em 1.2em 0.15em 0; vertical-align: baseline; white-space: pre-line; max-width: 45em"
)
_RIGHT, _FAINT = "text-align: right", "opacity: 0.7"
_LINE = "background: none; border: 0; border-top: 1px solid rgba(128, 128, 128, 0.3)"


def of_repr(shown: object) -> str:
    """Return the text of `repr` as a table: the first line is its title, and each fact a row of name, value, unit."""
    title, *lines = repr(shown).split("\n")
    return facts(title.rstrip(":"), [row for line in lines for row in _facts(line.strip())])


def _facts(line: str) -> Iterator[tuple[str, ...]]:
    """Yield the rows of a line: of each of its facts, or of the whole sentence."""
    if line.endswith("."):
        name, colon, sentence = line.partition("Note: ")
        yield ("Note", sentence) if colon and not name else (line,)
        return
    for fact in _BETWEEN_FACTS.split(line):
        if found := _COUNT.fullmatch(fact):
            value, unit, name = found.groups()
            yield name, value, unit.strip()
        elif found := _NAMED.fullmatch(fact):
            name, value = found.groups()
            measured = _MEASURED.fullmatch(value)
            yield name, *(filter(None, measured.groups()) if measured else (value,))
        else:
            yield (fact,)


def facts(title: str, rows: Iterable[Sequence[str]]) -> str:
    """Return a table in HTML, with rows of a name, a value and perhaps a unit, or of one sentence."""
    return _table(title, map(_fact, rows))


def _fact(row: Sequence[str]) -> str:
    name, *values = map(_escaped, row)
    if not values:
        return _cell(name, span=2)
    value, *units = values
    return _cell(name, _FAINT) + _cell(
        value + "".join(f' <span style="{_FAINT}">{unit}</span>' for unit in units if unit)
    )


def grid(title: str, head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in HTML with a head; numbers are on the right, and the last cell of a short row spans the rest."""
    lines = ["".join(_cell(_escaped(name), _RIGHT if i else "", "th") for i, name in enumerate(head))]
    for row in rows:
        styles = [_RIGHT if re.fullmatch(_NUMBER, cell) else "" for cell in row]
        *cells, last = zip(map(_escaped, row), styles, strict=True)
        lines.append("".join(_cell(*cell) for cell in cells) + _cell(*last, span=len(head) - len(cells)))
    return _table(title, lines)


def _table(title: str, rows: Iterable[str]) -> str:
    """Return a table of rows in HTML; its title is bold up to the first colon."""
    subject, colon, rest = _escaped(title).partition(":")
    caption = f'<caption style="{_TITLE}"><b>{subject}</b>{colon}{rest}</caption>'
    return "\n".join(
        [f'<table style="{_TABLE}">', caption, *(f'<tr style="{_LINE}">{row}</tr>' for row in rows), "</table>"]
    )


def _cell(text: str, style: str = "", tag: str = "td", span: int = 1) -> str:
    spanned = f' colspan="{span}"' * (span > 1)
    return f'<{tag} style="{_CELL}; {style}"{spanned}>{text}</{tag}>'


def _escaped(text: str) -> str:
    import html  # a notebook has it already; `import eig3` stays short

    return html.escape(text)


def brief(value: Any) -> str:
    """Return a value in few words: long arrays by their shape, functions by their name, dictionaries by their keys."""
    value = getattr(value, "func", value)  # of a partial function
    if value is None or isinstance(value, str):
        return value or ""
    if hasattr(value, "indptr"):
        return f"sparse matrix of {' x '.join(map(str, value.shape))}"
    if hasattr(value, "_asdict"):
        return ", ".join(f"{name} = {brief(x)}" for name, x in value._asdict().items())
    if callable(value):
        return getattr(value, "__name__", type(value).__name__) if value else ""
    if isinstance(value, Mapping):
        return ", ".join([*value][:_MOST]) + f" and {len(value) - _MOST} more" * (len(value) > _MOST)
    shape = value.shape if hasattr(value, "shape") else (len(value),) if hasattr(value, "__len__") else ()
    if math.prod(shape) > _MOST:
        return f"array of {' x '.join(map(str, shape))}"
    return ", ".join(map(brief, value)) if shape else f"{value:.10g}"
