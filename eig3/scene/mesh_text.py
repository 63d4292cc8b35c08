"""Write the loops over cells, and the functions of their supports, as lines of Python source.

In the source, s is the index of a cell and i0, i1, ... are the indices of its points. x and velocity are tuples with
the positions and the velocities of its points, and push is a tuple with the forces on them.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from .assembly import Assembly
from .cell import Cell
from .effect import JUMPING
from .group_text import MembersText
from .placed import Placed
from .source import Column, Source, entry
from .text import Text, of_part


class MeshText(MembersText):
    """Cells of one kind in the source.

    Attributes
    ----------
    size : int
        The number of cells.
    """

    def __init__(self, assembly: Assembly, source: Source, mesh: Placed) -> None:
        super().__init__(assembly, source)
        assert isinstance(mesh.effect, Cell)
        self._effect, self._law, corners = mesh.effect, source.symbols(mesh), np.array(mesh.points)
        self.laws = [self._law]
        self._table = source.add(corners)  # the first corners of all cells; the second corners follow, and so on
        count, self.size = corners.shape
        self._indices = [f"i{c}" for c in range(count)]
        self._is_held = bool((corners >= self._n).any())  # if so, every cell has a support
        self._moves = self._is_held and bool(assembly.supports.moved)
        variable, conjugate = self._effect.variable, self._effect.conjugate
        self._offered = {name: name for name in ("t", "x", "rate", variable, conjugate) if name} | {"v": "velocity"}

    def forces(self) -> None:
        is_part = self._source.is_of_part
        with self.members(), self._only_if(of_part(*self._indices) if is_part else ""):
            self._push()
            for c, i in enumerate(self._indices):
                with self._only_if(of_part(i) if is_part else f"{i} < {self._n}" if self._is_held else ""):
                    for k, axis in enumerate(self._axes):
                        self._line(f"{self._at('a', axis, i)} += push[{c}][{k}] * {self._w(i)}")

    def potential(self) -> None:
        if "potential" in self._law.functions:
            extent = self._effect.extent
            factor = f"{self._law.value(extent, 's')} * " if extent else ""
            with self.members():
                self._given("potential")
                self._line(f"total += {factor}{self._law.call('potential', 's', self._offered)}")

    def power(self) -> None:
        """Add the power of cells without a potential on their masses, and of the supports of cells with a potential."""
        is_followed = "potential" not in self._law.functions
        if is_followed or self._moves:
            with self.members():
                self._push(power=True)
                for c, i in enumerate(self._indices):
                    product = " + ".join(f"push[{c}][{k}] * velocity[{c}][{k}]" for k in range(len(self._axes)))
                    side, sign = ("<", "+=") if is_followed else (">=", "-=")
                    with self._only_if(f"{i} {side} {self._n}" if self._is_held else ""):
                        self._line(f"total {sign} {product}")

    def angles(self, first: int) -> None:
        """Write the angles of the cells into the array a, from the index `first` on."""
        with self.members(JUMPING):
            self._given(JUMPING)
            self._line(f"a[{first} + s] = {self._law.call(JUMPING, 's', self._offered)}")

    @contextmanager
    def member(self, head: str) -> Iterator[tuple[str, str, str]]:
        """Write a function for one cell."""
        with self._function(head):
            self._line("s = index(member)")
            self._corners()
            yield "s", "", ""

    def offered_here(self, s: str, i: str, j: str, *functions: str) -> dict[str, str]:
        self._given(*functions)
        return self._offered

    @contextmanager
    def members(self, *functions: str) -> Iterator[tuple[str, str, str]]:
        self.constants(*self._law.functions)
        with self._block(f"for s in range({self.size})"):
            self._corners()
            yield "s", "", ""

    def _corners(self) -> None:
        for c, i in enumerate(self._indices):
            self._line(f"{i} = index({entry('p', self._table + c * self.size, 's')})")

    def _push(self, *, power: bool = False) -> None:
        """Compute the forces on the points of a cell."""
        conjugate = self._effect.conjugate
        self._given(conjugate or "forces", power=power)
        if conjugate:
            self._line(f"{conjugate} = {self._law.call(conjugate, 's', self._offered)}")
        self._line(f"push = {self._law.call('forces', 's', self._offered)}")

    def _given(self, *functions: str, power: bool = False) -> None:
        """Compute the arguments that these functions of a cell can take."""
        variable, law = self._effect.variable, self._law
        needs_rate = bool(variable) and law.reads("rate", *functions)
        if variable or law.reads("x", *functions):
            self._points("x", "u")
        if needs_rate or power or law.reads("v", *functions):
            self._points("velocity", "v")
        if variable:
            self._line(f"{variable} = {law.call('value', 's', self._offered)}")
        if needs_rate:
            self._line(f"rate = {law.call('rate', 's', self._offered)}")

    def _points(self, name: str, array: str) -> None:
        """Collect the positions or velocities of the points of a cell."""
        called = {"u": "corner_place", "v": "corner_speed"}[array]
        points = (f"{called}(t, {array}, p, {i})" if self._is_held else self._vector(array, i) for i in self._indices)
        self._line(f"{name} = ({', '.join(points)},)")


class SupportsText(Text):
    """The functions of the position and the velocity of a point: a mass, or a support of cells or of pair forces."""

    def __init__(self, assembly: Assembly, source: Source) -> None:
        super().__init__(assembly, source)
        self._places = source.column(assembly.supports.positions, is_place=True)
        self._moved = [(source.motions[law], source.column(members)) for law, members in assembly.supports.moved]

    def functions(self) -> None:
        """Write the functions."""
        self._corner("corner_place(t, u, p, i)", "u", "shift", self._places)
        self._corner("corner_speed(t, v, p, i)", "v", "speed", None)

    def _corner(self, head: str, array: str, value: str, positions: Column | None) -> None:
        with self._function(head):
            with self._block(f"if i < {self._n}"):
                self._line(f"return {self._vector(array, 'i')}")
            self._line(f"s = i - {self._n}")
            for k, axis in enumerate(self._axes):
                self._line(f"{axis} = {positions.component(k, 's') if positions else '0.0'}")
            for motion, members in self._moved:
                self._line(*motion.constants("motion"), f"moved = index({members.of('s')})")
                with self._block("if moved > 0"):
                    self._line(f"shift, speed = {motion.call('motion', '(moved - 1)', {'t': 't'})}")
                    for axis in self._axes:
                        self._line(f"{axis} += {value} * {self._direction(motion, axis, '(moved - 1)')}")
            self._line(f"return {', '.join(self._axes)},")
