"""Write the code of a scene as Python source, with a loop for each group of effects, and compile it with Numba.

Source has three advantages over closures. Users can read the code with `inspect.getsource`. Effects on the same points
share common values, such as a distance. Scenes of the same structure share one compiled function, because parameters
are not part of the source.

In the source, i and j are indices of masses and s is the index of a member of a group; w is an inverse mass; dx, dy, dz
is the vector between the ends of a link, ex, ey, ez its rate, and r its length; fx, fy, fz is the force of the link on
its first end, divided by the mass if all masses are equal.

The events of a group are two functions: where they occur, and what happens to the state there. Their first argument is
the number of the member, as a float.
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ..functions.callbacks import cached_jit, jit
from ..functions.events import Event
from ..functions.families import Family
from ..functions.history import Constraints, History
from ..kernels.compile.numba_internals import WITHOUT_C_WRAPPER
from ..kernels.compile.source import define
from ..kernels.constraint_lanes import Straight
from ..kernels.neighbours import bounds, memory
from ..kernels.protocol import index
from ..kernels.shared_forces import OWN, add_forces, advance_springs, set_forces
from ..kernels.team import out_of_line
from ..stepping.team import Shares
from .assembly import STATE, Assembly
from .bodies_text import BodiesText
from .constraint_text import ConstraintText
from .effect import FORCES, RESETS
from .grain_contact import Rough
from .grains_text import GrainsText
from .mesh_text import MeshText, SupportsText
from .source import Block, Column, Source, Symbols
from .swarm_text import SwarmText
from .text import Text, of_part

#: Near points, and cells, from which on threads share their forces. Links alone are not shared: to compute the force of
#: one takes less time than another core needs to get its ends, which the thread of the run has just moved.
_SHARED, _SHARED_CELLS = 2000, 5000

_BODY, _LINK = FORCES[:2], FORCES[2:4]
_TINY = (
    2.0**-1000
)  # added under a root to avoid a division by 0 where points coincide; too small to change other values


@cached_jit
def unchanged(t, u, v, p):  # type: ignore[no-untyped-def]
    """Leave the state as it is. The reset of a force that changes its form: it makes the method start anew."""


class Compiled(NamedTuple):
    """The right-hand side of a scene, its energy or None, its events and outputs, and the parameters of these."""

    rhs: Any
    energy: Any
    events: dict[str, Event]
    outputs: dict[str, Any]
    params: np.ndarray


def compiled(assembly: Assembly, threads: int | None = None) -> Compiled:
    """Return the functions of a scene, and their parameters.

    Scenes that differ only in parameters get the same functions. A large one is for this number of threads, if it
    is given.
    """
    source = Source(assembly)
    writing = _Functions(assembly, source, threads)
    writing.parts()
    if assembly.follows_work:
        writing.power()
    writing.rhs()
    if assembly.follows_work or assembly.is_conservative:
        writing.energy()
    if writing.grains:
        writing.history()
    writing.events()
    text, names = source.named()
    functions = _functions(text, tuple(names.items()))
    if source.team is not None:
        functions["rhs"].py_func.shares = Shares(functions["share"], source.team, assembly.n)
    if assembly.held:
        keeping = functions["projection"], functions["constrained_step"]
        functions["rhs"].py_func.constraints = Constraints(*keeping, writing.straight(functions))
    if writing.grains:
        functions["rhs"].py_func.history = History(functions["begin"], functions["advance"])
    found: dict[str, Event] = {}
    for occasion in writing.occasions:
        found |= occasion.events(functions, assembly.events)
    events = {name: found[name] for name in assembly.events}  # in the order in which the effects were added
    outputs = {"reactions": (functions["reactions"], len(assembly.held.names))} if assembly.held else {}
    return Compiled(functions["rhs"], functions.get("energy"), events, outputs, source.params)


@functools.lru_cache(maxsize=256)
def _functions(text: str, names: tuple[tuple[str, Any], ...]) -> dict[str, Any]:
    known = {"sqrt": math.sqrt, "rint": np.rint, "tiny": _TINY, "index": index, "unchanged": unchanged}
    known["jit"] = functools.partial(jit, **WITHOUT_C_WRAPPER)
    return define(text, "scene", {**known, **dict(names)})


@functools.lru_cache(maxsize=256)
def _members(function: Any, count: int) -> list[Any]:
    return Family(function, count).members


@dataclass(frozen=True, eq=False)
class _Occasion:
    """The events of one effect on a group.

    Attributes
    ----------
    numbers : ndarray of int
        The number of each member's event.
    direction : int
    g, apply : str
        The names of the functions; apply is empty if there is none, and "unchanged" for the function of this name.
    """

    numbers: np.ndarray
    direction: int
    g: str
    apply: str

    def events(self, functions: dict[str, Any], names: list[str]) -> dict[str, Event]:
        """Return the events by name."""
        count, same = self.numbers.size, {"": None, "unchanged": unchanged}
        g = _members(functions[self.g], count)
        apply = [same[self.apply]] * count if self.apply in same else _members(functions[self.apply], count)
        return {names[number]: Event(g[s], self.direction, apply=apply[s]) for s, number in enumerate(self.numbers)}


class _Functions(Text):
    """Writes the functions of one scene.

    Attributes
    ----------
    grains : list of GrainsText
    occasions : list of _Occasion
    """

    def __init__(self, assembly: Assembly, source: Source, threads: int | None) -> None:
        super().__init__(assembly, source)
        self._coordinates = assembly.coordinates
        self._work = assembly.degrees  # the index of the degree of freedom whose velocity is the work
        self._motions = source.motions
        bodies, links = ([source.group(group) for group in groups] for groups in (assembly.bodies, assembly.links))
        self._blocks, self._bodies, self._links = bodies + links, _acting(bodies, _BODY), _acting(links, _LINK)
        self._meshes = [MeshText(assembly, source, mesh) for mesh in assembly.meshes]
        self._supports = SupportsText(assembly, source) if assembly.supports.positions.size else None
        swarms = sorted(assembly.swarms, key=lambda swarm: isinstance(swarm.effect, Rough))
        near: list[SwarmText] = [
            (GrainsText if isinstance(swarm.effect, Rough) else SwarmText)(assembly, source, swarm, number)
            for number, swarm in enumerate(swarms)
        ]
        self._near, self.grains = near, [text for text in near if isinstance(text, GrainsText)]
        self._loops: list[MeshText | SwarmText] = [*self._meshes, *near]  # over all but single masses and links
        self._bodies_text = BodiesText(assembly, source)
        self._constraints = ConstraintText(assembly, source, assembly.held) if assembly.held else None
        self._shares_cells = threads is not None and sum(mesh.size for mesh in self._meshes) >= _SHARED_CELLS
        is_large = threads is not None and any(text.listing.masses >= _SHARED for text in near)
        if is_large or self._shares_cells:
            source.team = source.add(np.array([0, 0, threads]))
            source.functions |= {"set_forces": set_forces, "add_forces": add_forces}
            source.functions |= {"advance_springs": advance_springs, "memory": memory}
            source.functions |= {"bounds": bounds, "out_of_line": out_of_line}
        self._has_stages = source.team is not None or bool(self.grains)
        self._suffix = self._bodies_text.suffix
        self._rhs_name = f"forces{self._suffix}" if assembly.held else "rhs"
        self._own_masses = assembly.own
        # on a line without end, a link has a sign: its ends may pass through each other
        self._is_signed = len(self._axes) == 1 and not self._box.sides
        self.occasions: list[_Occasion] = []
        self._in_part = False  # whether the function is that of a part of the masses

    # The functions

    def straight(self, functions: dict[str, Any]) -> Straight | None:
        """Return a few constraints as lines for lanes, and let the reactions find their own function for lanes."""
        text = self._constraints and self._constraints.straight
        if not text:
            return None
        functions["reactions"].py_func.in_lanes = functions["reactions_in_lanes"]
        return text.straight(functions["forces"])

    def parts(self) -> None:
        """Write the functions that others call: the places of the corners of cells, and what threads share."""
        if self._supports:
            self._supports.functions()
        if self._has_stages:
            with self._linked("share(stage, part, parts, t, u, v, p, a)", self._links):
                self._line("out_of_line()")
                if self._shares_cells:
                    with self._block(f"if stage == {OWN}"):
                        self._forces_on_part()
                for text in self._near:
                    text.stages()

    def rhs(self) -> None:
        """Write the function of the accelerations."""
        with self._linked(f"{self._rhs_name}(t, u, v, p, a)", self._links):
            if self._shares_cells:
                velocity = "v" if self._reads_v else "u"  # a rhs that names v is one that reads it
                given = f"t, memory(u), memory({velocity}), memory(p), memory(a), {self._source.team}"
                self._line(f"set_forces(share, {given})")
            else:
                self._forces()
            if self._spins:
                begin = self._n * len(self._axes)
                with self._block(f"for k in range({begin}, {begin + self._n * len(self._spins)})"):
                    self._line("a[k] = 0.0")
            for text in self._near:
                text.forces()
            for k in range(self._coordinates, self._work):  # the states
                self._line(f"a[{k}] = 0.0")
            if self._follows_work:
                with self._block(f"if a.size > {self._work}"):  # a run that follows the work
                    self._line(f"a[{self._work}] = power(t, u, v, p)")
            if not self._suffix:
                self._bodies_text.plates()
        if self._suffix:
            with self._function("forces(t, u, v, p, a)"):
                self._bodies_text.forces()
                self._bodies_text.plates()
        if self._constraints:
            self._constraints.functions()

    def power(self) -> None:
        """Write the function of the power of the effects without a potential and of the supports."""
        with self._linked("power(t, u, v, p)", self._links):
            self._line("total = 0.0")
            for block in self._some(self._bodies, has_potential=False):
                with self._members(block, *_BODY) as (s, i, _):
                    accelerations, forces = self._given(block, s, i, "power")
                    for factor, names in (("", forces), ("m * ", accelerations)):
                        for name in names:
                            product = " + ".join(f"{name}[{k}] * velocity[{k}]" for k in range(len(self._axes)))
                            self._line(f"total += {factor}({product})")
            for block in self._some(self._links, has_potential=False):
                with self._near_members(block, *_LINK) as (s, i, j):
                    offered = self._length(block, s, i, j, *_LINK, "power")
                    tensions = [law.call("tension", s, offered) for law in block.having("tension")]
                    tensions += [
                        f"{law.call('density', s, offered)} * {offered['r']}" for law in block.having("density")
                    ]
                    self._line(f"total -= {_sum(tensions)} * {offered['rate']}")
            for block in (block for block in self._links if block.group.motions):
                with self._near_members(block, *_LINK) as (s, i, j):
                    self._pull(block, s, i, j)
                    self._line(*(f"total -= f{axis} * {self._support('v', block, axis, s)}" for axis in self._axes))
            for block in self._links if self._box.shears else []:
                with self._near_members(block, *_LINK) as (s, i, j):
                    self._pull(block, s, i, j)
                    self._line(*self._box.power())
            for text in self._loops:
                text.power()
            self._line("return total")

    def energy(self) -> None:
        """Write the function of the kinetic energy and the potentials, less the work in a run that follows it."""
        with self._linked(f"energy{self._suffix}(t, u, v, p)", self._links):
            self._line("total = 0.0")
            if self._follows_work:
                with self._block(f"if v.size > {self._work}"):
                    self._line(f"total -= v[{self._work}]")
            with self._masses(0, self._own_masses) as i:
                speeds = [self._at("v", axis, i) for axis in self._axes]
                self._line(f"total += {_sum([f'{v} * {v}' for v in speeds])} / (2 * {self._w(i)})")
            for block in self._some(self._bodies, has_potential=True):
                with self._members(block, "potential") as (s, i, _):
                    self._potentials(block, s, self._mass(block, i, "potential"))
            for block in self._some(self._links, has_potential=True):
                with self._near_members(block, "potential") as (s, i, j):
                    self._potentials(block, s, self._length(block, s, i, j, "potential"))
            for text in self._loops:
                text.potential()
            if self._spins:
                square = " + ".join(f"{self._spin('v', axis, 'i')} ** 2" for axis in self._spins)
                with self._block(f"for i in range({self._n})"), self._block(f"if {self._t('i')} > 0"):
                    self._line(f"total += ({square}) / (2 * {self._t('i')})")
            self._line("return total")
        if self._suffix:
            with self._function("energy(t, u, v, p)"):
                self._bodies_text.value("energy_of_all(t, everywhere, speeds, p)")

    def history(self) -> None:
        """Write the functions of the springs between grains."""
        with self._function("advance(t, u, v, p)"):
            self._line("out_of_line()")  # it is compiled once, though it has two callers
            for text in self.grains:
                text.advance()
            self._line("return 0.0")
        with self._function("begin(t, u, v, p)"):
            for text in self.grains:
                text.begin()
            self._line("advance(t, u, v, p)", "return 0.0")

    def events(self) -> None:
        """Write the two functions of the events of each effect on a group."""
        for block in self._blocks:
            for law in block.having("event"):
                one, k = replace(block, laws=[law]), len(self.occasions)
                g, apply = f"event_{k}", ""
                self._event(one, g)
                if any(name in law.functions for name in RESETS):
                    apply = f"reset_{k}"
                    self._reset(one, apply)
                elif any(name in law.functions for name in FORCES):
                    apply = "unchanged"
                self.occasions.append(_Occasion(law.events, law.effect.crossing, g, apply))

    # The parts of these functions

    def _forces(self) -> None:
        """Set all accelerations, by all forces but those between near points."""
        on_all, others = self._bodies_by_extent()
        rows = [block for block in self._links if block.is_row and len(block.runs) == 1 and block.size > 1]
        row = max(rows, key=lambda block: block.size, default=None)
        holding = [block for block in self._links if row and _holds_end(block, row)]
        self._every_mass(on_all, row, holding)
        for block in others:
            self._some_masses(block)
        for block in self._links:
            if block.is_row and block.group.in_runs and len(block.runs) > 1:
                self._rows(block)
            elif block is not row and block not in holding:
                self._pairs(block)
        for mesh in self._meshes:
            mesh.forces()

    def _forces_on_part(self) -> None:
        """Do so for the masses of a part. A force on masses of two parts is computed in both."""
        self._in_part, begin = True, len(self._source.lines)
        on_all, others = self._bodies_by_extent()
        self._line(f"low, end = bounds({self._n}, part, parts)")
        self._constants(on_all, *_BODY)
        with self._block("for i in range(low, end)"):
            self._set(on_all, "i")
        for block in others:
            self._some_masses(block)
        for block in self._links:
            self._pairs(block)
        for mesh in self._meshes:
            mesh.forces_on_part()
        self._in_part, self._reads_v = False, any(re.search(r"\bv\b", line) for line in self._source.lines[begin:])

    def _every_mass(self, on_all: list[Block], row: Block | None, holding: list[Block]) -> None:
        """Set all accelerations, from the effects on all masses and, in the same loop, the longest row of links.

        Along a row, the force of each link is kept for the next link, which shares a mass with it. `holding` are the
        links from supports to the first and last mass of the row.
        """
        start, stop = (row.runs[0, 2], row.runs[0, 2] + row.size + 1) if row else (self._n, self._n)
        self._constants([*on_all, *([row] if row else [])], *_BODY, *_LINK)
        for first, last in ((0, start), (stop, self._n)):
            if first < last:
                with self._masses(first, last) as i:
                    self._set(on_all, i)
        if row:
            self._before()
            self._hold(holding, start)
            with self._block(f"for s in range({row.size})"):
                self._line(f"i, j = {start} + s, {start + 1} + s")
                self._separation(row, "s", "i", "j")
                self._pull(row, "s", "i", "j", self._common)
                self._set(on_all, "i", lambda axis: f"f{axis} - {axis}_before")
                self._keep()
            self._hold(holding, stop - 1)
            self._set(on_all, str(stop - 1), lambda axis: f"-{axis}_before")

    def _hold(self, holding: list[Block], i: int) -> None:
        for block in (block for block in holding if block.group.first[0] == i):
            with self._members(block, *_LINK) as (s, i_source, j):
                self._separation(block, s, i_source, j)
                self._pull(block, s, i_source, j, self._common)
            self._line(*(f"{axis}_before += f{axis}" for axis in self._axes))

    def _set(self, on_all: list[Block], i: str, pull: Callable[[str], str] | None = None) -> None:
        accelerations: list[str] = []
        forces: list[str] = []
        for block in on_all:
            given = self._given(block, i, i)
            accelerations += given[0]
            forces += given[1]
        for axis in self._axes:
            pulls = [pull(axis)] if pull else []
            self._line(f"{self._at('a', axis, i)} = {self._along(axis, i, accelerations, forces, pulls)}")

    def _bodies_by_extent(self) -> tuple[list[Block], list[Block]]:
        """Return the effects on all masses, and those on some."""
        on_all = [block for block in self._bodies if block.size == self._n and len(block.runs) == 1]
        return on_all, [block for block in self._bodies if block not in on_all]

    def _some_masses(self, block: Block) -> None:
        with self._members(block, *_BODY) as (s, i, _):
            accelerations, forces = self._given(block, s, i)
            for axis in self._axes:
                self._line(f"{self._at('a', axis, i)} += {self._along(axis, i, accelerations, forces)}")

    def _pairs(self, block: Block) -> None:
        with self._near_members(block, *_LINK) as (s, i, j):
            self._pull(block, s, i, j, self._common)
            for sign, end in [("+=", i), ("-=", j)] if block.joins_masses else [("-=", i)]:
                with self._only_if(of_part(end) if self._in_part else ""):
                    for axis in self._axes:
                        self._line(f"{self._at('a', axis, end)} {sign} f{axis}{self._own(end)}")

    def _rows(self, block: Block) -> None:
        self._constants([block], *_LINK)
        with self._runs(block):
            self._before()
            with self._run(block) as (s, i, j):
                self._separation(block, s, i, j)
                self._pull(block, s, i, j, self._common)
                for axis in self._axes:
                    self._line(f"{self._at('a', axis, i)} += (f{axis} - {axis}_before){self._own(i)}")
                self._keep()
            self._line("i = i0 + count")
            for axis in self._axes:
                self._line(f"{self._at('a', axis, 'i')} -= {axis}_before{self._own('i')}")

    def _before(self) -> None:
        self._line(f"{' = '.join(f'{axis}_before' for axis in self._axes)} = 0.0")

    def _keep(self) -> None:
        self._line(*(f"{axis}_before = f{axis}" for axis in self._axes))

    def _event(self, block: Block, name: str) -> None:
        """Write the function whose zeros are the events of an effect on a block."""
        with self._of_member(name + self._suffix, block) as (s, i, j):
            offered = self._offered(block, s, i, j, "event")
            self._line(f"return float({block.laws[0].call('event', s, offered)})")
        if self._suffix:
            with self._function(f"{name}(member, t, u, v, p)"):
                self._bodies_text.value(f"{name}_of_all(member, t, everywhere, speeds, p)")

    def _reset(self, block: Block, name: str) -> None:
        """Write the function that changes the state at the events of an effect on a block.

        In a run that follows the work, the change of the energy is added to the work.
        """
        law = block.laws[0]
        with self._of_member(name + self._suffix, block) as (s, i, j):
            follows_work = self._follows_work and not self._suffix
            if follows_work:
                self._line("before = energy(t, u, v, p)")
            offered = self._offered(block, s, i, j, *RESETS)
            if "state_after" in law.functions:
                self._line(f"state = {law.call('state_after', s, offered)}")
            changes_velocity = law.functions.keys() & {"velocity_after", "rate_after"}
            constraints = self._constraints if changes_velocity and not self._suffix else None
            if constraints:
                constraints.before_impulse()
            if "velocity_after" in law.functions:
                self._line(f"after = {law.call('velocity_after', s, offered)}")
                for k, axis in enumerate(self._axes):
                    self._line(f"{self._at('v', axis, i)} = after[{k}]")
            if "rate_after" in law.functions:
                self._line(f"change = {law.call('rate_after', s, offered)} - {offered['rate']}")
                self._strike(block, i, j)
            if constraints:
                constraints.after_impulse()
            if "state_after" in law.functions:
                self._line(f"{law.columns[STATE].of(s)} = state")
            if follows_work:
                with self._block(f"if v.size > {self._work}"):
                    self._line(f"v[{self._work}] += energy(t, u, v, p) - before")

        if self._suffix:
            with self._function(f"{name}(member, t, u, v, p)"):
                assert self._constraints
                self._bodies_text.reset(f"{name}_of_all(member, t, everywhere, speeds, p)", self._constraints)

    @contextmanager
    def _of_member(self, name: str, block: Block) -> Iterator[tuple[str, str, str]]:
        """Write a function for one member of a block; give the names of the indices of the member and its masses."""
        with self._linked(f"{name}(member, t, u, v, p)", [block]):
            self._line("s = index(member)")
            for letter, end in zip("ij", block.ends, strict=False):
                self._line(f"{letter} = index({end.of('s')})")
            yield "s", "i", "j"

    def _strike(self, block: Block, i: str, j: str) -> None:
        """Change the rate of a link by opposite impulses on its ends, or by one on the mass of a link to a support."""
        ends = [("+=", i, "change")]
        if block.joins_masses:
            self._line(f"impulse = change / ({self._w(i)} + {self._w(j)})")
            ends = [("-=", i, f"impulse * {self._w(i)}"), ("+=", j, f"impulse * {self._w(j)}")]
        for axis in self._axes:
            along = f" * d{axis} * inverse" if not self._is_signed else " * -1" * (block.group.sign < 0)
            for sign, end, kick in ends:
                self._line(f"{self._at('v', axis, end)} {sign} {kick}{along}")

    def _offered(self, block: Block, s: str, i: str, j: str, *functions: str) -> dict[str, str]:
        """Compute the values that these functions of one member can take."""
        self._constants([block], *functions)
        if block.is_link:
            self._separation(block, s, i, j)
            return self._length(block, s, i, j, *functions)
        return self._mass(block, i, *functions)

    def _given(self, block: Block, s: str, i: str, *more: str) -> tuple[list[str], list[str]]:
        """Compute the accelerations and forces of the laws of a body on mass i; return their names."""
        offered = self._mass(block, i, *_BODY, *more)
        names: dict[str, list[str]] = {"acceleration": [], "force": []}
        for function, found in names.items():
            for law in block.having(function):
                found.append(law.names[f"={function}"])
                self._line(f"{found[-1]} = {law.call(function, s, offered)}")
        return names["acceleration"], names["force"]

    def _along(self, axis: str, i: str, accelerations: list[str], forces: list[str], pulls: Iterable[str] = ()) -> str:
        """The acceleration of mass i along an axis, as a sum."""
        k = self._axes.index(axis)
        divided = [f"{name}[{k}]" for name in accelerations]
        pushes = [f"{name}[{k}]" for name in forces]
        (divided if self._common else pushes).extend(pulls)
        if pushes:
            divided.append(f"{_sum(pushes)} * {self._w(i)}")
        return " + ".join(divided) or "0.0"

    def _mass(self, block: Block, i: str, *functions: str) -> dict[str, str]:
        """Compute those arguments of the laws of a body that one of these functions reads."""
        if block.reads("x", *functions):
            self._line(f"x = ({', '.join(self._at('u', axis, i) for axis in self._axes)},)")
        if block.reads("v", *functions) or "power" in functions:
            self._line(f"velocity = ({', '.join(self._at('v', axis, i) for axis in self._axes)},)")
        if block.reads("m", *functions) or ("power" in functions and block.having("acceleration")):
            self._line(f"m = 1 / {self._w(i)}")
        return {"t": "t", "x": "x", "v": "velocity", "m": "m"}

    def _separation(self, block: Block, s: str, i: str, j: str) -> None:
        """Compute the vector between the two ends of a link."""
        for motion, member, name in self._moving(block):
            if member:
                self._line(f"moved = index({member.of(s)})")
                self._motion(motion, "moved", name)
        self._line(*(f"d{axis} = {self._difference('u', block, axis, s, i, j)}" for axis in self._axes))
        self._line(*self._box.nearest())

    def _length(self, block: Block, s: str, i: str, j: str, *functions: str) -> dict[str, str]:
        """Compute the values that these functions of a link's laws, and its pull, need; call `_separation` first."""
        strikes = "rate_after" in functions and bool(block.having("rate_after"))
        needs_rate = block.reads("rate", *functions) or strikes or "power" in functions
        needs_inverse = needs_rate or ("tension" in functions and bool(block.having("tension")))
        if needs_rate:
            self._line(*(f"e{axis} = {self._difference('v', block, axis, s, i, j)}" for axis in self._axes))
            self._line(*self._box.rate())
        if self._is_signed:
            return {"t": "t", "r": "dx", "rate": "ex"}
        if needs_inverse or block.reads("r", *functions):
            self._line(f"r = sqrt(tiny + {self._square})")
        if needs_inverse:
            self._line("inverse = 1 / r")
        if needs_rate:
            self._line(f"rate = {_sum([f'd{axis} * e{axis}' for axis in self._axes])} * inverse")
        return {"t": "t", "r": "r", "rate": "rate"}

    @property
    def _square(self) -> str:
        """The squared length of a link."""
        return " + ".join(f"d{axis} * d{axis}" for axis in self._axes)

    def _difference(self, array: str, block: Block, axis: str, s: str, i: str, j: str) -> str:
        """The difference of the positions or velocities of a link's ends."""
        if block.joins_masses:
            low, high = self._at(array, axis, i), self._at(array, axis, j)
        else:
            low, high = self._support(array, block, axis, s), self._at(array, axis, i)
        if block.group.sign < 0:
            low, high = high, low
        if low == "0.0":
            return high
        return f"-{low}" if high == "0.0" else f"{high} - {low}"

    def _support(self, array: str, block: Block, axis: str, s: str) -> str:
        """The position or velocity of a fixed end."""
        assert block.anchor is not None
        anchor = block.anchor.component(self._axes.index(axis), s)
        terms = []
        if array == "u" and anchor != "0.0":
            terms.append(f"{axis}_anchor" if block.anchor.is_uniform else anchor)
        name = "shift" if array == "u" else "speed"
        terms += [
            f"{axis}_{name}_{k}" for motion, _, k in self._moving(block) if self._direction(motion, axis) != "0.0"
        ]
        return _sum(terms) if terms else "0.0"

    def _moving(self, block: Block) -> Iterator[tuple[Symbols, Column | None, int]]:
        """The motions of a block's fixed ends: each with its member for each link, and the number in its names."""
        for k, (number, member) in enumerate(zip(block.group.motions, block.moved, strict=True)):
            motion = self._motions[number]
            yield motion, member, len(self._motions) + k if member else number

    def _direction(self, motion: Symbols, axis: str, member: str = "") -> str:
        column = motion.columns["direction"]
        assert isinstance(column, Column)
        return column.component(self._axes.index(axis), member)

    def _pull(self, block: Block, s: str, i: str, j: str, factor: str = "") -> None:
        """Compute the force on the first end of a link, times a factor, after `_separation`."""
        offered = self._length(block, s, i, j, *_LINK)
        tensions, densities = ([law.call(f, s, offered) for law in block.having(f)] for f in _LINK)
        if self._is_signed:
            pulls = _sum(tensions + [f"{density} * dx" for density in densities])
            self._line(f"fx = {'-' if block.group.sign < 0 else ''}{pulls}{factor}")
            return
        if tensions:
            densities.append(f"{_sum(tensions)} * inverse")
        self._line(f"pull = {_sum(densities)}{factor}")
        self._line(*(f"f{axis} = pull * d{axis}" for axis in self._axes))

    def _potentials(self, block: Block, s: str, offered: dict[str, str]) -> None:
        self._line(*(f"total += {law.call('potential', s, offered)}" for law in block.laws))

    def _some(self, blocks: list[Block], *, has_potential: bool) -> Iterator[Block]:
        """The blocks with only those of their laws that have a potential, or that have none."""
        for block in blocks:
            laws = [law for law in block.laws if ("potential" in law.functions) == has_potential]
            if laws:
                yield replace(block, laws=laws)

    # Masses and members

    @property
    def _common(self) -> str:
        """The factor of forces in a scene where all masses are equal."""
        return " * w" if self._weight.is_uniform else ""

    def _own(self, i: str) -> str:
        """The factor of forces on mass i in a scene where masses differ."""
        return "" if self._weight.is_uniform else f" * {self._w(i)}"

    @contextmanager
    def _masses(self, first: int, stop: int) -> Iterator[str]:
        """Write a loop over masses; give the name of the index."""
        if stop - first == 1:
            yield str(first)
        else:
            with self._block(f"for i in range({first}, {stop})"):
                yield "i"

    @contextmanager
    def _members(self, block: Block, *functions: str) -> Iterator[tuple[str, str, str]]:
        """Write a loop over a block; give the names of the indices of the member and of its masses.

        In the function of a part, it skips members without masses of the part.
        """
        with self._all_members(block, *functions) as (s, i, j), self._only_if(self._if_part(block, i, j)):
            yield s, i, j

    def _if_part(self, block: Block, i: str, j: str) -> str:
        """The condition that a member has a mass of the part; empty if there are no parts."""
        if not self._in_part:
            return ""
        return of_part(i, j) if block.joins_masses else of_part(i)

    @contextmanager
    def _all_members(self, block: Block, *functions: str) -> Iterator[tuple[str, str, str]]:
        self._constants([block], *functions)
        _, count, i0, j0 = block.runs[0]
        if block.size == 1:
            yield "0", str(i0), str(j0)
        elif len(block.runs) == 1:
            with self._block(f"for s in range({count})"):
                self._line(f"i, j = {i0} + s, {j0} + s" if block.joins_masses else f"i = {i0} + s")
                yield "s", "i", "j"
        elif block.group.in_runs:
            with self._runs(block), self._run(block) as indices:
                yield indices
        else:
            with self._block(f"for s in range({block.size})"):
                self._line(f"i = index(p[{block.table} + s])")
                if block.joins_masses:
                    self._line(f"j = index(p[{block.table + block.size} + s])")
                yield "s", "i", "j"

    @contextmanager
    def _near_members(self, block: Block, *functions: str) -> Iterator[tuple[str, str, str]]:
        """Write a loop over links that computes their separation and skips links beyond the cutoffs of all their laws.

        It compares squares and thus needs no square root. A link with a sign has no square root to avoid.
        """
        with self._members(block, *functions) as (s, i, j):
            self._separation(block, s, i, j)
            cutoffs = [law.value(law.effect.cutoff, s) for law in block.laws if law.effect.cutoff]
            near = ""
            if not self._is_signed and len(cutoffs) == len(block.laws):
                near = " or ".join(f"square < {cutoff} * {cutoff}" for cutoff in cutoffs)
                self._line(f"square = {self._square}")
            with self._only_if(near):
                yield s, i, j

    @contextmanager
    def _runs(self, block: Block) -> Iterator[None]:
        with self._block(f"for k in range({block.table}, {block.table + block.runs.size}, 4)"):
            self._line("start, count, i0, j0 = index(p[k]), index(p[k + 1]), index(p[k + 2]), index(p[k + 3])")
            yield

    @contextmanager
    def _run(self, block: Block) -> Iterator[tuple[str, str, str]]:
        with self._block("for along in range(count)"):
            self._line("s, i = start + along, i0 + along")
            if block.joins_masses:
                # If the difference is a constant, the compiler can prove that consecutive links share no mass.
                self._line(f"j = i + {block.group.difference}" if block.group.difference else "j = j0 + along")
            yield "s", "i", "j"

    def _constants(self, blocks: Iterable[Block], *functions: str) -> None:
        """Read common parameters before the loop: the compiler cannot prove that a and p do not alias."""
        for block in blocks:
            for law in block.laws:
                self._line(*law.constants(*functions))
            if block.anchor and block.anchor.is_uniform:
                for k, axis in enumerate(self._axes):
                    if block.anchor.component(k, "") != "0.0":
                        self._line(f"{axis}_anchor = {block.anchor.component(k, '')}")

    @contextmanager
    def _linked(self, head: str, links: Iterable[Block]) -> Iterator[None]:
        """Write a function that starts with the supports of these links which move together."""
        with self._function(head):
            for number in sorted({number for block in links for number in block.group.motions}):
                motion = self._motions[number]
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


def _acting(blocks: list[Block], forces: tuple[str, ...]) -> list[Block]:
    """Return the blocks with only those of their laws that are forces."""
    acting = [replace(block, laws=block.having(*forces)) for block in blocks]
    return [block for block in acting if block.laws]


def _holds_end(block: Block, row: Block) -> bool:
    """Whether the block is one link from a support to an end of the row."""
    first = row.runs[0, 2]
    return block.anchor is not None and block.size == 1 and block.group.first[0] in (first, first + row.size)


def _sum(terms: list[str]) -> str:
    """A sum, in parentheses if needed in a product."""
    total = " + ".join(terms)
    return f"({total})" if len(terms) > 1 or " - " in total else total
