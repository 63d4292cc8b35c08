"""Write the loops over grains that touch each other, with the springs along their surfaces, as lines of Python source.

In the source, nx, ny, nz is the unit vector from the point to its mate, wx, wy, wz the velocity of the mate's surface
relative to the point's along the surfaces, sx, sy, sz the force along the surfaces on the point, and grip the
stiffness of the spring. x_spin, y_spin, z_spin is the spin of the point times its arm, the distance to the contact.
"""

from __future__ import annotations

from collections.abc import Callable

from ..kernels import grains
from ..kernels.compile.source import Writer
from ..kernels.shared_forces import ACTING, ADVANCING, LISTS, STAGES
from .assembly import Assembly
from .packing import GrainsBlock, Packing, entry
from .swarm_text import SwarmText
from .text import NEXT, cross

_WRITE = """\
elif held_count < held_end:
    if next_ends[point] == 0:
        next_firsts[point] = held_count
    hold(next_mates, next_values, held_count, mate, spring[0], spring[1], spring[2], grip, wx, wy, wz)
    held_count += 1
    next_ends[point] = held_count
else:
    refuse(kept, springs)
"""
_STRETCH = """\
limit = friction * max(0.0, -tension)
h, h_end = index(held_firsts[point]), index(held_ends[point])
h = found(held_mates, h, h_end, mate)
known = h if h < h_end and held_mates[h] == mate else -1
spring = stretched(held_values, known, since, grip, wx, wy, wz, nx, ny, nz, limit)
"""


