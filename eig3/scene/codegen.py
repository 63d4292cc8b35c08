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
from ..functions.companions import Constraints, History
from ..functions.events import Event
from ..functions.families import Family
from ..kernels.compile.numba_internals import WITHOUT_C_WRAPPER
from ..kernels.compile.source import define
from ..kernels.constraint_lanes import Straight
from ..kernels.protocol import index
from ..kernels.shared_forces import OWN
from ..stepping.team import Shares
from .assembly import STATE, Assembly
from .bodies_text import BodiesText
from .box_text import BoxText
from .constraint_text import ConstraintText
from .effect import FORCES, RESETS
from .grains_text import GrainsText
from .lines import of_part, only_if
from .mesh_text import MeshText
from .packing import Block, Column, Packing, Symbols, entry
from .swarm_text import SwarmText

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
    packing = Packing(assembly, threads)
    source = _Source(assembly, packing)
    source.parts()
    if assembly.follows_work:
        source.power()
    source.rhs()
    if assembly.follows_work or assembly.is_conservative:
        source.energy()
    if packing.grains:
        source.history()
    source.events()
    functions = _functions(str(source), tuple(packing.functions.items()))
    if packing.team is not None:
        functions["rhs"].py_func.shares = Shares(functions["share"], packing.team, assembly.n)
    if packing.held:
        keeping = functions["projection"], functions["constrained_step"]
        functions["rhs"].py_func.constraints = Constraints(*keeping, source.straight(functions))
    if packing.grains:
        functions["rhs"].py_func.history = History(functions["begin"], functions["advance"])
    found: dict[str, Event] = {}
    for occasion in source.occasions:
        found |= occasion.events(functions, assembly.events)
    events = {name: found[name] for name in assembly.events}  # in the order in which the effects were added
    outputs = {"reactions": (functions["reactions"], len(assembly.held.names))} if assembly.held else {}
    return Compiled(functions["rhs"], functions.get("energy"), events, outputs, packing.params)


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


