"""Lines of Python source that are done on a condition."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence


def only_if(condition: str, lines: Sequence[str]) -> list[str]:
    """Return lines that are done on a condition, or always if it is empty."""
    return [f"if {condition}:", *indented(lines)] if condition else [*lines]


def indented(lines: Iterable[str]) -> Iterator[str]:
    """Return lines that are a level deeper."""
    return (f"    {line}" for line in lines)


def of_part(*masses: str) -> str:
    """Return the condition that one of these masses is among those of a part, which are from low to end."""
    return " or ".join(f"low <= {i} < end" for i in masses)
