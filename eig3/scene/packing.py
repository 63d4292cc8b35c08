"""Pack the parameters of a scene into one array p, and give names to the parameters and functions in its source."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..kernels import bodies, constraints, grains, neighbours
from ..kernels.shared_forces import add_forces, advance_springs, set_forces
from ..kernels.team import out_of_line
from .assembly import EVENT, STATE, Assembly, Cloud, Group, Law, Mesh
from .effect import arguments
from .grain_contact import Rough
from .names import identifier, words
from .swarm import Listing, Swarm, listed

_CONTACTS = {2: 4, 3: 8}  # of a grain, by the dimension: hard ones have 3 and 6
if TYPE_CHECKING:
    from .constraint_set import ConstraintSet
    from .constraint_table import Packed

#: Near points, and cells, from which on threads share their forces. Links alone are not shared: to compute the force of
#: one takes less time than another core needs to get its ends, which the thread of the run has just moved.
_SHARED, _SHARED_CELLS = 2000, 5000

#: Rows of constraints (and points of bodies), and degrees of freedom, up to which straight lines are written for them:
#: with more, to compile these takes longer than most ensembles.
_FEW, _FEW_DEGREES = 8, 24


@dataclass(frozen=True)
class Column:
    """The place of a parameter in p.

    p contains one value if all members have the same value, and otherwise one value for each member; for a vector, this
    holds for each component. A component that is 0 in all members is written as 0.0 in the source, so that the compiler
    removes it. This is not done if all components of an effect's vector are 0, because the code of an effect must not
    depend on its parameters.
    """

    offset: int
    members: int
    zero: tuple[bool, ...] | None = None  # for each component of a vector, whether it is 0; None for numbers

    @property
    def is_uniform(self) -> bool:
        return self.members == 1

    def of(self, member: str) -> str:
        """Return the source of a member's number or tuple."""
        if self.zero is None:
            return self._entry(0, member)
        return f"({', '.join(self.component(k, member) for k in range(len(self.zero)))},)"

    def component(self, k: int, member: str) -> str:
        """Return the source of one component of a member's vector."""
        return "0.0" if self.zero and self.zero[k] else self._entry(k, member)

    def _entry(self, k: int, member: str) -> str:
        offset = self.offset + k * self.members
        if self.is_uniform:
            return f"p[{offset}]"
        return entry("p", offset, member)


@dataclass(frozen=True)
class Array:
    """The place of an array in p."""

    offset: int
    size: int
    is_uniform = True

    def of(self, member: str) -> str:
        return f"p[{self.offset}:{self.offset + self.size}]"


@dataclass(frozen=True)
class Arrays:
    """The places of the arrays of several members in p. Their starts and ends are also stored in p."""

    starts: Column
    ends: Column
    is_uniform = False

    def of(self, member: str) -> str:
        return f"p[index({self.starts.of(member)}) : index({self.ends.of(member)})]"


@dataclass(frozen=True)
class State:
    """The place of a state in u. Its number among the states is in p."""

    first: int
    number: Column
    is_uniform = False

    def of(self, member: str) -> str:
        return entry("u", self.first, f"index({self.number.of(member)})")


def entry(array: str, offset: int, index: str) -> str:
    """Return the source of array[offset + index]."""
    if index.isdecimal():
        return f"{array}[{offset + int(index)}]"
    return f"{array}[{offset} + {index}]" if offset else f"{array}[{index}]"


