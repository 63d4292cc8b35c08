"""What the parts of a scene's source share: how they write, and the texts of entries and conditions."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from .assembly import Assembly
from .source import Source, entry

NEXT = {"x": ("y", "z"), "y": ("z", "x"), "z": ("x", "y")}  # the axes that follow


class Text:
    """A part of the source of one scene. Its methods write lines."""

    def __init__(self, assembly: Assembly, source: Source) -> None:
        self._source, self._line, self._block, self._only_if = source, source.line, source.block, source.only_if
        self._n, self._axes, self._weight = assembly.n, "xyz"[: assembly.dimension], source.weight
        self._follows_work, self._box = assembly.follows_work, source.box
        self._turn = source.turn
        self._spins = "xyz"[3 - assembly.angles :] if assembly.angles else ""  # the axes about which masses spin

    @contextmanager
    def _function(self, head: str) -> Iterator[None]:
        """Write a function, which starts with the common inverse mass and the sides of the box."""
        self._line(*[""] * bool(self._source.lines), "@jit")
        with self._block(f"def {head}"):
            if self._weight.is_uniform:
                self._line(f"w = {self._weight.of('')}")
            self._line(*self._box.constants())
            yield

    def _at(self, array: str, axis: str, i: str) -> str:
        """A mass's entry in u, v or a."""
        return entry(array, self._n * self._axes.index(axis), i)

    def _spin(self, array: str, axis: str, i: str) -> str:
        """A mass's entry in u, v or a for the angle about an axis."""
        return entry(array, self._n * (len(self._axes) + self._spins.index(axis)), i)

    def _t(self, i: str) -> str:
        """The inverse inertia of mass i."""
        assert self._turn is not None
        return self._turn.of(i)

    def _vector(self, array: str, i: str) -> str:
        """The tuple of a mass's entries in u or v."""
        return f"({', '.join(self._at(array, axis, i) for axis in self._axes)},)"

    def _w(self, i: str) -> str:
        """The inverse mass of mass i."""
        return "w" if self._weight.is_uniform else self._weight.of(i)


def cross(axis: str, first: str, second: str) -> str:
    """Return the component along an axis of the vector product of two vectors, such as dx, dy, dz."""
    b, c = NEXT[axis]
    return f"{first}{b} * {second}{c} - {first}{c} * {second}{b}"


def of_part(*masses: str) -> str:
    """Return the condition that one of these masses is among those of a part, which are from low to end."""
    return " or ".join(f"low <= {i} < end" for i in masses)