class _Source:
    """Writes the functions of one scene.

    Attributes
    ----------
    occasions : list of _Occasion
    """

    def __init__(self, assembly: Assembly, packing: Packing) -> None:
        self._n = assembly.n
        self._axes = "xyz"[: assembly.dimension]
        self._follows_work = assembly.follows_work
        self._coordinates = assembly.coordinates
        self._work = assembly.degrees  # the index of the degree of freedom whose velocity is the work
        self._weight = packing.weight
        self._motions, self._blocks = packing.motions, packing.bodies + packing.links
        self._bodies = _acting(packing.bodies, _BODY)
        self._links = _acting(packing.links, _LINK)
        self._meshes, self._swarms = MeshText(assembly, packing), SwarmText(assembly, packing, packing.swarms)
        self._grains, self._constraints = GrainsText(assembly, packing), ConstraintText(assembly, packing)
        self._bodies_text = BodiesText(assembly, packing, self._constraints)
        self._team, self._shares_cells = packing.team, packing.shares_cells
        self._has_stages = packing.team is not None or bool(packing.grains)
        self._rhs_name = f"forces{self._bodies_text.suffix}" if packing.held else "rhs"
        self._own_masses = assembly.own
        self._box = BoxText(packing)
        # on a line without end, a link has a sign: its ends may pass through each other
        self._is_signed = len(self._axes) == 1 and not packing.box
        self.occasions: list[_Occasion] = []
        self._lines: list[str] = []
        self._depth = 0
        self._in_part = False  # whether the function is that of a part of the masses

    def __str__(self) -> str:
        return "\n".join(self._lines) + "\n"

    # The functions

    def straight(self, functions: dict[str, Any]) -> Straight | None:
        """Return a few constraints as lines for lanes, and let the reactions find their own function for lanes."""
        text = self._constraints.straight
        if text is None:
            return None
        functions["reactions"].py_func.in_lanes = functions["reactions_in_lanes"]
        return text.straight(functions["forces"])

    def parts(self) -> None:
        """Write the functions that others call: the places of the corners of cells, and what threads share."""
        for head, lines in self._meshes.functions():
            with self._function(head, ()):
                self._write_all(lines)
        if self._has_stages:
            with self._function("share(stage, part, parts, t, u, v, p, a)", self._links):
                self._write("out_of_line()")
                if self._shares_cells:
                    with self._indented(f"if stage == {OWN}:"):
                        self._forces_on_part()
                self._write_all(self._swarms.stages())
                self._write_all(self._grains.stages())

    def rhs(self) -> None:
        """Write the function of the accelerations."""
        with self._function(f"{self._rhs_name}(t, u, v, p, a)", self._links):
            if self._shares_cells:
                velocity = "v" if self._reads_v else "u"  # a rhs that names v is one that reads it
                self._write(f"set_forces(share, t, memory(u), memory({velocity}), memory(p), memory(a), {self._team})")
            else:
                self._forces()
            self._write_all(self._swarms.forces())
            self._write_all(self._grains.forces())
            for k in range(self._coordinates, self._work):  # the states
                self._write(f"a[{k}] = 0.0")
            if self._follows_work:
                with self._indented(f"if a.size > {self._work}:"):  # a run that follows the work
                    self._write(f"a[{self._work}] = power(t, u, v, p)")
            if not self._suffix:
                self._write_all(self._bodies_text.plates())
        if self._suffix:
            with self._function("forces(t, u, v, p, a)", ()):
                self._write_all(self._bodies_text.forces())
                self._write_all(self._bodies_text.plates())
        for head, lines in self._constraints.functions():
            with self._function(head, ()):
                self._write_all(lines)

    def power(self) -> None:
        """Write the function of the power of the effects without a potential and of the supports."""
        with self._function("power(t, u, v, p)", self._links):
            self._write("total = 0.0")
            for block in self._some(self._bodies, has_potential=False):
                with self._members(block, *_BODY) as (s, i, _):
                    accelerations, forces = self._given(block, s, i, "power")
                    for factor, names in (("", forces), ("m * ", accelerations)):
                        for name in names:
                            product = " + ".join(f"{name}[{k}] * velocity[{k}]" for k in range(len(self._axes)))
                            self._write(f"total += {factor}({product})")
            for block in self._some(self._links, has_potential=False):
                with self._near_members(block, *_LINK) as (s, i, j):
                    offered = self._length(block, s, i, j, *_LINK, "power")
                    tensions = [law.call("tension", s, offered) for law in block.having("tension")]
                    tensions += [
                        f"{law.call('density', s, offered)} * {offered['r']}" for law in block.having("density")
                    ]
                    self._write(f"total -= {_sum(tensions)} * {offered['rate']}")
            for block in (block for block in self._links if block.group.motions):
                with self._near_members(block, *_LINK) as (s, i, j):
                    self._pull(block, s, i, j)
                    for axis in self._axes:
                        self._write(f"total -= f{axis} * {self._support('v', block, axis, s)}")
            for block in self._links if self._box.shears else []:
                with self._near_members(block, *_LINK) as (s, i, j):
                    self._pull(block, s, i, j)
                    self._write_all(self._box.power())
            self._write_all(self._meshes.power())
            self._write_all(self._swarms.power())
            self._write_all(self._grains.power())
            self._write("return total")

    def energy(self) -> None:
        """Write the function of the kinetic energy and the potentials, less the work in a run that follows it."""
        with self._function(f"energy{self._suffix}(t, u, v, p)", self._links):
            self._write("total = 0.0")
            if self._follows_work:
                with self._indented(f"if v.size > {self._work}:"):
                    self._write(f"total -= v[{self._work}]")
            with self._masses(0, self._own_masses) as i:
                speeds = [self._at("v", axis, i) for axis in self._axes]
                self._write(f"total += {_sum([f'{v} * {v}' for v in speeds])} / (2 * {self._w(i)})")
            for block in self._some(self._bodies, has_potential=True):
                with self._members(block, "potential") as (s, i, _):
                    self._potentials(block, s, self._mass(block, i, "potential"))
            for block in self._some(self._links, has_potential=True):
                with self._near_members(block, "potential") as (s, i, j):
                    self._potentials(block, s, self._length(block, s, i, j, "potential"))
            self._write_all(self._meshes.potentials())
            self._write_all(self._swarms.potentials())
            self._write_all(self._grains.energy())
            self._write("return total")
        if self._suffix:
            with self._function("energy(t, u, v, p)", ()):
                self._write_all(self._bodies_text.value("energy_of_all(t, everywhere, speeds, p)"))

    def history(self) -> None:
        """Write the functions of the springs between grains."""
        for name, lines in (("advance", self._grains.advance()), ("begin", self._grains.begin())):
            with self._function(f"{name}(t, u, v, p)", ()):
                self._write_all(lines)
                self._write("return 0.0")

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
                self.occasions.append(_Occasion(law.events, law.crossing, g, apply))

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
        self._write_all(self._meshes.forces())

    def _forces_on_part(self) -> None:
        """Do so for the masses of a part. A force on masses of two parts is computed in both."""
        self._in_part, begin = True, len(self._lines)
        on_all, others = self._bodies_by_extent()
        self._write(f"low, end = bounds({self._n}, part, parts)")
        self._constants(on_all, *_BODY)
        with self._indented("for i in range(low, end):"):
            self._set(on_all, "i")
        for block in others:
            self._some_masses(block)
        for block in self._links:
            self._pairs(block)
        self._write_all(self._meshes.forces_on_part())
        self._in_part, self._reads_v = False, any(re.search(r"\bv\b", line) for line in self._lines[begin:])

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
            with self._indented(f"for s in range({row.size}):"):
                self._write(f"i, j = {start} + s, {start + 1} + s")
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
            for axis in self._axes:
                self._write(f"{axis}_before += f{axis}")

    def _set(self, on_all: list[Block], i: str, pull: Callable[[str], str] | None = None) -> None:
        accelerations: list[str] = []
        forces: list[str] = []
        for block in on_all:
            given = self._given(block, i, i)
            accelerations += given[0]
            forces += given[1]
        for axis in self._axes:
            pulls = [pull(axis)] if pull else []
            self._write(f"{self._at('a', axis, i)} = {self._along(axis, i, accelerations, forces, pulls)}")

    def _bodies_by_extent(self) -> tuple[list[Block], list[Block]]:
        """Return the effects on all masses, and those on some."""
        on_all = [block for block in self._bodies if block.size == self._n and len(block.runs) == 1]
        return on_all, [block for block in self._bodies if block not in on_all]

    def _some_masses(self, block: Block) -> None:
        with self._members(block, *_BODY) as (s, i, _):
            accelerations, forces = self._given(block, s, i)
            for axis in self._axes:
                self._write(f"{self._at('a', axis, i)} += {self._along(axis, i, accelerations, forces)}")

    def _pairs(self, block: Block) -> None:
        with self._near_members(block, *_LINK) as (s, i, j):
            self._pull(block, s, i, j, self._common)
            for sign, end in [("+=", i), ("-=", j)] if block.joins_masses else [("-=", i)]:
                lines = [f"{self._at('a', axis, end)} {sign} f{axis}{self._own(end)}" for axis in self._axes]
                self._write_all(only_if(of_part(end) if self._in_part else "", lines))

    def _rows(self, block: Block) -> None:
        self._constants([block], *_LINK)
        with self._runs(block):
            self._before()
            with self._run(block) as (s, i, j):
                self._separation(block, s, i, j)
                self._pull(block, s, i, j, self._common)
                for axis in self._axes:
                    self._write(f"{self._at('a', axis, i)} += (f{axis} - {axis}_before){self._own(i)}")
                self._keep()
            self._write("i = i0 + count")
            for axis in self._axes:
                self._write(f"{self._at('a', axis, 'i')} -= {axis}_before{self._own('i')}")

    def _before(self) -> None:
        self._write(f"{' = '.join(f'{axis}_before' for axis in self._axes)} = 0.0")

    def _keep(self) -> None:
        for axis in self._axes:
            self._write(f"{axis}_before = f{axis}")

    def _event(self, block: Block, name: str) -> None:
        """Write the function whose zeros are the events of an effect on a block."""
        with self._of_member(name + self._suffix, block) as (s, i, j):
            offered = self._offered(block, s, i, j, "event")
            self._write(f"return float({block.laws[0].call('event', s, offered)})")
        if self._suffix:
            with self._function(f"{name}(member, t, u, v, p)", ()):
                self._write_all(self._bodies_text.value(f"{name}_of_all(member, t, everywhere, speeds, p)"))

    def _reset(self, block: Block, name: str) -> None:
        """Write the function that changes the state at the events of an effect on a block.

        In a run that follows the work, the change of the energy is added to the work.
        """
        law = block.laws[0]
        with self._of_member(name + self._suffix, block) as (s, i, j):
            follows_work = self._follows_work and not self._suffix
            if follows_work:
                self._write("before = energy(t, u, v, p)")
            offered = self._offered(block, s, i, j, *RESETS)
            if "state_after" in law.functions:
                self._write(f"state = {law.call('state_after', s, offered)}")
            changes_velocity = law.functions.keys() & {"velocity_after", "rate_after"}
            takes_part = changes_velocity and not self._suffix
            self._write_all(self._constraints.before_impulse() if takes_part else ())
            if "velocity_after" in law.functions:
                self._write(f"after = {law.call('velocity_after', s, offered)}")
                for k, axis in enumerate(self._axes):
                    self._write(f"{self._at('v', axis, i)} = after[{k}]")
            if "rate_after" in law.functions:
                self._write(f"change = {law.call('rate_after', s, offered)} - {offered['rate']}")
                self._strike(block, i, j)
            self._write_all(self._constraints.after_impulse() if takes_part else ())
            if "state_after" in law.functions:
                self._write(f"{law.columns[STATE].of(s)} = state")
            if follows_work:
                with self._indented(f"if v.size > {self._work}:"):
                    self._write(f"v[{self._work}] += energy(t, u, v, p) - before")

        if self._suffix:
            with self._function(f"{name}(member, t, u, v, p)", ()):
                self._write_all(self._bodies_text.reset(f"{name}_of_all(member, t, everywhere, speeds, p)"))

    @property
    def _suffix(self) -> str:
        return self._bodies_text.suffix

    @contextmanager
    def _of_member(self, name: str, block: Block) -> Iterator[tuple[str, str, str]]:
        """Write a function for one member of a block; give the names of the indices of the member and its masses."""
        with self._function(f"{name}(member, t, u, v, p)", [block]):
            self._write("s = index(member)")
            for letter, end in zip("ij", block.ends, strict=False):
                self._write(f"{letter} = index({end.of('s')})")
            yield "s", "i", "j"

    def _strike(self, block: Block, i: str, j: str) -> None:
        """Change the rate of a link by opposite impulses on its ends, or by one on the mass of a link to a support."""
        ends = [("+=", i, "change")]
        if block.joins_masses:
            self._write(f"impulse = change / ({self._w(i)} + {self._w(j)})")
            ends = [("-=", i, f"impulse * {self._w(i)}"), ("+=", j, f"impulse * {self._w(j)}")]
        for axis in self._axes:
            along = f" * d{axis} * inverse" if not self._is_signed else " * -1" * (block.group.sign < 0)
            for sign, end, kick in ends:
                self._write(f"{self._at('v', axis, end)} {sign} {kick}{along}")

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
                self._write(f"{found[-1]} = {law.call(function, s, offered)}")
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
            self._write(f"x = ({', '.join(self._at('u', axis, i) for axis in self._axes)},)")
        if block.reads("v", *functions) or "power" in functions:
            self._write(f"velocity = ({', '.join(self._at('v', axis, i) for axis in self._axes)},)")
        if block.reads("m", *functions) or ("power" in functions and block.having("acceleration")):
            self._write(f"m = 1 / {self._w(i)}")
        return {"t": "t", "x": "x", "v": "velocity", "m": "m"}

    def _separation(self, block: Block, s: str, i: str, j: str) -> None:
        """Compute the vector between the two ends of a link."""
        for motion, member, name in self._moving(block):
            if member:
                self._write(f"moved = index({member.of(s)})")
                self._motion(motion, "moved", name)
        for axis in self._axes:
            self._write(f"d{axis} = {self._difference('u', block, axis, s, i, j)}")
        self._write_all(self._box.nearest())

    def _length(self, block: Block, s: str, i: str, j: str, *functions: str) -> dict[str, str]:
        """Compute the values that these functions of a link's laws, and its pull, need; call `_separation` first."""
        strikes = "rate_after" in functions and bool(block.having("rate_after"))
        needs_rate = block.reads("rate", *functions) or strikes or "power" in functions
        needs_inverse = needs_rate or ("tension" in functions and bool(block.having("tension")))
        if needs_rate:
            for axis in self._axes:
                self._write(f"e{axis} = {self._difference('v', block, axis, s, i, j)}")
            self._write_all(self._box.rate())
        if self._is_signed:
            return {"t": "t", "r": "dx", "rate": "ex"}
        if needs_inverse or block.reads("r", *functions):
            self._write(f"r = sqrt(tiny + {self._square})")
        if needs_inverse:
            self._write("inverse = 1 / r")
        if needs_rate:
            self._write(f"rate = {_sum([f'd{axis} * e{axis}' for axis in self._axes])} * inverse")
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
            self._write(f"fx = {'-' if block.group.sign < 0 else ''}{pulls}{factor}")
            return
        if tensions:
            densities.append(f"{_sum(tensions)} * inverse")
        self._write(f"pull = {_sum(densities)}{factor}")
        for axis in self._axes:
            self._write(f"f{axis} = pull * d{axis}")

    def _potentials(self, block: Block, s: str, offered: dict[str, str]) -> None:
        for law in block.laws:
            self._write(f"total += {law.call('potential', s, offered)}")

    def _some(self, blocks: list[Block], *, has_potential: bool) -> Iterator[Block]:
        """The blocks with only those of their laws that have a potential, or that have none."""
        for block in blocks:
            laws = [law for law in block.laws if ("potential" in law.functions) == has_potential]
            if laws:
                yield replace(block, laws=laws)

    # Masses and members

    def _at(self, array: str, axis: str, i: str) -> str:
        """A mass's entry in u, v or a."""
        return entry(array, self._n * self._axes.index(axis), i)

    def _w(self, i: str) -> str:
        return "w" if self._weight.is_uniform else self._weight.of(i)

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
            with self._indented(f"for i in range({first}, {stop}):"):
                yield "i"

    @contextmanager
    def _members(self, block: Block, *functions: str) -> Iterator[tuple[str, str, str]]:
        """Write a loop over a block; give the names of the indices of the member and of its masses.

        In the function of a part, it skips members without masses of the part.
        """
        with self._all_members(block, *functions) as (s, i, j):
            if not self._in_part:
                yield s, i, j
                return
            with self._indented(f"if {of_part(i, j) if block.joins_masses else of_part(i)}:"):
                yield s, i, j

    @contextmanager
    def _all_members(self, block: Block, *functions: str) -> Iterator[tuple[str, str, str]]:
        self._constants([block], *functions)
        _, count, i0, j0 = block.runs[0]
        if block.size == 1:
            yield "0", str(i0), str(j0)
        elif len(block.runs) == 1:
            with self._indented(f"for s in range({count}):"):
                self._write(f"i, j = {i0} + s, {j0} + s" if block.joins_masses else f"i = {i0} + s")
                yield "s", "i", "j"
        elif block.group.in_runs:
            with self._runs(block), self._run(block) as indices:
                yield indices
        else:
            with self._indented(f"for s in range({block.size}):"):
                self._write(f"i = index(p[{block.table} + s])")
                if block.joins_masses:
                    self._write(f"j = index(p[{block.table + block.size} + s])")
                yield "s", "i", "j"

    @contextmanager
    def _near_members(self, block: Block, *functions: str) -> Iterator[tuple[str, str, str]]:
        """Write a loop over links that computes their separation and skips links beyond the cutoffs of all their laws.

        It compares squares and thus needs no square root. A link with a sign has no square root to avoid.
        """
        with self._members(block, *functions) as (s, i, j):
            self._separation(block, s, i, j)
            cutoffs = [law.value(law.cutoff, s) for law in block.laws if law.cutoff]
            if self._is_signed or len(cutoffs) < len(block.laws):
                yield s, i, j
                return
            near = " or ".join(f"square < {cutoff} * {cutoff}" for cutoff in cutoffs)
            self._write(f"square = {self._square}")
            with self._indented(f"if {near}:"):
                yield s, i, j

    @contextmanager
    def _runs(self, block: Block) -> Iterator[None]:
        with self._indented(f"for k in range({block.table}, {block.table + block.runs.size}, 4):"):
            self._write("start, count, i0, j0 = index(p[k]), index(p[k + 1]), index(p[k + 2]), index(p[k + 3])")
            yield

    @contextmanager
    def _run(self, block: Block) -> Iterator[tuple[str, str, str]]:
        with self._indented("for along in range(count):"):
            self._write("s, i = start + along, i0 + along")
            if block.joins_masses:
                # If the difference is a constant, the compiler can prove that consecutive links share no mass.
                self._write(f"j = i + {block.group.difference}" if block.group.difference else "j = j0 + along")
            yield "s", "i", "j"

    def _constants(self, blocks: Iterable[Block], *functions: str) -> None:
        """Read common parameters before the loop: the compiler cannot prove that a and p do not alias."""
        for block in blocks:
            for law in block.laws:
                for line in law.constants(*functions):
                    self._write(line)
            if block.anchor and block.anchor.is_uniform:
                for k, axis in enumerate(self._axes):
                    if block.anchor.component(k, "") != "0.0":
                        self._write(f"{axis}_anchor = {block.anchor.component(k, '')}")

    # Lines

    def _write(self, line: str) -> None:
        self._lines.append("    " * self._depth + line)

    def _write_all(self, lines: Iterable[str]) -> None:
        for line in lines:
            self._write(line)

    @contextmanager
    def _indented(self, head: str) -> Iterator[None]:
        self._write(head)
        self._depth += 1
        yield
        self._depth -= 1

    @contextmanager
    def _function(self, head: str, links: Iterable[Block]) -> Iterator[None]:
        """Write a function that starts with values for these links: the common inverse mass, and moved supports."""
        self._lines += [""] * bool(self._lines)
        self._write("@jit")
        with self._indented(f"def {head}:"):
            if self._weight.is_uniform:
                self._write(f"w = {self._weight.of('')}")
            self._write_all(self._box.constants())
            for number in sorted({number for block in links for number in block.group.motions}):
                motion = self._motions[number]
                for line in motion.constants("motion"):
                    self._write(line)
                if motion.members == 1:
                    self._motion(motion, "", number)
            yield

    def _motion(self, motion: Symbols, member: str, name: int) -> None:
        """Compute the displacement and velocity of one member of a motion; `name` is the number in their names."""
        self._write(f"shift, speed = {motion.call('motion', member, {'t': 't'})}")
        for axis in (axis for axis in self._axes if self._direction(motion, axis) != "0.0"):
            for value in ("shift", "speed"):
                self._write(f"{axis}_{value}_{name} = {value} * {self._direction(motion, axis, member)}")


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
