"""Write the loops over grains in contact, with their tangential springs, as lines of Python source.

In the source, nx, ny, nz is the unit vector from the point to its mate, wx, wy, wz the tangential velocity of the
mate's surface relative to the point's surface, sx, sy, sz the tangential force on the point, and grip the stiffness of
the spring. x_spin, y_spin, z_spin is the angular velocity of the point times its arm, the distance to the contact.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..kernels import grains
from ..kernels.shared_forces import ACTING, ADVANCING
from .assembly import Assembly
from .pair_force import PairForce
from .pair_force_text import PairForceText
from .source import Source, entry
from .text import NEXT, cross

_CONTACTS = {2: 4, 3: 8}  # contacts of a grain, by the dimension: hard grains have 3 and 6

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


class GrainsText(PairForceText):
    """Frictional contacts in the source."""

    _functions = ("tension", "shear_stiffness", "shear_damping")

    def __init__(self, assembly: Assembly, source: Source, pair_force: PairForce, number: int) -> None:
        super().__init__(assembly, source, pair_force, number)
        self._room = self.listing.points * max(_CONTACTS[assembly.dimension], pair_force.neighbor_capacity or 0) + 64
        self._table = grains.Table.of(self.listing.masses, self._room)
        self._springs_at = source.add(np.zeros(grains.HEAD + 2 * self._table.size))
        self._has_groups = pair_force.second.size > 0
        source.functions |= grains.FUNCTIONS

    @property
    def springs(self) -> slice:
        """The place of the springs in p."""
        return slice(self._springs_at, self._springs_at + grains.HEAD + 2 * self._table.size)

    def forces(self) -> None:
        if self._source.team is not None:
            super().forces()
        else:
            self._alone(self._first + ACTING, "a")

    def _alone(self, stage: int, a: str) -> None:
        """Do a stage in one thread, in the function that threads would share."""
        self._line(f"kept, place = memory(p), int64({self.listing.place})")
        self._at_present()
        self._line(f"lists(REFRESH, {self._time}, memory(u), kept, place, place, place)")
        given = f"{stage}, 0, 1, t, memory(u), memory(v), kept, memory({a})"
        self._line(f"share_at(code_address(share))({given})")

    def _acting(self) -> None:
        """Add the forces and torques on the points of a part, or write their springs to the next table.

        One loop does both, because both need all quantities of a contact.
        """
        with self._block(f"if stage == {self._first + ACTING} or stage == {self._first + ADVANCING}"):
            self._of_part()
            self._line(f"writes = stage == {self._first + ADVANCING}")
            self._springs()
            size, which = self._table.size, f"kept[{self._springs_at + grains.TABLE}]"
            self._views_of("next", f"index({self._springs_at + grains.HEAD + size} - {size} * {which})")
            self._line(f"held_count, held_end = room_of(kept, springs, int64({self._room}), part, parts)")
            with self._block("if writes"), self._block("for k in range(low, end)"):
                self._line("next_firsts[k] = next_ends[k] = 0")
            self._part("parts == 1 or writes")
            with self._block("if writes"):
                self._line("end_part(kept, springs, held_count)")

    def _act(self, act: Callable[[], None], where: str = "") -> None:
        """Compute the forces and torques between grains, and add them, or write the springs."""

        def loop() -> None:
            self._contact()
            with self._block("if not writes"):
                self._line(*(f"f{axis} = tension * n{axis} + s{axis}" for axis in self._axes))
                self._line(*(f"q{axis} = {cross(axis, 'n', 's')}" for axis in self._spins))
                act()
            self._source.insert(_WRITE)

        self._near([loop], where)

    def _on_point(self) -> None:
        """Add the force and the torque to the point."""
        super()._on_point()
        for axis in self._spins:
            self._line(f"{self._spin('a', axis, 'i')} += arm * q{axis} * {self._t('i')}")

    def _on_mate(self) -> None:
        """Add the force and the torque to the mate."""
        super()._on_mate()
        for axis in self._spins:
            self._line(f"{self._spin('a', axis, 'j')} += arm_of_mate * q{axis} * {self._t('j')}")

    def potential(self) -> None:
        """Grains have none."""

    def power(self) -> None:
        self._refreshed(*self._functions)
        self._springs()
        self._near([lambda: self._add_power(True)])

    def _add_power(self, loses: bool) -> None:
        self._contact()
        self._line(f"total -= tension * rate + {' + '.join(f's{axis} * w{axis}' for axis in 'xyz')}")
        self._add_power_from_outside(lambda axis: f"tension * n{axis} + s{axis}")

    def begin(self) -> None:
        """Clear all springs."""
        self._line(f"kept, springs = memory(p), int64({self._springs_at})")
        self._views_of("held", f"int64({self._springs_at + grains.HEAD})")
        with self._block(f"for k in range({self.listing.masses})"):
            self._line("held_firsts[k] = held_ends[k] = 0")
        self._line(f"kept[springs], kept[{self._springs_at + grains.TABLE}] = t, 0.0")

    def advance(self) -> None:
        """Write the springs in a state to the other table, and switch the tables."""
        self._line(f"place, springs = int64({self.listing.place}), int64({self._springs_at})")
        if self._source.team is None:
            self._line("write_in_turn(memory(p), springs)")
            self._alone(self._first + ADVANCING, "u")
            self._line("take_next(t, kept, springs)")
            return
        self._line("kept = memory(p)")
        self._at_present()
        given = "t, memory(u), memory(v), kept, place, springs"
        self._line(f"advance_springs(share, lists, {self._number}, {given}, {self._source.team})")

    def _springs(self) -> None:
        """Read the place of the table of the springs."""
        for name in ("friction", "wall_radius"):
            if name in self._law.columns:
                self._line(f"{name} = {self._law.columns[name].of('')}")
        self._line(f"springs = int64({self._springs_at})", "since = t - kept[springs]")
        size, which = self._table.size, f"kept[{self._springs_at + grains.TABLE}]"
        self._views_of("held", f"index({self._springs_at + grains.HEAD} + {size} * {which})")

    def _views_of(self, name: str, side: str) -> None:
        """Read the places of the parts of a table."""
        table, masses = self._table, self.listing.masses
        self._line(f"side = {side}")
        self._line(f"{name}_firsts = integers(kept, side, {masses})")
        self._line(f"{name}_ends = integers(kept, side + {table.ends}, {masses})")
        self._line(f"{name}_mates = integers(kept, side + {table.mates}, {self._room})")
        self._line(f"{name}_values = floats(kept, side + {table.values}, {grains.VALUES * self._room})")

    @property
    def _reads_rate(self) -> bool:
        return True

    @property
    def _is_dense(self) -> bool:
        """Whether the loop is over the points: the springs are found for each pair."""
        return False

    def _contact(self) -> None:
        """Compute the normal and the tangential force between two grains."""
        law = self._law
        self._length(True)
        self._line(*(f"n{axis} = d{axis} * inverse" for axis in self._axes))
        if len(self._axes) == 2:
            self._line("nz = wz = 0.0")
        self._sizes()
        self._line(f"tension = {law.call('tension', '', self._offered)}")
        self._surfaces()
        self._line(f"grip = {law.call('shear_stiffness', '', self._offered)}")
        self._source.insert(_STRETCH)
        if "shear_damping" in law.functions:
            self._line(f"loss = {law.call('shear_damping', '', self._offered)}")
            forces = ", ".join(f"spring[{c}] + loss * w{axis}" for c, axis in enumerate("xyz"))
            self._line(f"sx, sy, sz = within_limit({forces}, limit)")
        else:
            self._line("sx, sy, sz = spring")

    def _sizes(self) -> None:
        """Compute the arms, whose sum is the distance, the effective radius and the effective mass."""
        own = self.listing.own.get("contact_distance")
        value = self._law.value("contact_distance", "") if own is None else self._field("contact_distance")
        self._line(f"contact_distance = {value}")
        if self._has_groups:
            radii = "(contact_distance - wall_radius)", "wall_radius"
        elif own is not None:
            radii = entry("p", own, "point"), entry("p", own, "mate")
        else:
            radii = "0.5 * contact_distance", "0.5 * contact_distance"
        self._line(f"arm, arm_of_mate = r * ({radii[0]}) / contact_distance, r * ({radii[1]}) / contact_distance")
        self._line(f"radius = ({radii[0]}) * ({radii[1]}) / contact_distance")
        self._line(f"mass = {self._w('i')}")
        with self._only_if(self._if_mass):
            self._line(f"j = {self._mass('mate')}", f"mass += {self._w('j')}")
        self._line("mass = 1 / mass")

    def _surfaces(self) -> None:
        """Compute the tangential velocity of the mate's surface relative to the point's surface."""
        if self._spins:
            self._line(*(f"{axis}_spin = arm * {self._spin('v', axis, 'i')}" for axis in self._spins))
            with self._only_if(self._if_mass):
                for axis in self._spins:
                    self._line(f"{axis}_spin += arm_of_mate * {self._spin('v', axis, 'j')}")
        for axis in self._axes:
            turned = f" - ({self._spin_cross(axis)})" if self._spins else ""
            self._line(f"w{axis} = e{axis} - rate * n{axis}{turned}")

    def _spin_cross(self, axis: str) -> str:
        """The component along an axis of the vector product of the angular velocities and n."""
        b, c = NEXT[axis]
        terms = [f"{b}_spin * n{c}"] * (b in self._spins) + [f"- {c}_spin * n{b}"] * (c in self._spins)
        return " ".join(terms)

    @property
    def _offered(self) -> dict[str, str]:
        return super()._offered | {"radius": "radius", "mass": "mass"}
