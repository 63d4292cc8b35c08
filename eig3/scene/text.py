"""What the parts of a scene's source share: how they write, and the texts of entries and conditions."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from ..kernels.compile.source import Writer
from .assembly import Assembly
from .box_text import BoxText
from .packing import Packing, entry

NEXT = {"x": ("y", "z"), "y": ("z", "x"), "z": ("x", "y")}  # the axes that follow


class Text:
    """A part of the source of one scene. Its methods write lines."""

    def __init__(self, assembly: Assembly, packing: Packing, out: Writer) -> None:
        self._out, self._line, self._block, self._only_if = out, out.line, out.block, out.only_if
        self._n, self._axes, self._weight = assembly.n, "xyz"[: assembly.dimension], packing.weight
        self._follows_work, self._box = assembly.follows_work, BoxText(packing)

    @contextmanager
    def _function(self, head: str) -> Iterator[None]:
        """Write a function, which starts with the common inverse mass and the sides of the box."""
        self._line(*[""] * bool(self._out.lines), "@jit")
        with self._block(f"def {head}"):
            if self._weight.is_uniform:
                self._line(f"w = {self._weight.of('')}")
            self._line(*self._box.constants())
            yield

    def _at(self, array: str, axis: str, i: str) -> str:
        """A mass's entry in u, v or a."""
        return entry(array, self._n * self._axes.index(axis), i)

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
