"""Write the loops over links as lines of Python source.

In the source, dx, dy, dz is the vector between the ends of a link, ex, ey, ez its rate, and r its length; fx, fy, fz is
the force of the link on its first end, divided by the mass if all masses are equal.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from .assembly import Assembly, Group
from .group_text import GroupText
from .source import Column, Source, Symbols
from .text import added, of_part


class LinksText(GroupText):
    """Links between two masses, or between a fixed end and a mass."""

    FORCES = ("tension", "force_density")

    def __init__(self, assembly: Assembly, source: Source, group: Group) -> None:
        super().__init__(assembly, source, group)
        self._anchor = None if group.anchor is None else source.column(group.anchor, is_place=True)
        # the motions of the fixed ends: each has a member for each link, and a number in its names
        self._moving: list[tuple[Symbols, Column | None, int]] = []
        for k, number in enumerate(group.motions):
            motion = source.motions[number]
            if motion.members > 1:
                assert group.moved is not None
                self._moving.append((motion, source.column(group.moved[:, k]), len(source.motions) + k))
            else:
                self._moving.append((motion, None, number))

    @property
    def is_row(self) -> bool:
        """Whether every link joins masses with consecutive indices."""
        return self.group.difference == 1

    def holds_end(self, row: LinksText) -> bool:
        """Return whether this is a single link from a support to an end of a row."""
        first = row.runs[0, 2]
        return self._anchor is not None and self.size == 1 and self.group.first[0] in (first, first + row.size)

    def forces(self) -> None:
        if self.is_row and self.group.in_runs and len(self.runs) > 1 and not self._source.is_of_part:
            self._rows()
            return
        with self._near_members(*self.FORCES) as (s, i, j):
            self.pull(s, i, j, self._common)
            for sign, end in [("+=", i), ("-=", j)] if self._joins_masses else [("-=", i)]:
                with self._only_if(of_part(end) if self._source.is_of_part else ""):
                    for axis in self._axes:
                        self._line(f"{self._at('a', axis, end)} {sign} f{axis}{self._by_mass(end)}")

    def _rows(self) -> None:
        self.constants(*self.FORCES)
        with self._runs():
            self.before()
            with self._run() as (s, i, j):
                self.separation(s, i, j)
                self.pull(s, i, j, self._common)
                for axis in self._axes:
                    self._line(f"{self._at('a', axis, i)} += (f{axis} - {axis}_before){self._by_mass(i)}")
                self.keep()
            self._line("i = i0 + count")
            for axis in self._axes:
                self._line(f"{self._at('a', axis, 'i')} -= {axis}_before{self._by_mass('i')}")

    def before(self) -> None:
        """Set the force before the first link of a row to zero."""
        self._line(f"{' = '.join(f'{axis}_before' for axis in self._axes)} = 0.0")

    def keep(self) -> None:
        """Keep the force of a link for the next link of the row, which shares a mass with it."""
        self._line(*(f"{axis}_before = f{axis}" for axis in self._axes))

    def potential(self) -> None:
        if laws := self.having("potential"):
            one = self.of_laws(laws)
            with one._near_members("potential") as (s, i, j):
                one._add_potentials(s, one._length(s, i, j, "potential"))

    def power(self) -> None:
        if laws := [law for law in self.laws if "potential" not in law.functions]:
            one = self.of_laws(laws)
            with one._near_members(*self.FORCES) as (s, i, j):
                offered = one._length(s, i, j, *self.FORCES, "power")
                tensions = [law.call("tension", s, offered) for law in one.having("tension")]
                densities = (law.call("force_density", s, offered) for law in one.having("force_density"))
                tensions += [f"{density} * {offered['r']}" for density in densities]
                self._line(f"total -= {added(tensions)} * {offered['rate']}")

    def power_of_supports(self) -> None:
        """Add the power of the supports that move."""
        if self._moving:
            with self._near_members(*self.FORCES) as (s, i, j):
                self.pull(s, i, j)
                self._line(*(f"total -= f{axis} * {self._support('v', axis, s)}" for axis in self._axes))

    def power_of_images(self) -> None:
        """Add the power of the images in a box that shears."""
        if self._box.shears:
            with self._near_members(*self.FORCES) as (s, i, j):
                self.pull(s, i, j)
                self._line(*self._box.power())

    def offered_here(self, s: str, i: str, j: str, *functions: str) -> dict[str, str]:
        self.separation(s, i, j)
        return self._length(s, i, j, *functions)

    def strike(self, s: str, i: str, j: str, offered: dict[str, str]) -> None:
        """Change the rate by opposite impulses on the ends, or by an impulse on the mass of a link to a support."""
        self._line(f"change = {self.laws[0].call('rate_after', s, offered)} - {offered['rate']}")
        ends = [("+=", i, "change")]
        if self._joins_masses:
            self._line(f"impulse = change / ({self._w(i)} + {self._w(j)})")
            ends = [("-=", i, f"impulse * {self._w(i)}"), ("+=", j, f"impulse * {self._w(j)}")]
        for axis in self._axes:
            along = f" * d{axis} * inverse" if not self._is_signed else " * -1" * (self.group.sign < 0)
            for sign, end, kick in ends:
                self._line(f"{self._at('v', axis, end)} {sign} {kick}{along}")

    def separation(self, s: str, i: str, j: str) -> None:
        """Compute the vector between the two ends."""
        for motion, member, name in self._moving:
            if member:
                self._line(f"moved = index({member.of(s)})")
                self._motion(motion, "moved", name)
        self._line(*(f"d{axis} = {self._difference('u', axis, s, i, j)}" for axis in self._axes))
        self._line(*self._box.nearest())

    def pull(self, s: str, i: str, j: str, factor: str = "") -> None:
        """Compute the force on the first end, times a factor, after `separation`."""
        offered = self._length(s, i, j, *self.FORCES)
        tensions, densities = ([law.call(f, s, offered) for law in self.having(f)] for f in self.FORCES)
        if self._is_signed:
            pulls = added(tensions + [f"{density} * dx" for density in densities])
            self._line(f"fx = {'-' if self.group.sign < 0 else ''}{pulls}{factor}")
            return
        if tensions:
            densities.append(f"{added(tensions)} * inverse")
        self._line(f"pull = {added(densities)}{factor}")
        self._line(*(f"f{axis} = pull * d{axis}" for axis in self._axes))

    def constants(self, *functions: str) -> None:
        super().constants(*functions)
        if self._anchor and self._anchor.is_uniform:
            for k, axis in enumerate(self._axes):
                if self._anchor.component(k, "") != "0.0":
                    self._line(f"{axis}_anchor = {self._anchor.component(k, '')}")

    @contextmanager
    def _near_members(self, *functions: str) -> Iterator[tuple[str, str, str]]:
        """Write a loop that computes the separation and skips links beyond the cutoffs of all their laws.

        The comparison of squares needs no square root. A link with a sign has no square root to avoid.
        """
        with self.members(*functions) as (s, i, j):
            self.separation(s, i, j)
            cutoffs = [law.value(law.effect.cutoff_field, s) for law in self.laws if law.effect.cutoff_field]
            near = ""
            if not self._is_signed and len(cutoffs) == len(self.laws):
                near = " or ".join(f"square < {cutoff} * {cutoff}" for cutoff in cutoffs)
                self._line(f"square = {self._square}")
            with self._only_if(near):
                yield s, i, j

    def _length(self, s: str, i: str, j: str, *functions: str) -> dict[str, str]:
        """Compute the arguments of these functions of the laws, and of the pull, after `separation`."""
        strikes = "rate_after" in functions and bool(self.having("rate_after"))
        needs_rate = self.reads("rate", *functions) or strikes or "power" in functions
        needs_inverse = needs_rate or ("tension" in functions and bool(self.having("tension")))
        if needs_rate:
            self._line(*(f"e{axis} = {self._difference('v', axis, s, i, j)}" for axis in self._axes))
            self._line(*self._box.rate())
        if self._is_signed:
            return {"t": "t", "r": "dx", "rate": "ex"}
        if needs_inverse or self.reads("r", *functions):
            self._line(f"r = sqrt(tiny + {self._square})")
        if needs_inverse:
            self._line("inverse = 1 / r")
        if needs_rate:
            self._line(f"rate = {added([f'd{axis} * e{axis}' for axis in self._axes])} * inverse")
        return {"t": "t", "r": "r", "rate": "rate"}

    @property
    def _square(self) -> str:
        """The squared length."""
        return " + ".join(f"d{axis} * d{axis}" for axis in self._axes)

    def _difference(self, array: str, axis: str, s: str, i: str, j: str) -> str:
        """The difference of the positions or velocities of the ends."""
        if self._joins_masses:
            low, high = self._at(array, axis, i), self._at(array, axis, j)
        else:
            low, high = self._support(array, axis, s), self._at(array, axis, i)
        if self.group.sign < 0:
            low, high = high, low
        if low == "0.0":
            return high
        return f"-{low}" if high == "0.0" else f"{high} - {low}"

    def _support(self, array: str, axis: str, s: str) -> str:
        """The position or velocity of a fixed end."""
        assert self._anchor is not None
        anchor = self._anchor.component(self._axes.index(axis), s)
        terms = []
        if array == "u" and anchor != "0.0":
            terms.append(f"{axis}_anchor" if self._anchor.is_uniform else anchor)
        name = "shift" if array == "u" else "speed"
        terms += [f"{axis}_{name}_{k}" for motion, _, k in self._moving if self._direction(motion, axis) != "0.0"]
        return added(terms) if terms else "0.0"
