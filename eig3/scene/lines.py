"""Lines of Python source that are done on a condition."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

NEXT = {"x": ("y", "z"), "y": ("z", "x"), "z": ("x", "y")}  # the axes that follow


def cross(axis: str, first: str, second: str) -> str:
    """Return the component along an axis of the vector product of two vectors, such as dx, dy, dz."""
    b, c = NEXT[axis]
    return f"{first}{b} * {second}{c} - {first}{c} * {second}{b}"


def only_if(condition: str, lines: Sequence[str]) -> list[str]:
    """Return lines that are done on a condition, or always if it is empty."""
    return [f"if {condition}:", *indented(lines)] if condition else [*lines]


def indented(lines: Iterable[str]) -> Iterator[str]:
    """Return lines that are a level deeper."""
    return (f"    {line}" for line in lines)


def of_part(*masses: str) -> str:
    """Return the condition that one of these masses is among those of a part, which are from low to end."""
    return " or ".join(f"low <= {i} < end" for i in masses)