class GrainsText(SwarmText[GrainsBlock]):
    """The grains of one scene in the source."""

    _functions = ("tension", "shear_stiffness", "shear_damping")

    def __init__(self, assembly: Assembly, packing: Packing, out: Writer) -> None:
        super().__init__(assembly, packing, out, packing.grains, len(packing.swarms))
        self._dimension, self._turn = assembly.dimension, packing.turn
        self._spins = "xyz"[3 - assembly.angles :] if assembly.angles else ""  # the axes about which points spin

    def forces(self) -> None:
        """Add the forces and torques of grains to the accelerations."""
        if self._spins:
            begin = self._n * self._dimension
            with self._block(f"for k in range({begin}, {begin + self._n * len(self._spins)})"):
                self._line("a[k] = 0.0")
        if self._team is not None:
            super().forces()
            return
        for number, block in enumerate(self._blocks, self._first):
            self._alone(block, LISTS + number * STAGES + ACTING, "a")

    def _alone(self, block: GrainsBlock, stage: int, a: str) -> None:
        """Do a stage without other threads, in the function that they would share."""
        self._line(f"kept, place = memory(p), index({block.listing.place})")
        self._line(f"lists(REFRESH, {self._time}, memory(u), kept, place, place, place)")
        self._line(f"share(index({stage}), index(0), index(1), t, memory(u), memory(v), kept, memory({a}))")

    def stages(self) -> None:
        """Do a part of a stage that threads share, or all of it without them."""
        self._stages()

    def _acting(self, block: GrainsBlock, first: int) -> None:
        """Add the forces and torques on the points of a part, or write their springs to the next table.

        One loop does both, because both need all that a contact is.
        """
        with self._block(f"if stage == {first + ACTING} or stage == {first + ADVANCING}"):
            self._of_part(block)
            self._line(f"writes = stage == {first + ADVANCING}")
            self._springs(block)
            size, which = block.table.size, f"kept[{block.place + grains.TABLE}]"
            self._table(block, "next", f"index({block.place + grains.HEAD + size} - {size} * {which})")
            self._line(f"held_count, held_end = room_of(kept, springs, {block.room}, part, parts)")
            with self._block("if writes"), self._block("for k in range(low, end)"):
                self._line("next_firsts[k] = next_ends[k] = 0")
            self._part(block, "parts == 1 or writes")
            with self._block("if writes"):
                self._line("end_part(kept, springs, held_count)")

    def _act(self, block: GrainsBlock, act: Callable[[], None], where: str = "") -> None:
        """Compute the forces and torques between grains, and add them, or write the springs."""

        def loop() -> None:
            self._contact(block)
            with self._block("if not writes"):
                self._line(*(f"f{axis} = tension * n{axis} + s{axis}" for axis in self._axes))
                self._line(*(f"q{axis} = {cross(axis, 'n', 's')}" for axis in self._spins))
                act()
            self._out.insert(_WRITE)

        self._near(block, [loop], where)

    def _on_point(self, block: GrainsBlock) -> None:
        """Add the force and the torque to the point."""
        super()._on_point(block)
        for axis in self._spins:
            self._line(f"{self._spin('a', axis, 'i')} += arm * q{axis} * {self._t('i')}")

    def _on_mate(self, block: GrainsBlock) -> None:
        """Add the force and the torque to the mate."""
        super()._on_mate(block)
        for axis in self._spins:
            self._line(f"{self._spin('a', axis, 'j')} += arm_of_mate * q{axis} * {self._t('j')}")

    def power(self) -> None:
        """Add the power of grains on each other."""
        for block in self._blocks:
            self._refreshed(block, *self._functions)
            self._springs(block)
            self._near(block, [lambda block=block: self._add_power(block)])

    def _add_power(self, block: GrainsBlock) -> None:
        self._contact(block)
        self._line(f"total -= tension * rate + {_dot('s', 'w')}")
        if self._box.shears:
            self._line("fx = tension * nx + sx", *self._box.power())

    def energy(self) -> None:
        """Add the kinetic energy of spins to the total."""
        if self._spins:
            square = " + ".join(f"{self._spin('v', axis, 'i')} ** 2" for axis in self._spins)
            with self._block(f"for i in range({self._n})"), self._block(f"if {self._t('i')} > 0"):
                self._line(f"total += ({square}) / (2 * {self._t('i')})")

    def begin(self) -> None:
        """Forget all springs."""
        for block in self._blocks:
            self._line(f"kept, springs = memory(p), index({block.place})")
            self._table(block, "held", f"index({block.place + grains.HEAD})")
            with self._block(f"for k in range({block.listing.masses})"):
                self._line("held_firsts[k] = held_ends[k] = 0")
            self._line(f"kept[springs], kept[{block.place + grains.TABLE}] = t, 0.0")
        self._line("advance(t, u, v, p)")

    def advance(self) -> None:
        """Write the springs in a state to the other table, and take it from now on."""
        self._line("out_of_line()")  # it is compiled once, though it has two callers
        for number, block in enumerate(self._blocks, self._first):
            self._line(f"place, springs = index({block.listing.place}), index({block.place})")
            if self._team is None:
                self._line("write_in_turn(memory(p), springs)")
                self._alone(block, LISTS + number * STAGES + ADVANCING, "u")
                self._line("take_next(t, kept, springs)")
                continue
            given = "t, memory(u), memory(v), memory(p), place, springs"
            self._line(f"advance_springs(share, lists, {number}, {given}, {self._team})")

    def _springs(self, block: GrainsBlock) -> None:
        """Read where the table of the springs is."""
        for name in ("friction", "near_radius"):
            if name in block.law.columns:
                self._line(f"{name} = {block.law.columns[name].of('')}")
        self._line(f"springs = index({block.place})", "since = t - kept[springs]")
        size, which = block.table.size, f"kept[{block.place + grains.TABLE}]"
        self._table(block, "held", f"index({block.place + grains.HEAD} + {size} * {which})")

    def _table(self, block: GrainsBlock, name: str, side: str) -> None:
        """Read where the parts of a table are."""
        table, masses = block.table, block.listing.masses
        self._line(f"side = {side}")
        self._line(f"{name}_firsts = integers(kept, side, {masses})")
        self._line(f"{name}_ends = integers(kept, side + {table.ends}, {masses})")
        self._line(f"{name}_mates = integers(kept, side + {table.mates}, {block.room})")
        self._line(f"{name}_values = floats(kept, side + {table.values}, {grains.VALUES * block.room})")

    def _reads_rate(self, block: GrainsBlock) -> bool:
        return True

    def _is_dense(self, block: GrainsBlock) -> bool:
        """Whether one loops over the points: the springs are found for each pair."""
        return False

    def _contact(self, block: GrainsBlock) -> None:
        """Compute the force between two grains: the tension, and that of the spring along their surfaces."""
        law = block.law
        self._length(block, True)
        self._line(*(f"n{axis} = d{axis} * inverse" for axis in self._axes))
        if self._dimension == 2:
            self._line("nz = wz = 0.0")
        self._sizes(block)
        self._line(f"tension = {law.call('tension', '', self._offered(block))}")
        self._surfaces(block)
        self._line(f"grip = {law.call('shear_stiffness', '', self._offered(block))}")
        self._out.insert(_STRETCH)
        if "shear_damping" in law.functions:
            self._line(f"loss = {law.call('shear_damping', '', self._offered(block))}")
            forces = ", ".join(f"spring[{c}] + loss * w{axis}" for c, axis in enumerate("xyz"))
            self._line(f"sx, sy, sz = within_limit({forces}, limit)")
        else:
            self._line("sx, sy, sz = spring")

    def _sizes(self, block: GrainsBlock) -> None:
        """Compute the arms, which together are the distance, the effective radius and the effective mass."""
        own = block.listing.own.get("reach")
        self._line(f"reach = {self._own(block, 'reach') if own is not None else block.law.value('reach', '')}")
        if block.has_groups:
            radii = "(reach - near_radius)", "near_radius"
        elif own is not None:
            radii = entry("p", own, "point"), entry("p", own, "mate")
        else:
            radii = "0.5 * reach", "0.5 * reach"
        self._line(f"arm, arm_of_mate = r * ({radii[0]}) / reach, r * ({radii[1]}) / reach")
        self._line(f"radius = ({radii[0]}) * ({radii[1]}) / reach")
        self._line(f"mass = {self._w('i')}")
        with self._only_if(self._if_mass(block)):
            self._line(f"j = {self._mass(block, 'mate')}", f"mass += {self._w('j')}")
        self._line("mass = 1 / mass")

    def _surfaces(self, block: GrainsBlock) -> None:
        """Compute the velocity of the mate's surface relative to the point's, along the surfaces."""
        if self._spins:
            self._line(*(f"{axis}_spin = arm * {self._spin('v', axis, 'i')}" for axis in self._spins))
            with self._only_if(self._if_mass(block)):
                for axis in self._spins:
                    self._line(f"{axis}_spin += arm_of_mate * {self._spin('v', axis, 'j')}")
        for axis in self._axes:
            turned = f" - ({self._spin_cross(axis)})" if self._spins else ""
            self._line(f"w{axis} = e{axis} - rate * n{axis}{turned}")

    def _spin_cross(self, axis: str) -> str:
        """The component along an axis of the product of the spins and n."""
        b, c = NEXT[axis]
        terms = [f"{b}_spin * n{c}"] * (b in self._spins) + [f"- {c}_spin * n{b}"] * (c in self._spins)
        return " ".join(terms)

    def _offered(self, block: GrainsBlock) -> dict[str, str]:
        return super()._offered(block) | {"radius": "radius", "mass": "mass"}

    def _spin(self, array: str, axis: str, i: str) -> str:
        """A mass's entry in u, v or a for the angle about an axis."""
        return entry(array, self._n * (self._dimension + self._spins.index(axis)), i)

    def _t(self, i: str) -> str:
        assert self._turn is not None
        return self._turn.of(i)


def _dot(first: str, second: str) -> str:
    return " + ".join(f"{first}{axis} * {second}{axis}" for axis in "xyz")
