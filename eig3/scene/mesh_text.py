"""Write the loops over cells as lines of Python source.

In the source, s is the index of a cell and i0, i1, ... are the indices of its points. x and velocity are tuples with
the positions and the velocities of its points, and push is a tuple with the forces on them.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from ..kernels.compile.source import Writer
from .assembly import Assembly
from .cell import Cell
from .packing import Column, MeshBlock, Packing, Symbols, entry
from .text import Text, of_part


class MeshText(Text):
    """The cells of one scene in the source."""

    def __init__(self, assembly: Assembly, packing: Packing, out: Writer) -> None:
        super().__init__(assembly, packing, out)
        self._meshes, self._supports, self._motions = packing.meshes, packing.supports, packing.motions

    def functions(self) -> None:
        """Write the functions of the place and the velocity of a point of cells with supports."""
        if self._supports:
            self._corner("corner_place(t, u, p, i)", "u", "shift", self._supports.positions)
            self._corner("corner_speed(t, v, p, i)", "v", "speed", None)

    def forces(self) -> None:
        """Add the forces of all cells to the accelerations of their masses."""
        for block in self._meshes:
            with self._loop(block):
                self._push(block)
                self._scatter(block, f"{{i}} < {self._n}" if block.mesh.held else "")

    def forces_on_part(self) -> None:
        """Add the forces of all cells to the accelerations of their masses from the index low to the index end."""
        for block in self._meshes:
            with self._loop(block), self._only_if(of_part(*_indices(block))):
                self._push(block)
                self._scatter(block, of_part("{i}"))

    def potentials(self) -> None:
        """Add the potentials of all cells to the total."""
        for block in self._meshes:
            if "potential" in block.law.functions:
                extent = _effect(block).extent
                factor = f"{block.law.value(extent, 's')} * " if extent else ""
                with self._loop(block):
                    self._given(block, "potential")
                    self._line(f"total += {factor}{block.law.call('potential', 's', _offered(block))}")

    def power(self) -> None:
        """Add the power of cells without a potential on their masses, and of the supports that cells with one have."""
        for block in self._meshes:
            is_followed = "potential" not in block.law.functions
            at_supports = block.mesh.held and self._supports and self._supports.moved
            if is_followed or at_supports:
                with self._loop(block):
                    self._push(block, power=True)
                    for c, i in enumerate(_indices(block)):
                        product = " + ".join(f"push[{c}][{k}] * velocity[{c}][{k}]" for k in range(len(self._axes)))
                        side, sign = ("<", "+=") if is_followed else (">=", "-=")
                        with self._only_if(f"{i} {side} {self._n}" if block.mesh.held else ""):
                            self._line(f"total {sign} {product}")

    @contextmanager
    def _loop(self, block: MeshBlock) -> Iterator[None]:
        self._line(*block.law.constants(*block.law.functions))
        with self._block(f"for s in range({block.size})"):
            for c, i in enumerate(_indices(block)):
                self._line(f"{i} = index({entry('p', block.table + c * block.size, 's')})")
            yield

    def _push(self, block: MeshBlock, *, power: bool = False) -> None:
        """Compute the forces on the points of a cell."""
        effect, law, offered = _effect(block), block.law, _offered(block)
        acting = effect.conjugate or "forces"
        self._given(block, acting, power=power)
        if effect.conjugate:
            self._line(f"{effect.conjugate} = {law.call(acting, 's', offered)}")
            self._line(f"push = {law.call('spread', 's', offered)}")
        else:
            self._line(f"push = {law.call('forces', 's', offered)}")

    def _given(self, block: MeshBlock, function: str, *, power: bool = False) -> None:
        """Compute what this function of a cell can take."""
        effect, law, offered = _effect(block), block.law, _offered(block)
        needs_rate = bool(effect.variable) and law.reads("rate", function)
        if effect.variable or law.reads("x", function):
            self._points("x", "u", block)
        if needs_rate or power or law.reads("v", function):
            self._points("velocity", "v", block)
        if effect.variable:
            self._line(f"{effect.variable} = {law.call('measure', 's', offered)}")
        if needs_rate:
            self._line(f"rate = {law.call('pace', 's', offered)}")

    def _points(self, name: str, array: str, block: MeshBlock) -> None:
        """Collect the positions or velocities of the points of a cell."""
        called = {"u": "corner_place", "v": "corner_speed"}[array]
        points = [f"{called}(t, {array}, p, {i})" if block.mesh.held else self._mass(array, i) for i in _indices(block)]
        self._line(f"{name} = ({', '.join(points)},)")

    def _scatter(self, block: MeshBlock, condition: str) -> None:
        """Add the forces of a cell to the accelerations of its points i that meet a condition, or of all."""
        for c, i in enumerate(_indices(block)):
            with self._only_if(condition.format(i=i)):
                for k, axis in enumerate(self._axes):
                    self._line(f"{self._at('a', axis, i)} += push[{c}][{k}] * {self._w(i)}")

    def _corner(self, head: str, array: str, value: str, positions: Column | None) -> None:
        """Write the function of the place, or of the velocity, of a point."""
        assert self._supports is not None
        with self._function(head):
            with self._block(f"if i < {self._n}"):
                self._line(f"return {self._mass(array, 'i')}")
            self._line(f"s = i - {self._n}")
            for k, axis in enumerate(self._axes):
                self._line(f"{axis} = {positions.component(k, 's') if positions else '0.0'}")
            for number, members in self._supports.moved:
                motion = self._motions[number]
                self._line(*motion.constants("motion"), f"moved = index({members.of('s')})")
                with self._block("if moved > 0"):
                    self._line(f"shift, speed = {motion.call('motion', '(moved - 1)', {'t': 't'})}")
                    for axis, along in zip(self._axes, _directions(motion), strict=False):
                        self._line(f"{axis} += {value} * {along}")
            self._line(f"return {', '.join(self._axes)},")

    def _mass(self, array: str, i: str) -> str:
        return f"({', '.join(self._at(array, axis, i) for axis in self._axes)},)"


def _directions(motion: Symbols) -> list[str]:
    column = motion.columns["direction"]
    assert isinstance(column, Column)
    assert column.zero is not None
    return [column.component(k, "(moved - 1)") for k in range(len(column.zero))]


def _effect(block: MeshBlock) -> Cell:
    effect = block.mesh.law.effect
    assert isinstance(effect, Cell)
    return effect


def _indices(block: MeshBlock) -> list[str]:
    return [f"i{c}" for c in range(len(block.mesh.corners))]


def _offered(block: MeshBlock) -> dict[str, str]:
    effect = _effect(block)
    names = ("t", "x", "rate", effect.variable, effect.conjugate)
    return {**{name: name for name in names if name}, "v": "velocity"}
