"""Write the loops over the members of a group of effects, and over single masses, as lines of Python source.

In the source, s is the number of a member, and i and j are the indices of its masses.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import ClassVar, TypeVar

import numpy as np

from .assembly import Assembly, Group
from .effect import RATE
from .source import Source, Symbols
from .text import BlockText, of_part

M = TypeVar("M", bound="MembersText")


class MembersText(BlockText):
    """Laws on the same points, with a state and an event for each member.

    Attributes
    ----------
    laws : list of Symbols
    """

    laws: list[Symbols]

    def having(self, *functions: str) -> list[Symbols]:
        """Return the laws that have one of these functions."""
        return [law for law in self.laws if any(f in law.functions for f in functions)]

    def of_laws(self: M, laws: list[Symbols]) -> M:
        """Return the text with only these laws."""
        one = copy.copy(self)
        one.laws = laws
        return one

    def constants(self, *functions: str) -> None:
        """Read common parameters before the loop, because the compiler cannot prove that a and p do not alias."""
        for law in self.laws:
            self._line(*law.constants(*functions))

    def rates(self) -> None:
        """Write the rates of the states that are first-order unknowns."""
        for law in self.having(RATE):
            one = self.of_laws([law])
            with one.members(RATE) as (s, i, j):
                offered = one.offered_here(s, i, j, RATE)
                self._line(f"{law.columns[RATE].of(s)} = {law.call(RATE, s, offered)}")

    def offered(self, s: str, i: str, j: str, *functions: str) -> dict[str, str]:
        """Compute the arguments that these functions of one member can take; return their source by name."""
        self.constants(*functions)
        return self.offered_here(s, i, j, *functions)

    def offered_here(self, s: str, i: str, j: str, *functions: str) -> dict[str, str]:
        """Compute what `offered` does, in a loop over members."""
        raise NotImplementedError

    def members(self, *functions: str) -> AbstractContextManager[tuple[str, str, str]]:
        """Write a loop; give the names of the indices of the member and of its masses."""
        raise NotImplementedError


class GroupText(MembersText):
    """Forces on masses, and between two masses or a mass and a support.

    Attributes
    ----------
    group : Group
    size : int
        The number of members.
    runs : ndarray
        The runs of the group.
    """

    FORCES: ClassVar[tuple[str, ...]] = ()  # the names of the functions that are forces

    def __init__(self, assembly: Assembly, source: Source, group: Group) -> None:
        super().__init__(assembly, source)
        self.group, self.size, self.runs = group, group.first.size, group.runs
        self.laws = [source.symbols(law) for law in group.laws]
        points = [x for x in (group.first, group.second) if x is not None]
        self._joins_masses = group.second is not None
        # the place in p of the runs, or of all indices; unused if there is one run
        self._table = source.add(self.runs if group.in_runs else np.concatenate(points)) if len(self.runs) > 1 else 0
        has_events = any(law.events.size for law in self.laws)
        self._ends = [source.column(x) for x in points] if has_events else []

    def reads(self, name: str, *functions: str) -> bool:
        """Return whether one of these functions of a law has an argument of this name."""
        return any(law.reads(name, *functions) for law in self.laws)

    @contextmanager
    def member(self, head: str) -> Iterator[tuple[str, str, str]]:
        """Write a function for one member; give the names of the indices of the member and of its masses."""
        with self._function(head, self.group.motions):
            self._line("s = index(member)")
            self._line(*(f"{letter} = index({end.of('s')})" for letter, end in zip("ij", self._ends, strict=False)))
            yield "s", "i", "j"

    @contextmanager
    def members(self, *functions: str) -> Iterator[tuple[str, str, str]]:
        """Write a loop; give the names of the indices of the member and of its masses.

        In the function of a part, the loop skips members without masses in the part.
        """
        with self._all_members(*functions) as (s, i, j):
            masses = (i, j) if self._joins_masses else (i,)
            with self._only_if(of_part(*masses) if self._source.is_of_part else ""):
                yield s, i, j

    @contextmanager
    def _all_members(self, *functions: str) -> Iterator[tuple[str, str, str]]:
        self.constants(*functions)
        _, count, i0, j0 = self.runs[0]
        if self.size == 1:
            yield "0", str(i0), str(j0)
        elif len(self.runs) == 1:
            with self._block(f"for s in range({count})"):
                self._line(f"i, j = {i0} + s, {j0} + s" if self._joins_masses else f"i = {i0} + s")
                yield "s", "i", "j"
        elif self.group.in_runs:
            with self._runs(), self._run() as indices:
                yield indices
        else:
            with self._block(f"for s in range({self.size})"):
                self._line(f"i = index(p[{self._table} + s])")
                if self._joins_masses:
                    self._line(f"j = index(p[{self._table + self.size} + s])")
                yield "s", "i", "j"

    @contextmanager
    def _runs(self) -> Iterator[None]:
        with self._block(f"for k in range({self._table}, {self._table + self.runs.size}, 4)"):
            self._line("start, count, i0, j0 = index(p[k]), index(p[k + 1]), index(p[k + 2]), index(p[k + 3])")
            yield

    @contextmanager
    def _run(self) -> Iterator[tuple[str, str, str]]:
        with self._block("for along in range(count)"):
            self._line("s, i = start + along, i0 + along")
            if self._joins_masses:
                # If the difference is a constant, the compiler can prove that consecutive links share no mass.
                self._line(f"j = i + {self.group.difference}" if self.group.difference else "j = j0 + along")
            yield "s", "i", "j"

    def _add_potentials(self, s: str, offered: dict[str, str]) -> None:
        self._line(*(f"total += {law.call('potential', s, offered)}" for law in self.laws))


class MassesText(GroupText):
    """Forces on single masses, and accelerations."""

    FORCES = ("force", "acceleration")

    def forces(self) -> None:
        with self.members(*self.FORCES) as (s, i, _):
            accelerations, forces = self.given(s, i)
            for axis in self._axes:
                self._line(f"{self._at('a', axis, i)} += {self._along(axis, i, accelerations, forces)}")

    def potential(self) -> None:
        if laws := self.having("potential"):
            one = self.of_laws(laws)
            with one.members("potential") as (s, i, _):
                one._add_potentials(s, one._mass(i, "potential"))

    def power(self) -> None:
        if laws := [law for law in self.laws if "potential" not in law.functions]:
            one = self.of_laws(laws)
            with one.members(*self.FORCES) as (s, i, _):
                accelerations, forces = one.given(s, i, "power")
                for factor, names in (("", forces), ("m * ", accelerations)):
                    for name in names:
                        product = " + ".join(f"{name}[{k}] * velocity[{k}]" for k in range(len(self._axes)))
                        self._line(f"total += {factor}({product})")

    def offered_here(self, s: str, i: str, j: str, *functions: str) -> dict[str, str]:
        return self._mass(i, *functions)

    def strike(self, s: str, i: str, j: str, offered: dict[str, str]) -> None:
        self._line(f"after = {self.laws[0].call('velocity_after', s, offered)}")
        self._line(*(f"{self._at('v', axis, i)} = after[{k}]" for k, axis in enumerate(self._axes)))

    def given(self, s: str, i: str, *more: str) -> tuple[list[str], list[str]]:
        """Compute the accelerations and forces on mass i; return their names."""
        offered = self._mass(i, *self.FORCES, *more)
        names: dict[str, list[str]] = {"acceleration": [], "force": []}
        for function, found in names.items():
            for law in self.having(function):
                found.append(law.names[f"={function}"])
                self._line(f"{found[-1]} = {law.call(function, s, offered)}")
        return names["acceleration"], names["force"]

    def _mass(self, i: str, *functions: str) -> dict[str, str]:
        """Compute the arguments that one of these functions of the laws reads."""
        if self.reads("x", *functions):
            self._line(f"x = {self._vector('u', i)}")
        if self.reads("v", *functions) or "power" in functions:
            self._line(f"velocity = {self._vector('v', i)}")
        if self.reads("m", *functions) or ("power" in functions and self.having("acceleration")):
            self._line(f"m = 1 / {self._w(i)}")
        return {"t": "t", "x": "x", "v": "velocity", "m": "m"}
