"""Write the loops over grains that touch each other, with the springs along their surfaces, as lines of Python source.

In the source, nx, ny, nz is the unit vector from the point to its mate, wx, wy, wz the velocity of the mate's surface
relative to the point's along the surfaces, sx, sy, sz the force along the surfaces on the point, and grip the
stiffness of the spring. x_spin, y_spin, z_spin is the spin of the point times its arm, the distance to the contact.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ..kernels import grains
from ..kernels.shared_forces import ACTING, ADVANCING, LISTS, STAGES
from .assembly import Assembly
from .lines import NEXT, cross, indented, only_if
from .packing import GrainsBlock, Packing, entry
from .swarm_text import SwarmText


class GrainsText(SwarmText[GrainsBlock]):
    """The grains of one scene in the source. Each method returns lines, with their indentation."""

    _functions = ("tension", "shear_stiffness", "shear_damping")

    def __init__(self, assembly: Assembly, packing: Packing) -> None:
        super().__init__(assembly, packing, packing.grains, len(packing.swarms))
        self._dimension, self._turn = assembly.dimension, packing.turn
        self._spins = "xyz"[3 - assembly.angles :] if assembly.angles else ""  # the axes about which points spin

    def forces(self) -> Iterator[str]:
        """Add the forces and torques of grains to the accelerations."""
        if self._spins:
            begin = self._n * self._dimension
            yield f"for k in range({begin}, {begin + self._n * len(self._spins)}):"
            yield "    a[k] = 0.0"
        if self._team is not None:
            yield from super().forces()
            return
        for number, block in enumerate(self._blocks, self._first):
            yield from self._alone(block, LISTS + number * STAGES + ACTING, "a")

    def _alone(self, block: GrainsBlock, stage: int, a: str) -> Iterator[str]:
        """Do a stage without other threads, in the function that they would share."""
        yield f"kept, place = memory(p), index({block.listing.place})"
        yield f"lists(REFRESH, {self._time}, memory(u), kept, place, place, place)"
        yield f"share(index({stage}), index(0), index(1), t, memory(u), memory(v), kept, memory({a}))"

    def stages(self) -> Iterator[str]:
        """Do a part of a stage that threads share, or all of it without them."""
        yield from self._stages()

    def _acting(self, block: GrainsBlock, first: int) -> Iterator[str]:
        """Add the forces and torques on the points of a part, or write their springs to the next table.

        One loop does both, because both need all that a contact is.
        """
        yield f"if stage == {first + ACTING} or stage == {first + ADVANCING}:"
        lines = [*self._of_part(block), f"writes = stage == {first + ADVANCING}", *self._springs(block)]
        size, which = block.table.size, f"kept[{block.place + grains.TABLE}]"
        lines += self._table(block, "next", f"index({block.place + grains.HEAD + size} - {size} * {which})")
        lines.append(f"held_count, held_end = room_of(kept, springs, {block.room}, part, parts)")
        lines += only_if("writes", ["for k in range(low, end):", "    next_firsts[k] = next_ends[k] = 0"])
        lines += self._part(block, "parts == 1 or writes")
        lines += only_if("writes", ["end_part(kept, springs, held_count)"])
        yield from indented(lines)

    def _act(self, block: GrainsBlock, act: Sequence[str], where: str = "") -> Iterator[str]:
        """Compute the forces and torques between grains, and add them, or write the springs."""
        given = "next_mates, next_values, held_count, mate, spring[0], spring[1], spring[2], grip, wx, wy, wz"
        write = ["if next_ends[point] == 0:", "    next_firsts[point] = held_count", f"hold({given})"]
        write += ["held_count += 1", "next_ends[point] = held_count"]
        add = [f"f{axis} = tension * n{axis} + s{axis}" for axis in self._axes]
        add += [*(f"q{axis} = {cross(axis, 'n', 's')}" for axis in self._spins), *act]
        choice = ["if not writes:", *indented(add), "elif held_count < held_end:", *indented(write)]
        choice += ["else:", "    refuse(kept, springs)"]
        yield from self._near(block, [[*self._contact(block), *choice]], where)

    def _on_point(self, block: GrainsBlock) -> list[str]:
        """Add the force and the torque to the point."""
        torques = [f"{self._spin('a', c, 'i')} += arm * q{x} * {self._t('i')}" for c, x in enumerate(self._spins)]
        return [*super()._on_point(block), *torques]

    def _on_mate(self, block: GrainsBlock) -> list[str]:
        """Add the force and the torque to the mate."""
        torques = [
            f"{self._spin('a', c, 'j')} += arm_of_mate * q{x} * {self._t('j')}" for c, x in enumerate(self._spins)
        ]
        return [*super()._on_mate(block), *torques]

    def power(self) -> Iterator[str]:
        """Add the power of grains on each other."""
        for block in self._blocks:
            add = [*self._contact(block), f"total -= tension * rate + {_dot('s', 'w')}"]
            if self._box.shears:
                add += ["fx = tension * nx + sx", *self._box.power()]
            yield from self._refreshed(block, *self._functions)
            yield from self._springs(block)
            yield from self._near(block, [add])

    def energy(self) -> Iterator[str]:
        """Add the kinetic energy of spins to the total."""
        if self._spins:
            square = " + ".join(f"{self._spin('v', c, 'i')} ** 2" for c in range(len(self._spins)))
            yield f"for i in range({self._n}):"
            yield f"    if {self._t('i')} > 0:"
            yield f"        total += ({square}) / (2 * {self._t('i')})"

    def begin(self) -> Iterator[str]:
        """Forget all springs."""
        for block in self._blocks:
            yield f"kept, springs = memory(p), index({block.place})"
            yield from self._table(block, "held", f"index({block.place + grains.HEAD})")
            yield f"for k in range({block.listing.masses}):"
            yield "    held_firsts[k] = held_ends[k] = 0"
            yield f"kept[springs], kept[{block.place + grains.TABLE}] = t, 0.0"
        yield "advance(t, u, v, p)"

    def advance(self) -> Iterator[str]:
        """Write the springs in a state to the other table, and take it from now on."""
        yield "out_of_line()"  # it is compiled once, though it has two callers
        for number, block in enumerate(self._blocks, self._first):
            yield f"place, springs = index({block.listing.place}), index({block.place})"
            if self._team is None:
                yield "write_in_turn(memory(p), springs)"
                yield from self._alone(block, LISTS + number * STAGES + ADVANCING, "u")
                yield "take_next(t, kept, springs)"
                continue
            given = "t, memory(u), memory(v), memory(p), place, springs"
            yield f"advance_springs(share, lists, {number}, {given}, {self._team})"

    def _springs(self, block: GrainsBlock) -> Iterator[str]:
        """Read where the table of the springs is."""
        for name in ("friction", "near_radius"):
            if name in block.law.columns:
                yield f"{name} = {block.law.columns[name].of('')}"
        yield f"springs = index({block.place})"
        yield "since = t - kept[springs]"
        size, which = block.table.size, f"kept[{block.place + grains.TABLE}]"
        yield from self._table(block, "held", f"index({block.place + grains.HEAD} + {size} * {which})")

    def _table(self, block: GrainsBlock, name: str, side: str) -> Iterator[str]:
        """Read where the parts of a table are."""
        table, masses = block.table, block.listing.masses
        yield f"side = {side}"
        yield f"{name}_firsts = integers(kept, side, {masses})"
        yield f"{name}_ends = integers(kept, side + {table.ends}, {masses})"
        yield f"{name}_mates = integers(kept, side + {table.mates}, {block.room})"
        yield f"{name}_values = floats(kept, side + {table.values}, {grains.VALUES * block.room})"

    def _reads_rate(self, block: GrainsBlock) -> bool:
        return True

    def _is_dense(self, block: GrainsBlock) -> bool:
        """Whether one loops over the points: the springs are found for each pair."""
        return False

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
        yield "h, h_end = index(held_firsts[point]), index(held_ends[point])"
        yield "h = found(held_mates, h, h_end, mate)"
        yield "known = h if h < h_end and held_mates[h] == mate else -1"
        yield "spring = stretched(held_values, known, since, grip, wx, wy, wz, nx, ny, nz, limit)"
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
        b, c = NEXT[axis]
        terms = [f"{b}_spin * n{c}"] * (b in self._spins) + [f"- {c}_spin * n{b}"] * (c in self._spins)
        return " ".join(terms)

    def _offered(self, block: GrainsBlock) -> dict[str, str]:
        return super()._offered(block) | {"radius": "radius", "mass": "mass"}

    def _spin(self, array: str, c: int, i: str) -> str:
        """A mass's entry in u, v or a for the angle about an axis."""
        return entry(array, self._n * (self._dimension + c), i)

    def _t(self, i: str) -> str:
        assert self._turn is not None
        return self._turn.of(i)


def _dot(first: str, second: str) -> str:
    return " + ".join(f"{first}{axis} * {second}{axis}" for axis in "xyz")