@dataclass(frozen=True, eq=False)
class Symbols:
    """A law in the source: its functions and its parameters.

    Attributes
    ----------
    functions : dict of str to jitted function
    columns : dict of str to Column, Array, Arrays or State
    members : int
        The number of motions that the law stands for; 1 for other effects.
    names : dict of str to str
        Names in the source of functions, of parameters with one value for all members, and, as "=force", of results.
    cutoff : str
        The parameter that is the cutoff, or empty.
    crossing : int
        That of the effect.
    events : ndarray of int
        The number of each member's event; empty for an effect without an event.
    """

    functions: dict[str, Any]
    columns: dict[str, Column | Array | Arrays | State]
    members: int
    names: dict[str, str]
    cutoff: str
    crossing: int
    events: np.ndarray

    def reads(self, name: str, *functions: str) -> bool:
        """Return whether one of these functions has an argument of this name."""
        return any(name in arguments(self.functions[f]) for f in functions if f in self.functions)

    def constants(self, *functions: str) -> Iterator[str]:
        """Return assignments of those parameters of these functions that have one value for all members."""
        for name, column in self.columns.items():
            if column.is_uniform and (name == self.cutoff or self.reads(name, *functions)):
                yield f"{self.names[name]} = {column.of('')}"

    def call(self, function: str, member: str, offered: dict[str, str]) -> str:
        """Return the source of a call for one member; `offered` has the source of arguments that are not parameters."""
        needed = arguments(self.functions[function])
        values = (self.value(name, member) if name in self.columns else offered[name] for name in needed)
        return f"{self.names[function]}({', '.join(values)})"

    def value(self, name: str, member: str) -> str:
        """Return the source of one member's parameter."""
        column = self.columns[name]
        return self.names[name] if column.is_uniform else column.of(member)


@dataclass(frozen=True, eq=False)
class Block:
    """A group in the source: its laws, its fixed ends and their motions, and the runs of its indices."""

    group: Group
    laws: list[Symbols]
    anchor: Column | None
    moved: list[Column | None]  # which member of each motion moves the fixed ends; None for a motion with one member
    runs: np.ndarray
    table: int  # the place of the runs, or of all indices, in p; unused if there is one run
    ends: list[Column]  # the indices of the masses of each member, for the events; empty without events

    @property
    def size(self) -> int:
        return self.group.first.size

    @property
    def joins_masses(self) -> bool:
        return self.group.second is not None

    @property
    def is_link(self) -> bool:
        return self.joins_masses or self.anchor is not None

    @property
    def is_row(self) -> bool:
        """Whether every link joins masses with consecutive indices."""
        return self.group.difference == 1

    def having(self, *functions: str) -> list[Symbols]:
        """Return the laws that have one of these functions."""
        return [law for law in self.laws if any(f in law.functions for f in functions)]

    def reads(self, name: str, *functions: str) -> bool:
        """Return whether one of these functions of a law has an argument of this name."""
        return any(law.reads(name, *functions) for law in self.laws)


@dataclass(frozen=True, eq=False)
class MeshBlock:
    """Cells of one kind in the source: their law, and the table of their corners in p.

    Attributes
    ----------
    mesh : Mesh
    law : Symbols
    table : int
        The place of the first corners of all cells in p; the second corners follow, and so on.
    """

    mesh: Mesh
    law: Symbols
    table: int

    @property
    def size(self) -> int:
        return self.mesh.corners.shape[1]


@dataclass(frozen=True, eq=False)
class SwarmBlock:
    """A link between near points in the source: its law with the fields that all pairs share, and its list."""

    law: Symbols
    listing: Listing


@dataclass(frozen=True, eq=False)
class GrainsBlock(SwarmBlock):
    """Contacts with friction in the source, with the tables of their springs, for which there is `room`."""

    place: int
    table: grains.Table
    room: int
    has_groups: bool


@dataclass(frozen=True, eq=False)
class SupportTable:
    """The fixed points of cells in p: their positions, and laws of motion with 1 + the member for each point, or 0."""

    positions: Column
    moved: list[tuple[int, Column]]


@dataclass(frozen=True, eq=False)
class HeldBlock:
    """The constraints in the source.

    Attributes
    ----------
    place : int
        Of their table in p.
    order : int
        The place in p of the number of each row, in the order in which they were added, among those of the table.
    own : list of (Symbols, int, int)
        The laws with functions of their own, the first of their rows, and the number of their members.
    packed : Packed
        The table.
    is_few : bool
        Whether there are so few that they are also written as straight lines, which run in lanes.
    """

    held: ConstraintSet
    place: int
    order: int
    own: list[tuple[Symbols, int, int]]
    packed: Packed
    is_few: bool


