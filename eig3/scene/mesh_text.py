"""Write the loops over cells as lines of Python source.

In the source, s is the index of a cell and i0, i1, ... are the indices of its points. x and velocity are tuples with
the positions and the velocities of its points, and push is a tuple with the forces on them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from .assembly import Assembly
from .cell import Cell
from .lines import of_part, only_if
from .packing import Column, MeshBlock, Packing, Symbols, entry


class MeshText:
    """The cells of one scene in the source. Each method returns lines, with their indentation."""

    def __init__(self, assembly: Assembly, packing: Packing) -> None:
        self._n = assembly.n
        self._axes = "xyz"[: assembly.dimension]
        self._weight = packing.weight
        self._meshes, self._supports, self._motions = packing.meshes, packing.supports, packing.motions

    def functions(self) -> Iterator[tuple[str, Iterable[str]]]:
        """The heads and bodies of the functions of the place and the velocity of a point of cells with supports."""
        if self._supports:
            yield "corner_place(t, u, p, i)", self._corner("u", "shift", self._supports.positions)
            yield "corner_speed(t, v, p, i)", self._corner("v", "speed", None)

    def forces(self) -> Iterator[str]:
        """Add the forces of all cells to the accelerations of their masses."""
        for block in self._meshes:
            is_mass = f"{{i}} < {self._n}" if block.mesh.held else ""
            yield from self._loop(block, [*self._push(block), *self._scatter(block, is_mass)])

    def forces_on_part(self) -> Iterator[str]:
        """Add the forces of all cells to the accelerations of their masses from the index low to the index end."""
        for block in self._meshes:
            lines = [*self._push(block), *self._scatter(block, of_part("{i}"))]
            yield from self._loop(block, only_if(of_part(*_indices(block)), lines))

    def potentials(self) -> Iterator[str]:
        """Add the potentials of all cells to the total."""
        for block in self._meshes:
            if "potential" in block.law.functions:
                extent = _effect(block).extent
                factor = f"{block.law.value(extent, 's')} * " if extent else ""
                lines = [*self._given(block, "potential")]
                lines.append(f"total += {factor}{block.law.call('potential', 's', _offered(block))}")
                yield from self._loop(block, lines)

    def power(self) -> Iterator[str]:
        """Add the power of cells without a potential on their masses, and of the supports that cells with one have."""
        for block in self._meshes:
            is_followed = "potential" not in block.law.functions
            at_supports = block.mesh.held and self._supports and self._supports.moved
            if is_followed or at_supports:
                lines = [*self._push(block, power=True)]
                for c, i in enumerate(_indices(block)):
                    product = " + ".join(f"push[{c}][{k}] * velocity[{c}][{k}]" for k in range(len(self._axes)))
                    line = f"total += {product}" if is_followed else f"total -= {product}"
                    side = f"if {i} < {self._n}:" if is_followed else f"if {i} >= {self._n}:"
                    lines += [side, f"    {line}"] if block.mesh.held else [line]
                yield from self._loop(block, lines)

    def _loop(self, block: MeshBlock, lines: Iterable[str]) -> Iterator[str]:
        yield from block.law.constants(*block.law.functions)
        yield f"for s in range({block.size}):"
        for c, i in enumerate(_indices(block)):
            yield f"    {i} = index({entry('p', block.table + c * block.size, 's')})"
        for line in lines:
            yield f"    {line}"

    def _push(self, block: MeshBlock, *, power: bool = False) -> Iterator[str]:
        """Compute the forces on the points of a cell."""
        effect, law, offered = _effect(block), block.law, _offered(block)
        acting = effect.conjugate or "forces"
        yield from self._given(block, acting, power=power)
        if effect.conjugate:
            yield f"{effect.conjugate} = {law.call(acting, 's', offered)}"
            yield f"push = {law.call('spread', 's', offered)}"
        else:
            yield f"push = {law.call('forces', 's', offered)}"

    def _given(self, block: MeshBlock, function: str, *, power: bool = False) -> Iterator[str]:
        """Compute what this function of a cell can take."""
        effect, law, offered = _effect(block), block.law, _offered(block)
        needs_rate = bool(effect.variable) and law.reads("rate", function)
        if effect.variable or law.reads("x", function):
            yield self._points("x", "u", block)
        if needs_rate or power or law.reads("v", function):
            yield self._points("velocity", "v", block)
        if effect.variable:
            yield f"{effect.variable} = {law.call('measure', 's', offered)}"
        if needs_rate:
            yield f"rate = {law.call('pace', 's', offered)}"

    def _points(self, name: str, array: str, block: MeshBlock) -> str:
        """Collect the positions or velocities of the points of a cell."""
        called = {"u": "corner_place", "v": "corner_speed"}[array]
        points = [f"{called}(t, {array}, p, {i})" if block.mesh.held else self._mass(array, i) for i in _indices(block)]
        return f"{name} = ({', '.join(points)},)"

    def _scatter(self, block: MeshBlock, condition: str) -> Iterator[str]:
        """Add the forces of a cell to the accelerations of its points i that meet a condition, or of all."""
        for c, i in enumerate(_indices(block)):
            inverse = "w" if self._weight.is_uniform else self._weight.of(i)
            on_axes = range(len(self._axes))
            lines = [f"{entry('a', self._n * k, i)} += push[{c}][{k}] * {inverse}" for k in on_axes]
            yield from only_if(condition.format(i=i), lines)

    def _corner(self, array: str, value: str, positions: Column | None) -> Iterator[str]:
        """The body of the function of the place, or of the velocity, of a point."""
        assert self._supports is not None
        yield f"if i < {self._n}:"
        yield f"    return {self._mass(array, 'i')}"
        yield f"s = i - {self._n}"
        for k, axis in enumerate(self._axes):
            yield f"{axis} = {positions.component(k, 's') if positions else '0.0'}"
        for number, members in self._supports.moved:
            motion = self._motions[number]
            yield from motion.constants("motion")
            yield f"moved = index({members.of('s')})"
            yield "if moved > 0:"
            yield f"    shift, speed = {motion.call('motion', '(moved - 1)', {'t': 't'})}"
            for axis, along in zip(self._axes, _directions(motion), strict=False):
                yield f"    {axis} += {value} * {along}"
        yield f"return {', '.join(self._axes)},"

    def _mass(self, array: str, i: str) -> str:
        return f"({', '.join(entry(array, self._n * k, i) for k in range(len(self._axes)))},)"


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
