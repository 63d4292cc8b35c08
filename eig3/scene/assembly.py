"""Group the effects of a scene for the loops of its code.

Masses are numbered. Effects of one kind on the same sort of points become one group, and groups on exactly the same
points share a loop. Links along a row of masses are sorted to consecutive indices: their loop then needs no table of
indices, and the compiler can vectorise it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .bonds import bonds_of
from .cell import Cell
from .constraint import Constraint
from .effect import FORCES, RATE, Body, Effect, Link, Motion, arguments
from .names import words
from .pair_force import PairForce
from .placed import Placed, joined

if TYPE_CHECKING:
    from .constraint_system import ConstraintSystem

#: The columns with the number of each member's event and of its state, counted over the whole scene.
EVENT, STATE = "=event", "state"

_MANY = 16  # from this number on, links with the same index difference get a separate loop, unless there are more
_LOOPS = 5  # than this number of such differences (cloth with diagonals and bending springs has 5), not counting 1
_MOTIONS = 8  # up to this number, motions of one kind are computed once each; more are computed in the loops over links
_LEAST_RUN = 4  # from this mean length of runs of indices on, a loop over runs is used in place of a table of indices


class Bodies(NamedTuple):
    """The points of rigid bodies.

    Attributes
    ----------
    vectors : list of int
        The numbers of the points that represent vectors.
    carried : dict of int to (ndarray of int, ndarray)
        For each point of a body, the points and factors of which its position is a linear combination.
    plates : list of list of int
        The numbers of the vectors of each body with hardly any thickness; the last vector is normal to the plate.
    numbers : dict of int to int
        By the number of a centre or a vector: the number of its body, in the order in which the bodies were added.
    joints : dict of int to str
        For the first point of each constraint of a joint, the name of the joint, such as "revolute joint 0".
    shapes : dict of int to list of (str, ndarray, ndarray)
        For the centre of a body with given shapes, the kind of each shape, and the factors of the vectors that lead to
        its middle, and from there to a point on its surface along each axis, as rows.
    """

    vectors: list[int]
    carried: dict[int, tuple[np.ndarray, np.ndarray]]
    plates: list[list[int]]
    numbers: dict[int, int]
    joints: dict[int, str]
    shapes: dict[int, list[tuple[Any, np.ndarray, np.ndarray]]]

    @classmethod
    def none(cls) -> Bodies:
        return cls([], {}, [], {}, {}, {})

    def body_of(self, point: int) -> int | None:
        """Return the number of the body to which a point belongs, or None."""
        return self.numbers.get(self.carried[point][0][0] if point in self.carried else point)


@dataclass(frozen=True)
class Cloud:
    """All points of a scene.

    Attributes
    ----------
    masses : ndarray, shape (points,)
        kg; 0 for fixed points.
    positions, velocities : ndarray, shape (points, dimension)
    rest : ndarray, shape (points, dimension)
        The positions in which cells have their rest shape.
    box : ndarray, shape (dimension,)
        The sides of the periodic box, m; 0 along an axis that is not periodic.
    shear : float
        The rate at which the box shears, 1/s.
    inertia : ndarray, shape (points,)
        kg m^2; 0 for points that do not spin.
    spins : ndarray, shape (points, angles)
        The angular velocities; without angles if no point spins.
    bodies : Bodies
        The points of rigid bodies.
    """

    masses: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray
    rest: np.ndarray
    box: np.ndarray
    shear: float
    inertia: np.ndarray
    spins: np.ndarray
    bodies: Bodies

    @cached_property
    def is_carried(self) -> np.ndarray:
        """Whether each point is carried by a rigid body."""
        return np.isin(np.arange(self.masses.size), list(self.bodies.carried))

    @cached_property
    def is_own(self) -> np.ndarray:
        """Whether each point has coordinates in u: it is free, and no body carries it."""
        return (self.masses > 0) & ~self.is_carried

    @cached_property
    def is_massless(self) -> np.ndarray:
        """Whether each point belongs to a rigid body, but is not its centre."""
        return self.is_carried | np.isin(np.arange(self.masses.size), self.bodies.vectors)

    @cached_property
    def material(self) -> np.ndarray:
        """The numbers of the masses on which an effect on all masses acts: no vectors, and no points of bodies."""
        return np.flatnonzero((self.masses > 0) & ~self.is_massless)

    @cached_property
    def free(self) -> np.ndarray:
        """The index of each point among the masses; -1 for fixed points. Points that bodies carry are last."""
        own = np.cumsum(self.is_own) - 1
        carried = np.count_nonzero(self.is_own) + np.cumsum(self.is_carried) - 1
        return np.where(self.is_own, own, np.where(self.is_carried, carried, -1))

    def in_order(self, values: np.ndarray) -> np.ndarray:
        """Return values of points for the masses, in the order of their indices."""
        return np.concatenate([values[self.is_own], values[self.is_carried]])


@dataclass(frozen=True, eq=False)
class Group:
    """Laws on the same points.

    Attributes
    ----------
    laws : list of Placed
    first : ndarray of int, shape (members,)
        The masses acted on; for a link between two masses, the mass with the lower index.
    second : ndarray of int, shape (members,), or None
        The other mass of links between masses.
    anchor : ndarray, shape (members, dimension), or None
        The positions of the fixed ends of links.
    motions : tuple of int
        The indices in `Assembly.motions` of the laws that move these fixed ends.
    moved : ndarray of int, shape (members, number of motions)
        Which member of each of these laws moves the fixed end.
    sign : int
        For links in one dimension: 1 if at the start the coordinate increases from the first to the second end, or from
        the anchor to the mass, and -1 if it decreases.
    """

    laws: list[Placed]
    first: np.ndarray
    second: np.ndarray | None = None
    anchor: np.ndarray | None = None
    motions: tuple[int, ...] = ()
    moved: np.ndarray | None = None
    sign: int = 1

    @property
    def difference(self) -> int | None:
        """The difference of the two indices if it is the same in all links, otherwise None."""
        if self.second is None or np.ptp(self.second - self.first):
            return None
        return int(self.second[0] - self.first[0])

    @cached_property
    def runs(self) -> np.ndarray:
        """The runs in which indices grow by one: rows of (first member, number of members, first mass, second mass)."""
        second = self.first if self.second is None else self.second
        steps = (np.diff(self.first) == 1) & (np.diff(second) == 1)
        starts = np.concatenate([[0], np.flatnonzero(~steps) + 1])
        counts = np.diff([*starts, self.first.size])
        return np.column_stack([starts, counts, self.first[starts], second[starts]])

    @property
    def in_runs(self) -> bool:
        """Whether the runs are long enough on average for a loop over runs."""
        return self.first.size >= _LEAST_RUN * len(self.runs)

    def take(self, members: np.ndarray) -> Group:
        """Return the group of some members, or of all members in another order."""

        def part(values: np.ndarray | None) -> Any:
            return None if values is None else values[members]

        laws = [law.take(members) for law in self.laws]
        parts = {name: part(getattr(self, name)) for name in ("first", "second", "anchor", "moved")}
        return replace(self, laws=laws, **parts)


@dataclass(frozen=True, eq=False)
class Supports:
    """The fixed points of cells, and of pair forces if a motion moves one of them.

    Attributes
    ----------
    points : ndarray of int, shape (supports,)
        Their numbers in the scene.
    positions : ndarray, shape (supports, dimension)
    moved : list of (int, ndarray of int, shape (supports,))
        A law of motion, and 1 + the member of the law that moves each support, or 0.
    """

    points: np.ndarray
    positions: np.ndarray
    moved: list[tuple[int, np.ndarray]]

    def of_list(self, fixed: np.ndarray) -> np.ndarray:
        """Return which supports the fixed points of a list are; none if none of them moves."""
        is_moved = any(np.isin(fixed, self.points[members > 0]).any() for _, members in self.moved)
        return np.searchsorted(self.points, fixed if is_moved else fixed[:0])


@dataclass(frozen=True)
class Assembly:
    """The content of a scene's code: its masses, groups of effects on masses and on links, and motions of supports.

    `events` are the names of the events, in the order in which their effects were added, and `states` the names of the
    events with a state; `rates` are the numbers of states that have a rate, by name. The points of `meshes` are indices
    of masses; indices from the number of masses on are `supports`. `bonds` are pairs of points, if any effect excludes
    bonded pairs.
    """

    cloud: Cloud
    on_masses: list[Group]
    links: list[Group]
    meshes: list[Placed]
    supports: Supports
    pair_forces: list[PairForce]
    bonds: np.ndarray
    motions: list[Placed]
    events: list[str]
    states: list[str]
    rates: dict[str, int]
    constraints: ConstraintSystem | None
    follows_work: bool

    @property
    def dimension(self) -> int:
        return self.cloud.positions.shape[1]

    @property
    def n(self) -> int:
        """The number of masses in the code, including the points that bodies carry."""
        return int(np.count_nonzero(self.cloud.masses))

    @property
    def own(self) -> int:
        """The number of masses with coordinates in u."""
        return int(np.count_nonzero(self.cloud.is_own))

    @property
    def angles(self) -> int:
        """The number of angles of each mass: 0 if no mass spins."""
        return self.cloud.spins.shape[1]

    @property
    def coordinates(self) -> int:
        """The number of coordinates and angles of masses in the code. The states follow them."""
        return self.n * (self.dimension + self.angles)

    @property
    def degrees(self) -> int:
        """The number of coordinates and states of events. The states with a rate follow them, as velocities."""
        return self.coordinates + len(self.states)

    @property
    def n_rates(self) -> int:
        """The number of states that have a rate. The work follows them."""
        return sum(self.rates.values())

    @property
    def size(self) -> int:
        """The number of degrees of freedom of the problem."""
        return self.degrees - self.dimension * (self.n - self.own)

    @property
    def laws(self) -> list[Placed]:
        of_groups = [law for group in self.on_masses + self.links for law in group.laws]
        return [*of_groups, *self.meshes, *self.pair_forces]

    @property
    def is_conservative(self) -> bool:
        """Whether the sum of the kinetic energy and the potentials is constant."""
        moves = bool(self.supports.moved) or any(group.motions for group in self.links)
        moves |= bool(self.constraints and self.constraints.depends_on_time)
        return all(law.is_conservative for law in self.laws) and not moves and not self.cloud.shear

    @property
    def depends_on_time(self) -> bool:
        """Whether a force or a constraint depends on the time."""
        moves = self.motions or self.cloud.shear or (self.constraints and self.constraints.depends_on_time)
        functions = (function for law in self.laws for function in law.effect.functions().values())
        return bool(moves) or any("t" in arguments(function) for function in functions)

    @property
    def reads_velocity(self) -> bool:
        return self.follows_work or bool(self.constraints) or any(law.effect.reads_velocity() for law in self.laws)

    @property
    def inertias(self) -> np.ndarray:
        """The mass or inertia of each degree of freedom; infinite for angles without inertia, and for states."""
        cloud, states = self.cloud, np.full(len(self.states), np.inf)
        inertia = np.where(cloud.inertia > 0, cloud.inertia, np.inf)[cloud.is_own]
        return np.concatenate([*[cloud.masses[cloud.is_own]] * self.dimension, *[inertia] * self.angles, states])

    def start(self, values: np.ndarray, spins: np.ndarray | None = None) -> np.ndarray:
        """Return u0, or v0, from the positions or velocities of all points, by coordinate and mass, and their spins.

        The angles follow the coordinates, and the states follow the angles.
        """
        is_mass = self.cloud.is_own
        spins = np.zeros_like(self.cloud.spins) if spins is None else spins
        return np.concatenate([values[is_mass].T.ravel(), spins[is_mass].T.ravel(), np.zeros(len(self.states))])


def assemble(
    cloud: Cloud, placed: Sequence[Placed], pair_forces: Sequence[PairForce] = (), *, work: bool = False
) -> Assembly:
    """Group the effects of a scene.

    Raises
    ------
    ValueError
        For a scene without masses, and parameters that do not match the number of masses.
    """
    if not (cloud.masses > 0).any():
        raise ValueError("the scene has no mass that can move: add one with scene.mass(m, position).")
    placed, events, states, rates = numbered(cloud, placed)
    cloud, whole = _without_idle_points(cloud, placed, pair_forces), cloud
    motions, moves = _motions(cloud, placed)
    bodies = _fused(_body_groups(cloud, placed))
    links = _fused(_link_groups(cloud, placed, moves))
    meshes, supports = _meshes(cloud, placed, pair_forces, moves)
    bonds = bonds_of(placed, whole.bodies.carried) if any(x.exclude_bonded for x in pair_forces) else bonds_of((), {})
    given = bodies, links, meshes, supports, list(pair_forces), bonds, motions, events, states, rates
    assembly = Assembly(cloud, *given, constraints=None, follows_work=False)
    if any(isinstance(law.effect, Constraint) for law in placed):
        from .constraint_system import collected  # it needs SciPy

        assembly = replace(assembly, constraints=collected(whole, placed, assembly.degrees + assembly.n_rates + 1))
    return replace(assembly, follows_work=work and not assembly.is_conservative)


def _without_idle_points(cloud: Cloud, placed: Sequence[Placed], pair_forces: Sequence[PairForce]) -> Cloud:
    """Remove the points of bodies on which no force acts, such as joints. The code does not need them."""
    acting = [points for law in placed if not isinstance(law.effect, Constraint) for points in law.points]
    used = [*acting, *(x for pair_force in pair_forces for x in pair_force.points)]
    idle = cloud.bodies.carried.keys() - set(np.concatenate([*used, np.empty(0, dtype=np.int64)]).tolist())
    masses, carried = cloud.masses.copy(), cloud.bodies.carried
    masses[list(idle)] = 0.0
    bodies = cloud.bodies._replace(carried={x: parts for x, parts in carried.items() if x not in idle})
    return replace(cloud, masses=masses, bodies=bodies)


def numbered(cloud: Cloud, placed: Sequence[Placed]) -> tuple[list[Placed], list[str], list[str], dict[str, int]]:
    """Give numbers to the events and states of all members, as columns.

    Return the names of the events and of their states too, and the numbers of states that have a rate, by name.
    """
    count, dimension = cloud.material.size, cloud.positions.shape[1]
    each = [(law, words(law.effect.title), law.points[0].size if law.points else count) for law in placed]
    found: list[Placed] = []
    events: list[str] = []
    states: list[str] = []
    counts: Counter[str] = Counter()
    rates: Counter[str] = Counter()
    for law, title, size in each:
        if RATE in law.effect.functions():
            rates[title] += law.effect.state_size * size
    firsts = dict(zip(rates, np.cumsum([0, *rates.values()]).tolist(), strict=False))
    for law, title, size in each:
        effect, functions = law.effect, law.effect.functions()
        columns = dict(law.columns if law.points else effect.columns((count,), dimension))
        if "event" in functions:
            names = [f"{title} {counts[title] + k}" for k in range(size)]
            counts[title] += size
            columns[EVENT] = len(events) + np.arange(size)
            events += names
            if "state_after" in functions and RATE not in functions:
                numbers = range(effect.state_size)
                columns[STATE] = len(states) + len(numbers) * np.arange(size)
                states += names if len(numbers) == 1 else [f"{name} {k}" for name in names for k in numbers]
        if RATE in functions:
            columns[STATE] = firsts[title] + effect.state_size * np.arange(size)
            firsts[title] += effect.state_size * size
        found.append(replace(law, columns=columns))
    return found, events, states, dict(rates)


@dataclass(frozen=True, eq=False)
class _Moves:
    """How the fixed points move.

    Attributes
    ----------
    patterns : list of tuple of int
        Combinations of laws that move some point together.
    pattern : ndarray of int, shape (points,)
        The pattern of each point.
    members : ndarray of int, shape (points, longest pattern)
        Which member of each law of its pattern moves the point.
    """

    patterns: list[tuple[int, ...]]
    pattern: np.ndarray
    members: np.ndarray


def _motions(cloud: Cloud, placed: Sequence[Placed]) -> tuple[list[Placed], _Moves]:
    """Return the laws of motion, and which points they move. Many motions of one kind become one law."""
    placed = [law for law in placed if isinstance(law.effect, Motion)]
    kinds = [(type(law.effect), *law.effect.functions().items()) for law in placed]
    many = {kind for kind, count in Counter(kinds).items() if count > _MOTIONS}
    laws: dict[Any, list[Placed]] = {}
    moving: dict[int, list[tuple[int, int]]] = {}  # for each point: the laws that move it, and their members
    for k, law in enumerate(placed):
        key = kinds[k] if kinds[k] in many else k
        members = laws.setdefault(key, [])
        for point in law.points[0].tolist():
            moving.setdefault(point, []).append((list(laws).index(key), len(members)))
        members.append(law)
    of_point = {point: tuple(zip(*sorted(pairs), strict=True)) for point, pairs in moving.items()}
    patterns = list(dict.fromkeys([(), *(pattern for pattern, _ in of_point.values())]))
    pattern = np.zeros(cloud.masses.size, dtype=np.int64)
    table = np.zeros((pattern.size, max(map(len, patterns))), dtype=np.int64)
    for point, (its_laws, its_members) in of_point.items():
        pattern[point] = patterns.index(its_laws)
        table[point, : len(its_members)] = its_members
    return [joined(members, list) for members in laws.values()], _Moves(patterns, pattern, table)


def _body_groups(cloud: Cloud, placed: Sequence[Placed]) -> list[Group]:
    masses = cloud.free[cloud.material]
    kinds: dict[Any, list[Group]] = {}
    for law in placed:
        if isinstance(law.effect, Body):
            first = cloud.free[law.points[0]] if law.points else masses
            # effects on all masses form separate groups from effects on some masses: their loop needs no table of
            # indices
            kinds.setdefault((_kind(law.effect), not law.points), []).append(Group([law], first))
    whole = [_joined(groups) for groups in kinds.values()]
    return [group.take(np.argsort(group.first, kind="stable")) for group in whole]


def _link_groups(cloud: Cloud, placed: Sequence[Placed], moves: _Moves) -> list[Group]:
    kinds: dict[Any, list[Group]] = {}
    for law in placed:
        if isinstance(law.effect, Link):
            group, sort = _oriented(cloud, law)
            fixed_end = np.where(cloud.masses[law.points[0]] == 0, *law.points)
            sort = np.column_stack([sort, moves.pattern[fixed_end]])
            for kind in np.unique(sort, axis=0):
                anchored, sign, pattern = kind.tolist()
                motions = moves.patterns[pattern]
                chosen = np.flatnonzero((sort == kind).all(axis=1))
                part = group.take(chosen)
                part = replace(
                    part,
                    second=None if anchored else part.second,
                    anchor=part.anchor if anchored else None,
                    motions=motions if anchored else (),
                    moved=moves.members[fixed_end[chosen], : len(motions)] if anchored and motions else None,
                    sign=sign,
                )
                kinds.setdefault((_kind(law.effect), *kind.tolist()), []).append(part)
    return [part for groups in kinds.values() for part in _split(_joined(groups))]


def _meshes(
    cloud: Cloud, placed: Sequence[Placed], pair_forces: Sequence[PairForce], moves: _Moves
) -> tuple[list[Placed], Supports]:
    """Return the cells of each kind, separately with and without supports, and all supports."""
    kinds: dict[Any, list[Placed]] = {}
    for law in placed:
        if isinstance(law.effect, Cell):
            kinds.setdefault(_kind(law.effect), []).append(law)
    wholes = [joined(laws) for laws in kinds.values()]
    near = [points for points in map(np.concatenate, (x.points for x in pair_forces)) if moves.pattern[points].any()]
    of_cells = [points for whole in wholes for points in whole.points]
    used = np.unique(np.concatenate([np.empty(0, dtype=np.int64), *of_cells, *near]))
    fixed = used[cloud.masses[used] == 0]
    index = cloud.free.copy()
    index[fixed] = np.count_nonzero(cloud.masses) + np.arange(fixed.size)
    meshes = []
    for whole in wholes:
        is_held = np.any([cloud.masses[points] == 0 for points in whole.points], axis=0)
        for side in np.unique(is_held):
            part = whole.take(np.flatnonzero(is_held == side))
            meshes.append(replace(part, points=tuple(index[points] for points in part.points)))
    return meshes, Supports(fixed, cloud.positions[fixed], _moved(fixed, moves))


def _moved(fixed: np.ndarray, moves: _Moves) -> list[tuple[int, np.ndarray]]:
    """Return the laws of motion of some points, with their members: see `Supports`. A law may move a point twice."""
    found: dict[tuple[int, int], np.ndarray] = {}
    for k, point in enumerate(fixed.tolist()):
        pattern = moves.patterns[moves.pattern[point]]
        for c, law in enumerate(pattern):
            table = found.setdefault((law, pattern[:c].count(law)), np.zeros(fixed.size, dtype=np.int64))
            table[k] = 1 + moves.members[point, c]
    return [(law, members) for (law, _), members in found.items()]


def _oriented(cloud: Cloud, law: Placed) -> tuple[Group, np.ndarray]:
    """Orient links: the fixed end, or otherwise the mass with the lower index, comes first.

    Also return, for each link, whether it has a fixed end, and the sign of its group: -1 in one dimension without a
    box, if the first end has the larger x.
    """
    free, x, (a, b) = cloud.free, cloud.positions, law.points
    swapped = (free[b] < 0) | ((free[a] >= 0) & (free[a] > free[b]))
    sign = np.ones(a.size, dtype=np.int64)
    if x.shape[1] == 1 and not cloud.box.any():
        sign = np.where((x[b, 0] >= x[a, 0]) ^ swapped, 1, -1)
    a, b = np.where(swapped, b, a), np.where(swapped, a, b)
    anchored = free[a] < 0
    first = np.where(anchored, free[b], free[a])
    sort = np.column_stack([anchored, sign])
    return Group([law], first, free[b], x[a]), sort


def _split(group: Group) -> Iterator[Group]:
    """Sort links by the difference of their two indices, then by the first index: this gives the longest runs.

    Many links with the same difference, as along the rows and columns of a net, get a separate loop, in which the
    compiler can see that consecutive links share no mass. The number of such loops is limited, because each costs
    compile time: links with many differences, such as all pairs of masses, share one loop over runs. Links that only
    have events have no loop.
    """
    if group.second is None or not any(law.effect.functions().keys() & FORCES for law in group.laws):
        yield group.take(np.argsort(group.first, kind="stable"))
        return
    difference = group.second - group.first
    order = np.lexsort((group.first, difference))
    parts = np.split(order, np.flatnonzero(np.diff(difference[order])) + 1)
    alike = {difference[part[0]] for part in parts if part.size >= _MANY and group.take(part).in_runs} - {1}
    own = {1, *(alike if len(alike) <= _LOOPS else ())}  # neighbours have a special form of loop
    for part in parts:
        if difference[part[0]] in own:
            yield group.take(part)
    rest = [part for part in parts if difference[part[0]] not in own]
    if rest:
        yield group.take(np.concatenate(rest))


def _kind(effect: Effect) -> tuple:
    """A key that is equal for effects that can share a loop. An effect with an array shares its loop with none."""
    return type(effect), effect.state_size, *effect.functions().items(), id(effect) if effect.arrays else None


def _joined(groups: list[Group]) -> Group:
    """Merge groups of the same kind and sort into one group with all their members."""
    one = groups[0]
    if len(groups) == 1:
        return one

    def together(name: str) -> Any:
        parts = [getattr(group, name) for group in groups]
        return None if parts[0] is None else np.concatenate(parts)

    law = joined([group.laws[0] for group in groups])
    parts = {name: together(name) for name in ("first", "second", "anchor", "moved")}
    return replace(one, laws=[law], **parts)


def _fused(groups: list[Group]) -> list[Group]:
    """Merge groups on exactly the same points, to compute shared values once."""
    fused: dict[Any, Group] = {}
    for group in groups:
        arrays = (group.first, group.second, group.anchor, group.moved)
        key = *(None if x is None else x.tobytes() for x in arrays), group.motions, group.sign
        known = fused.get(key)
        fused[key] = replace(group, laws=[*known.laws, *group.laws]) if known else group
    return list(fused.values())


def sources(assembly: Assembly) -> str:
    """Return the sources of the effects."""
    effects = [law.effect for law in assembly.laws + assembly.motions]
    effects += assembly.constraints.effects if assembly.constraints else []
    return "; ".join(dict.fromkeys(f"{effect.title}: {effect.source}" for effect in effects if effect.source))


def first_order(assembly: Assembly) -> dict[str, Any]:
    """Return the first-order unknowns at the start: the states that have a rate, and the work."""
    states = {name: 0.0 if count == 1 else np.zeros(count) for name, count in assembly.rates.items()}
    return states | ({"work": 0.0} if assembly.follows_work else {})


def names(assembly: Assembly) -> tuple[str, ...]:
    """Return the names of the degrees of freedom."""
    angles = {0: (), 1: ("angle",), 3: ("angle_x", "angle_y", "angle_z")}[assembly.angles]
    kinds = (*"xyz"[: assembly.dimension], *angles)
    return (*(f"{kind}{j}" for kind in kinds for j in range(assembly.own)), *assembly.states)


def units(assembly: Assembly) -> str | tuple[str, ...]:
    """Return the units of the degrees of freedom, or the only one."""
    if not assembly.states and not assembly.angles:
        return "m"
    n = assembly.own
    return ("m",) * (n * assembly.dimension) + ("rad",) * (n * assembly.angles) + ("-",) * len(assembly.states)


def note(assembly: Assembly) -> str:
    """Return a description of the scene, with a line for each kind of effect."""
    count = assembly.cloud.material.size
    masses = f"{count} mass{'es' * (count > 1)}"
    lines = [f"{masses} in {assembly.dimension} dimension{'s' * (assembly.dimension > 1)}"]
    acting: Counter[str] = Counter()
    for law in assembly.motions:
        acting[law.effect.title] += len(law.columns["direction"])
    for group in assembly.on_masses + assembly.links:
        for law in group.laws:
            acting[law.effect.title] += group.first.size
    acting += assembly.constraints.counts if assembly.constraints else Counter()
    for mesh in assembly.meshes:
        acting[mesh.effect.title] += mesh.points[0].size
    lines += [f"{count} x {title}" for title, count in acting.items()]
    lines += [
        f"{pair_force.effect.title} between all near pairs of {pair_force.size} points"
        for pair_force in assembly.pair_forces
    ]
    if assembly.angles:
        lines.append(f"{np.count_nonzero(assembly.cloud.inertia)} of the masses spin")
    if assembly.events:
        others = f" to {assembly.events[-1]!r}" * (len(assembly.events) > 1)
        lines.append(f"{len(assembly.events)} event{'s' * bool(others)}: {assembly.events[0]!r}{others}")
    reads = [law.effect.title for law in assembly.laws if law.effect.reads_velocity()]
    reads += ["the work that is followed"] * assembly.follows_work + ["the constraints"] * bool(assembly.constraints)
    if reads:
        lines.append(f"velocity is read by {', '.join(dict.fromkeys(reads))}")
    else:
        lines.append("nothing reads the velocity: central difference takes one evaluation a step")
    if assembly.follows_work:
        lines.append('the work done is followed: solution.z["work"], J')
    return "\n".join(lines)