@dataclass(frozen=True)
class CarriedBlock:
    """The points that bodies carry in the source: the places in p of their table, and of arrays for all points.

    Attributes
    ----------
    count, size, degrees : int
        The number of carried points, of masses that carry them, and of degrees of freedom of all points at most.
    carriers : list of list of int
        The masses that carry each point.
    """

    begins: int
    parts: int
    factors: int
    weights: int
    scratch: int
    count: int
    size: int
    degrees: int
    carriers: list[list[int]]


class Packing:
    """The parameters and functions of a scene, and the blocks that refer to them.

    Attributes
    ----------
    functions : dict of str to jitted function
        By their names in the source.
    weight : Column
        Inverse masses.
    motions : list of Symbols
    bodies, links : list of Block
    meshes : list of MeshBlock
    supports : SupportTable or None
        None if no cell has a fixed point.
    swarms : list of SwarmBlock
    grains : list of GrainsBlock
    held : HeldBlock or None
        None if the scene has no constraints.
    carried : CarriedBlock or None
        None if no body carries points.
    plates : (int, list of list of int)
        For bodies with hardly any thickness, a place in p, and the vectors of each as masses, the one across it last. p
        has the first vectors of all of them there, then the second and the third ones, and then the mass of the third
        as a part of that of the first, and of the second.
    turn : Column or None
        Inverse inertias, 0 for masses that do not spin; None if none does.
    box : dict of str to int
        The places of the sides of the periodic box, by the axes that have one.
    shear : int or None
        The place of the rate at which it shears; None if it does not.
    team : int or None
        The place of the team of threads that share the forces between near points; None if no number of threads is
        given, or the scene is small.
    shares_cells : bool
        Whether the threads also share all other forces, because the scene has many cells.
    """

    def __init__(self, assembly: Assembly, threads: int | None) -> None:
        self._parts: list[np.ndarray] = []
        self._wanted: list[str] = []  # names, by the numbers that stand for them until the source is written
        self.functions: dict[str, Any] = {}
        self._first_state = assembly.coordinates
        self.weight = self._column(1 / assembly.cloud.in_order(assembly.cloud.masses))
        self.motions = [self._symbols(law) for law in assembly.motions]
        self.bodies = [self._block(group) for group in assembly.bodies]
        self.links = [self._block(group) for group in assembly.links]
        self.meshes = [MeshBlock(mesh, self._symbols(mesh.law), self._add(mesh.corners)) for mesh in assembly.meshes]
        self.supports = None
        if assembly.supports.positions.size:
            positions = self._column(assembly.supports.positions, is_place=True)
            moved = [(law, self._column(members)) for law, members in assembly.supports.moved]
            self.supports = SupportTable(positions, moved)
        self.box = {axis: self._add(side) for axis, side in zip("xyz", assembly.cloud.box, strict=False) if side > 0}
        self.shear = self._add(np.array(assembly.cloud.shear)) if assembly.cloud.shear else None
        self.swarms = [self._swarm(assembly, x) for x in assembly.swarms if not isinstance(x.effect, Rough)]
        self.grains = [self._grains(assembly, x) for x in assembly.swarms if isinstance(x.effect, Rough)]
        self.turn = self._column(inverse(assembly.cloud.in_order(assembly.cloud.inertia))) if assembly.angles else None
        self._is_few = assembly.held is not None and _is_few(assembly, assembly.held)
        self.carried = self._carried(assembly) if assembly.n > assembly.own else None
        self.plates = self._plates(assembly.cloud)
        self.held = self._held(assembly, assembly.held) if assembly.held else None
        self.shares_cells = threads is not None and sum(block.size for block in self.meshes) >= _SHARED_CELLS
        near = [*self.swarms, *self.grains]
        is_large = threads is not None and any(block.listing.masses >= _SHARED for block in near)
        self.team = self._add(np.array([0, 0, threads])) if is_large or self.shares_cells else None
        if near:
            views = {"memory": neighbours.memory, "floats": neighbours.floats, "integers": neighbours.integers}
            views["batch"] = neighbours.batch
            tasks = {name: getattr(neighbours, name) for name in ("REFRESH", "SCAN", "BUILD", "REACH")}
            self.functions |= {"lists": neighbours.LISTS[assembly.dimension], **tasks, **views}
        if self.grains:
            self.functions |= {**grains.FUNCTIONS, "bounds": neighbours.bounds, "out_of_line": out_of_line}
        if self.team is not None:
            shared = {"set_forces": set_forces, "add_forces": add_forces, "advance_springs": advance_springs}
            self.functions |= {**shared, "memory": neighbours.memory}
            self.functions |= {"bounds": neighbours.bounds, "out_of_line": out_of_line}

    def _swarm(self, assembly: Assembly, swarm: Swarm) -> SwarmBlock:
        law = self._symbols(Law(swarm.effect, {n: c for n, c in swarm.columns.items() if len(c) == 1}))
        pairs = assembly.joined if swarm.leaves_joined else assembly.joined[:0]
        u0 = assembly.cloud.in_order(assembly.cloud.positions).T.ravel()
        listing = listed(swarm, sum(part.size for part in self._parts), assembly.cloud, u0, pairs)
        self._add(listing.values)
        return SwarmBlock(law, listing)

    def _carried(self, assembly: Assembly) -> CarriedBlock:
        cloud, carried = assembly.cloud, assembly.cloud.bodies.carried
        points = [carried[point] for point in sorted(carried)]
        if not self._is_few:  # where the points are in the source, it must not depend on their places
            points = [(parts[factors != 0], factors[factors != 0]) for parts, factors in points]
        sizes, degrees = [len(parts) for parts, _ in points], assembly.degrees + 1
        parts = np.concatenate([cloud.free[parts] for parts, _ in points])
        factors = np.concatenate([factors for _, factors in points])
        self.functions |= {"memory": neighbours.memory, "floats": neighbours.floats, "integers": neighbours.integers}
        self.functions |= {"spread": bodies.spread, "gather": bodies.gather, "change": bodies.change}
        return CarriedBlock(
            self._add(neighbours.as_floats(np.concatenate([[0], np.cumsum(sizes)]))),
            self._add(neighbours.as_floats(parts)),
            self._add(factors),
            self._add(1 / cloud.masses[cloud.is_own]),
            self._add(np.zeros(3 * degrees)),
            len(points),
            len(parts),
            degrees,
            [cloud.free[parts].tolist() for parts, _ in points],
        )

    def _plates(self, cloud: Cloud) -> tuple[int, list[list[int]]]:
        vectors = np.array(cloud.bodies.plates, dtype=np.int64).reshape(-1, 3)
        masses, numbers = cloud.masses[vectors].T, cloud.free[vectors]
        return self._add(np.concatenate([numbers.T, masses[2] / masses[:2]])), numbers.tolist()

    def _held(self, assembly: Assembly, held: ConstraintSet) -> HeldBlock:
        place = sum(part.size for part in self._parts)
        packed = held.table.packed(place)
        self._add(packed.values)
        own = [(self._symbols(Law(x.effect, x.columns)), int(x.rows[0]), len(x.rows)) for x in held.kinds]
        self.functions |= {"memory": neighbours.memory, "areas": constraints.areas}
        tasks = "STAND", "CONSTRAIN", "REACT", "PROJECT", "LEAP"
        self.functions |= {name: getattr(constraints, name) for name in (*tasks, "strike")}
        self.functions["hold"] = constraints.LIBRARY[held.table.dimension]
        if own:
            self.functions |= {name: getattr(constraints, name) for name in ("own_address", "PLACE", "sum_up")}
        if self._is_few:
            self.functions |= {"batch": neighbours.batch, "nan": math.nan, "inf": math.inf}
        return HeldBlock(held, place, self._add(np.argsort(packed.order)), own, packed, self._is_few)

    def _grains(self, assembly: Assembly, swarm: Swarm) -> GrainsBlock:
        block = self._swarm(assembly, swarm)
        room = block.listing.points * max(_CONTACTS[assembly.dimension], swarm.room or 0) + 64
        table = grains.Table.of(block.listing.masses, room)
        place = self._add(np.zeros(grains.HEAD + 2 * table.size))
        return GrainsBlock(block.law, block.listing, place, table, room, swarm.second.size > 0)

    @property
    def params(self) -> np.ndarray:
        """The array p."""
        return np.concatenate(self._parts)

    def _add(self, values: np.ndarray) -> int:
        """Append to p; return where."""
        offset = sum(part.size for part in self._parts)
        self._parts.append(np.ravel(values).astype(np.float64))
        return offset

    def _column(self, values: np.ndarray, is_place: bool = False) -> Column:
        if (values == values[0]).all():
            values = values[:1]
        zero = None
        if values.ndim == 2:
            is_zero = (values == 0).all(axis=0)
            zero = tuple((is_zero & (is_place or not is_zero.all())).tolist())
        return Column(self._add(values.T), len(values), zero)

    def _symbols(self, law: Law) -> Symbols:
        effect, functions = law.effect, law.effect.functions()
        columns: dict[str, Any] = {
            name: self._array(values) if name in effect.arrays else self._column(values)
            for name, values in law.columns.items()
            if name != EVENT
        }
        if STATE in columns:
            columns[STATE] = State(self._first_state, columns[STATE])
        members = len(law.columns["direction"]) if "direction" in law.columns else 1
        stem = words(effect.title).replace(" ", "_")
        names = {name: self._name(f"{stem}_{name}") for name in (*functions, *columns)}
        names |= {f"={function}": self._name(f"{stem}_{function[0]}") for function in functions}
        self.functions.update({names[name]: function for name, function in functions.items()})
        events = law.columns.get(EVENT, np.empty(0, dtype=np.int64))
        return Symbols(functions, columns, members, names, effect.cutoff, effect.crossing, events)

    def _array(self, values: np.ndarray | list[np.ndarray]) -> Array | Arrays:
        if not isinstance(values, list):
            return Array(self._add(values), values.size)
        starts = np.array([self._add(array) for array in values])
        ends = starts + [array.size for array in values]
        return Arrays(self._column(starts), self._column(ends))

    def _name(self, wanted: str) -> str:
        """Return what stands for a name in the source until `named` puts one there that is like `wanted`."""
        self._wanted.append(wanted)
        return f"${len(self._wanted) - 1}"

    def named(self, source: str) -> tuple[str, dict[str, Any]]:
        """Return the source with names that are nowhere else in it, and its functions by their names."""
        taken, names = {*re.findall(r"\w+", source), *self.functions}, dict[str, str]()
        for number, wanted in enumerate(self._wanted):
            names[f"${number}"] = identifier(wanted, taken)
            taken.add(names[f"${number}"])
        functions = {names.get(name, name): function for name, function in self.functions.items()}
        return re.sub(r"\$\d+", lambda found: names[found[0]], source), functions

    def _block(self, group: Group) -> Block:
        laws = [self._symbols(law) for law in group.laws]
        anchor = None if group.anchor is None else self._column(group.anchor, is_place=True)
        moves = () if group.moved is None else zip(group.motions, group.moved.T, strict=True)
        moved = [self._column(column) if self.motions[number].members > 1 else None for number, column in moves]
        runs = group.runs
        table = (
            runs if group.in_runs else np.concatenate([group.first, *([] if group.second is None else [group.second])])
        )
        place = self._add(table) if len(runs) > 1 else 0
        has_events = any(law.events.size for law in laws)
        ends = [self._column(x) for x in (group.first, group.second) if has_events and x is not None]
        return Block(group, laws, anchor, moved, runs, place, ends)


def _is_few(assembly: Assembly, held: ConstraintSet) -> bool:
    """Return whether the constraints of a scene are few."""
    if held.kinds or assembly.swarms:
        return False
    is_small = assembly.size <= _FEW_DEGREES and assembly.n - assembly.own <= _FEW
    return len(held.names) <= _FEW and is_small


def inverse(values: np.ndarray) -> np.ndarray:
    """Return the inverses of numbers, and 0 for 0."""
    return np.divide(1.0, values, out=np.zeros_like(values), where=values > 0)
