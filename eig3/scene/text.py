"""The base classes of the parts of a scene's source, and the texts of entries and conditions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from .assembly import Assembly
from .source import Column, Source, Symbols, entry

NEXT = {"x": ("y", "z"), "y": ("z", "x"), "z": ("x", "y")}  # the next axes in cyclic order


class Text:
    """A part of the source of one scene. Its methods write lines."""

    def __init__(self, assembly: Assembly, source: Source) -> None:
        self._source, self._line, self._block, self._only_if = source, source.line, source.block, source.only_if
        self._n, self._axes, self._weight = assembly.n, "xyz"[: assembly.dimension], source.weight
        self._follows_work, self._box = assembly.follows_work, source.box
        # in one dimension without a box, a link has a sign: its ends may pass through each other
        self._is_signed = len(self._axes) == 1 and not source.box.sides
        self._turn = source.turn
        self._spins = "xyz"[3 - assembly.angles :] if assembly.angles else ""  # the axes about which masses rotate

    @contextmanager
    def _function(self, head: str, motions: Iterable[int] = ()) -> Iterator[None]:
        """Write a function that starts with the common inverse mass, the sides of the box, and moved supports."""
        self._line(*[""] * bool(self._source.lines), "@jit")
        with self._block(f"def {head}"):
            if self._weight.is_uniform:
                self._line(f"w = {self._weight.of('')}")
            self._line(*self._box.constants())
            for number in sorted(motions):
                motion = self._source.motions[number]
                self._line(*motion.constants("motion"))
                if motion.members == 1:
                    self._motion(motion, "", number)
            yield

    def _motion(self, motion: Symbols, member: str, name: int) -> None:
        """Compute the displacement and velocity of one member of a motion; `name` is the number in their names."""
        self._line(f"shift, speed = {motion.call('motion', member, {'t': 't'})}")
        for axis in (axis for axis in self._axes if self._direction(motion, axis) != "0.0"):
            for value in ("shift", "speed"):
                self._line(f"{axis}_{value}_{name} = {value} * {self._direction(motion, axis, member)}")

    def _direction(self, motion: Symbols, axis: str, member: str = "") -> str:
        column = motion.columns["direction"]
        assert isinstance(column, Column)
        return column.component(self._axes.index(axis), member)

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

    @property
    def _common(self) -> str:
        """The factor of forces in a scene where all masses are equal."""
        return " * w" if self._weight.is_uniform else ""

    def _by_mass(self, i: str) -> str:
        """The factor of forces on mass i in a scene where masses differ."""
        return "" if self._weight.is_uniform else f" * {self._w(i)}"

    def _along(self, axis: str, i: str, accelerations: list[str], forces: list[str], pulls: Iterable[str] = ()) -> str:
        """The acceleration of mass i along an axis, as a sum."""
        k = self._axes.index(axis)
        divided = [f"{name}[{k}]" for name in accelerations]
        pushes = [f"{name}[{k}]" for name in forces]
        (divided if self._common else pushes).extend(pulls)
        if pushes:
            divided.append(f"{added(pushes)} * {self._w(i)}")
        return " + ".join(divided) or "0.0"


class BlockText(Text):
    """Effects of one kind in the source, with loops over what they act on."""

    def forces(self) -> None:
        """Add the forces to the accelerations of the masses, or of the masses of a part."""
        raise NotImplementedError

    def potential(self) -> None:
        """Add the potentials to the total."""

    def power(self) -> None:
        """Add the power of the effects without a potential, and of moving supports and images, to the total."""
        raise NotImplementedError


def added(terms: list[str]) -> str:
    """Return a sum, in parentheses if needed in a product."""
    total = " + ".join(terms)
    return f"({total})" if len(terms) > 1 or " - " in total else total


def cross(axis: str, first: str, second: str) -> str:
    """Return the component along an axis of the vector product of two vectors, such as dx, dy, dz."""
    b, c = NEXT[axis]
    return f"{first}{b} * {second}{c} - {first}{c} * {second}{b}"


def of_part(*masses: str) -> str:
    """Return the condition that one of these masses is in the part from low to end."""
    return " or ".join(f"low <= {i} < end" for i in masses)
