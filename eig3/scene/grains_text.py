"""Write the loops over grains that touch each other, with the springs along their surfaces, as lines of Python source.

In the source, nx, ny, nz is the unit vector from the point to its mate, wx, wy, wz the velocity of the mate's surface
relative to the point's along the surfaces, sx, sy, sz the force along the surfaces on the point, and grip the
stiffness of the spring. x_spin, y_spin, z_spin is the spin of the point times its arm, the distance to the contact.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from ..kernels import grains
from .assembly import Assembly
from .lines import only_if
from .packing import GrainsBlock, Packing, SwarmBlock, entry
from .swarm_text import SwarmText

_NEXT = {"x": ("y", "z"), "y": ("z", "x"), "z": ("x", "y")}  # the axes that follow
_FUNCTIONS = ("tension", "shear_stiffness", "shear_damping")


class GrainsText(SwarmText):
    """The grains of one scene in the source. Each method returns lines, with their indentation."""

    def __init__(self, assembly: Assembly, packing: Packing) -> None:
        super().__init__(assembly, packing)
        self._grains, self._team = packing.grains, None
        self._dimension, self._turn = assembly.dimension, packing.turn
        self._spins = "xyz"[3 - assembly.angles :] if assembly.angles else ""  # the axes about which points spin

    def forces(self) -> Iterator[str]:
        """Add the forces and torques of grains to the accelerations."""
        if self._spins:
            begin = self._n * self._dimension
            yield f"for k in range({begin}, {begin + self._n * len(self._spins)}):"
            yield "    a[k] = 0.0"
        for block in self._grains:
            sums = [f"{axis}_sum" for axis in self._axes] + [f"{axis}_torque" for axis in self._spins]
            act = [*self._act(block), *self._on_mate(block)]
            inside = [f"{' = '.join(sums)} = 0.0", *self._of_mates(block, act)]
            inside += [f"{self._at('a', c, 'i')} += {axis}_sum * {self._w('i')}" for c, axis in enumerate(self._axes)]
            inside += [f"{self._spin('a', c, 'i')} += {x}_torque * {self._t('i')}" for c, x in enumerate(self._spins)]
            yield from self._all(block, inside)

    def power(self) -> Iterator[str]:
        """Add the power of grains on each other."""
        for block in self._grains:
            inside = [*self._contact(block), f"total -= tension * rate + {_dot('s', 'w')}"]
            if self._box.shears:
                inside += ["fx = tension * nx + sx", *self._box.power()]
            yield from self._all(block, self._of_mates(block, inside))

    def energy(self) -> Iterator[str]:
        """Add the kinetic energy of spins to the total."""
        if self._spins:
            square = " + ".join(f"{self._spin('v', c, 'i')} ** 2" for c in range(len(self._spins)))
            yield f"for i in range({self._n}):"
            yield f"    if {self._t('i')} > 0:"
            yield f"        total += ({square}) / (2 * {self._t('i')})"

    def begin(self) -> Iterator[str]:
        """Forget all springs."""
        for block in self._grains:
            yield f"kept, side = memory(p), index({block.place + grains.HEAD})"
            yield f"held_firsts = integers(kept, side, {block.listing.masses + 1})"
            yield f"for k in range({block.listing.masses + 1}):"
            yield "    held_firsts[k] = 0"
            yield f"kept[{block.place}] = t"
            yield f"kept[{block.place + 1}] = 0.0"
        yield "advance(t, u, v, p)"

    def advance(self) -> Iterator[str]:
        """Write the springs in a state to the other table, and take it from now on."""
        yield "out_of_line()"  # it is compiled once, though it has two callers
        for block in self._grains:
            table, room, masses = block.table, block.room, block.listing.masses
            inside = [
                "next_firsts[point] = held_count",
                *self._of_mates(block, [*self._contact(block), *self._hold(block)]),
            ]
            yield from self._springs(block)
            yield f"side = index({block.place + grains.HEAD + table.size} - {table.size} * kept[{block.place + 1}])"
            yield f"next_firsts = integers(kept, side, {masses + 1})"
            yield f"next_mates = integers(kept, side + {table.mates}, {room})"
            yield f"next_held = floats(kept, side + {table.values}, {grains.VALUES * room})"
            yield "held_count = 0"
            yield from self._grains_of(block, inside)
            yield f"next_firsts[{masses}] = held_count"
            yield f"kept[{block.place}] = t"
            yield f"kept[{block.place + 1}] = 1.0 - kept[{block.place + 1}]"

    def _hold(self, block: GrainsBlock) -> Iterator[str]:
        given = f"next_mates, next_held, held_count, {block.room}, mate"
        yield f"hold({given}, spring[0], spring[1], spring[2], grip, wx, wy, wz)"
        yield "held_count += 1"

    def _all(self, block: GrainsBlock, inside: Iterable[str]) -> Iterator[str]:
        """Loop over the grains of a list, with the springs of its table at hand."""
        yield from self._springs(block)
        yield from self._grains_of(block, inside)

    def _grains_of(self, block: GrainsBlock, inside: Iterable[str]) -> Iterator[str]:
        return self._masses(block, [*self._point(block, True), *inside])

    def _springs(self, block: GrainsBlock) -> Iterator[str]:
        """Refresh the list, and read where it and the table of its springs are."""
        table, room = block.table, block.room
        yield from self._refreshed(block, *_FUNCTIONS)
        for name in ("friction", "near_radius"):
            if name in block.law.columns:
                yield f"{name} = {block.law.columns[name].of('')}"
        yield f"since = t - kept[{block.place}]"
        yield f"side = index({block.place + grains.HEAD} + {table.size} * kept[{block.place + 1}])"
        yield f"held_firsts = integers(kept, side, {block.listing.masses + 1})"
        yield f"held_mates = integers(kept, side + {table.mates}, {room})"
        yield f"held = floats(kept, side + {table.values}, {grains.VALUES * room})"

    def _of_mates(self, block: GrainsBlock, inside: Iterable[str]) -> Iterator[str]:
        yield "h, h_end = int(held_firsts[point]), int(held_firsts[point + 1])"
        yield from self._mates(block, [*inside])

    def _act(self, block: GrainsBlock) -> Iterator[str]:
        """Add the force and the torque on the point."""
        yield from self._contact(block)
        for axis in self._axes:
            yield f"f{axis} = tension * n{axis} + s{axis}"
            yield f"{axis}_sum += f{axis}"
        for axis in self._spins:
            yield f"q{axis} = {_cross(axis, 'n', 's')}"
            yield f"{axis}_torque += arm * q{axis}"

    def _on_mate(self, block: GrainsBlock) -> list[str]:
        lines = [f"j = {self._mass(block, 'mate')}"]
        lines += [f"{self._at('a', c, 'j')} -= f{axis} * {self._w('j')}" for c, axis in enumerate(self._axes)]
        lines += [
            f"{self._spin('a', c, 'j')} += arm_of_mate * q{x} * {self._t('j')}" for c, x in enumerate(self._spins)
        ]
        return only_if(self._if_mass(block), lines)

    def _contact(self, block: GrainsBlock) -> Iterator[str]:
        """Compute the force between two grains: the tension, and that of the spring along their surfaces."""
        law = block.law
        yield from self._length(block, True)
        yield from (f"n{axis} = d{axis} * inverse" for axis in self._axes)
        if self._dimension == 2:
            yield "nz = wz = 0.0"
        yield from self._sizes(block)
        yield f"tension = {law.call('tension', '', self._offered(block))}"
        yield from self._surfaces(block)
        yield f"grip = {law.call('shear_stiffness', '', self._offered(block))}"
        yield "limit = friction * max(0.0, -tension)"
        yield "h = found(held_mates, h, h_end, mate)"
        yield "known = h if h < h_end and held_mates[h] == mate else -1"
        yield "spring = stretched(held, known, since, grip, wx, wy, wz, nx, ny, nz, limit)"
        if "shear_damping" in law.functions:
            yield f"loss = {law.call('shear_damping', '', self._offered(block))}"
            forces = ", ".join(f"spring[{c}] + loss * w{axis}" for c, axis in enumerate("xyz"))
            yield f"sx, sy, sz = within_limit({forces}, limit)"
        else:
            yield "sx, sy, sz = spring"

    def _sizes(self, block: GrainsBlock) -> Iterator[str]:
        """Compute the arms, which together are the distance, the effective radius and the effective mass."""
        own = block.listing.own.get("reach")
        reach = "reach"
        yield f"reach = {self._own(block, 'reach') if own is not None else block.law.value('reach', '')}"
        if block.has_groups:
            radii = f"({reach} - near_radius)", "near_radius"
        elif own is not None:
            radii = entry("p", own, "point"), entry("p", own, "mate")
        else:
            radii = "0.5 * reach", "0.5 * reach"
        yield f"arm, arm_of_mate = r * ({radii[0]}) / reach, r * ({radii[1]}) / reach"
        yield f"radius = ({radii[0]}) * ({radii[1]}) / reach"
        yield f"mass = {self._w('i')}"
        yield from only_if(self._if_mass(block), [f"j = {self._mass(block, 'mate')}", f"mass += {self._w('j')}"])
        yield "mass = 1 / mass"

    def _surfaces(self, block: GrainsBlock) -> Iterator[str]:
        """Compute the velocity of the mate's surface relative to the point's, along the surfaces."""
        if self._spins:
            for c, axis in enumerate(self._spins):
                yield f"{axis}_spin = arm * {self._spin('v', c, 'i')}"
            of_mate = [f"{x}_spin += arm_of_mate * {self._spin('v', c, 'j')}" for c, x in enumerate(self._spins)]
            yield from only_if(self._if_mass(block), of_mate)
        for axis in self._axes:
            turned = f" - ({self._spin_cross(axis)})" if self._spins else ""
            yield f"w{axis} = e{axis} - rate * n{axis}{turned}"

    def _spin_cross(self, axis: str) -> str:
        """The component along an axis of the product of the spins and n."""
        b, c = _NEXT[axis]
        terms = [f"{b}_spin * n{c}"] * (b in self._spins) + [f"- {c}_spin * n{b}"] * (c in self._spins)
        return " ".join(terms)

    def _offered(self, block: SwarmBlock) -> dict[str, str]:
        return super()._offered(block) | {"radius": "radius", "mass": "mass"}

    def _spin(self, array: str, c: int, i: str) -> str:
        """A mass's entry in u, v or a for the angle about an axis."""
        return entry(array, self._n * (self._dimension + c), i)

    def _t(self, i: str) -> str:
        assert self._turn is not None
        return self._turn.of(i)


def _dot(first: str, second: str) -> str:
    return " + ".join(f"{first}{axis} * {second}{axis}" for axis in "xyz")


def _cross(axis: str, first: str, second: str) -> str:
    b, c = _NEXT[axis]
    return f"{first}{b} * {second}{c} - {first}{c} * {second}{b}"
