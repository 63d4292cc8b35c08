"""A scene's effects put in order for the code that will run them: grouped by kind, sorted, packed.

Masses get indices, effects of one kind on points of one sort become one group, and groups on the very same points
become one loop. Links are sorted so that neighbours in a row of masses follow each other: a row is then a loop over
indices that go up by one, which needs no table of indices and which a compiler can vectorise.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from .effect import Body, Effect, Link, Motion

#: An effect, the numbers of the points in each of its arguments (none: all masses), and its columns of parameters.
Placement = tuple[Effect, tuple[np.ndarray, ...], "dict[str, np.ndarray] | None"]

_MANY = 16  # links of one index difference get a loop of their own,
_LOOPS = 13  # unless a kind of link has more such differences than a cubic lattice, where each mass has 26 neighbours
_LEAST_RUN = 4  # on average, for a loop over runs of indices rather than over a table of every index


@dataclass(frozen=True)
class Cloud:
    """All points of a scene: masses of shape (points,), 0 where fixed; positions and velocities (points, dimension)."""

    masses: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray

    @cached_property
    def free(self) -> np.ndarray:
        """The index of each point among the masses; -1 for fixed points."""
        is_free = self.masses > 0
        return np.where(is_free, np.cumsum(is_free) - 1, -1)


@dataclass(frozen=True, eq=False)
class Law:
    """Effects of one kind, with the parameters of each member of their group."""

    effect: Effect  # one of them, for its functions and names
    columns: dict[str, np.ndarray]

    @property
    def has_potential(self) -> bool:
        return "potential" in self.effect.functions()


@dataclass(frozen=True, eq=False)
class Group:
    """Laws on the same points.

    Attributes
    ----------
    laws : list of Law
    first : ndarray of int, shape (members,)
        The masses acted on: of a link between masses, that with the lower index.
    second : ndarray of int, shape (members,), or None
        The other mass of links between masses.
    anchor : ndarray, shape (members, dimension), or None
        Where the fixed ends of links stand.
    motions : tuple of int
        What moves those fixed ends.
    sign : int
        Of links in one dimension: 1 where the coordinate grows from the first to the second end, or from the anchor to
        the mass, at the start; -1 where it falls.
    """

    laws: list[Law]
    first: np.ndarray
    second: np.ndarray | None = None
    anchor: np.ndarray | None = None
    motions: tuple[int, ...] = ()
    sign: int = 1

    @property
    def difference(self) -> int | None:
        """How far apart the two indices are in every link, if it is the same."""
        if self.second is None or np.ptp(self.second - self.first):
            return None
        return int(self.second[0] - self.first[0])

    @cached_property
    def runs(self) -> np.ndarray:
        """Where indices go up by one: rows of (first member, members, first mass, second mass)."""
        second = self.first if self.second is None else self.second
        steps = (np.diff(self.first) == 1) & (np.diff(second) == 1)
        starts = np.concatenate([[0], np.flatnonzero(~steps) + 1])
        counts = np.diff([*starts, self.first.size])
        return np.column_stack([starts, counts, self.first[starts], second[starts]])

    @property
    def in_runs(self) -> bool:
        """Whether the indices go up by one often enough for loops over runs."""
        return self.first.size >= _LEAST_RUN * len(self.runs)

    def take(self, members: np.ndarray) -> Group:
        """The group of some members, or of all in another order."""

        def part(values: np.ndarray | None) -> Any:
            return None if values is None else values[members]

        laws = [
            Law(law.effect, {n: c if n in law.effect.arrays else c[members] for n, c in law.columns.items()})
            for law in self.laws
        ]
        return replace(self, laws=laws, first=part(self.first), second=part(self.second), anchor=part(self.anchor))


@dataclass(frozen=True)
class Assembly:
    """What the code of a scene is made from: its masses, groups, and motions of supports."""

    cloud: Cloud
    bodies: list[Group]
    links: list[Group]
    motions: list[Law]
    follows_work: bool

    @property
    def dimension(self) -> int:
        return self.cloud.positions.shape[1]

    @property
    def n(self) -> int:
        """The number of masses."""
        return int(np.count_nonzero(self.cloud.masses))

    @property
    def laws(self) -> list[Law]:
        return [law for group in self.bodies + self.links for law in group.laws]

    @property
    def is_conservative(self) -> bool:
        """Whether the kinetic energy and the potentials are constant together."""
        return all(law.has_potential for law in self.laws) and not any(group.motions for group in self.links)

    @property
    def reads_velocity(self) -> bool:
        return self.follows_work or any(law.effect.reads_velocity() for law in self.laws)

    def start(self, values: np.ndarray) -> np.ndarray:
        """Positions or velocities of all points as u0 or v0 of a run: by coordinate, then by mass."""
        return values[self.cloud.masses > 0].T.ravel()


def assemble(cloud: Cloud, placements: Sequence[Placement], *, work: bool) -> Assembly:
    """Put a scene's effects in order.

    Raises
    ------
    ValueError
        For a scene without masses, and parameters that do not go with their number.
    """
    if not (cloud.masses > 0).any():
        raise ValueError("the scene has no mass that could move: add one with scene.mass(m, position).")
    motions, motion_sets, set_of = _motions(cloud, placements)
    bodies = _fused(_body_groups(cloud, placements))
    links = _fused(_link_groups(cloud, placements, motion_sets, set_of))
    assembly = Assembly(cloud, bodies, links, motions, follows_work=False)
    return replace(assembly, follows_work=work and not assembly.is_conservative)


def _motions(cloud: Cloud, placements: Sequence[Placement]) -> tuple[list[Law], list[tuple[int, ...]], np.ndarray]:
    """The motions, the sets of them that move some point, and the set of each point."""
    motions: list[Law] = []
    sets: list[tuple[int, ...]] = [()]
    set_of = np.zeros(cloud.masses.size, dtype=np.int64)
    for effect, numbers, columns in placements:
        if not isinstance(effect, Motion):
            continue
        for old in np.unique(set_of[numbers[0]]):
            moved = numbers[0][set_of[numbers[0]] == old]
            set_of[moved] = len(sets)
            sets.append((*sets[old], len(motions)))
        motions.append(Law(effect, columns or {}))
    return motions, sets, set_of


def _body_groups(cloud: Cloud, placements: Sequence[Placement]) -> list[Group]:
    dimension = cloud.positions.shape[1]
    masses = np.arange(np.count_nonzero(cloud.masses))
    kinds: dict[Any, list[Group]] = {}
    for effect, numbers, columns in placements:
        if not isinstance(effect, Body):
            continue
        if columns is None:
            columns = effect.columns(masses.shape, dimension)
        first = cloud.free[numbers[0]] if numbers else masses
        # what acts on all stays apart from what acts on some: it is a loop without indices
        kinds.setdefault((_kind(effect), not numbers), []).append(Group([Law(effect, columns)], first))
    joined = [_joined(groups) for groups in kinds.values()]
    return [group.take(np.argsort(group.first, kind="stable")) for group in joined]


def _link_groups(
    cloud: Cloud, placements: Sequence[Placement], motion_sets: list[tuple[int, ...]], set_of: np.ndarray
) -> list[Group]:
    kinds: dict[Any, list[Group]] = {}
    for effect, numbers, columns in placements:
        if isinstance(effect, Link):
            group, sort = _oriented(cloud, Law(effect, columns or {}), *numbers)
            # of links to fixed points, those with other motions are others
            fixed_end = np.where(cloud.masses[numbers[0]] == 0, *numbers)
            sort = np.column_stack([sort, set_of[fixed_end]])
            for kind in np.unique(sort, axis=0):
                anchored, sign, motions = kind.tolist()
                part = group.take(np.flatnonzero((sort == kind).all(axis=1)))
                part = replace(
                    part,
                    second=None if anchored else part.second,
                    anchor=part.anchor if anchored else None,
                    motions=motion_sets[motions] if anchored else (),
                    sign=sign,
                )
                kinds.setdefault((_kind(effect), *kind.tolist()), []).append(part)
    return [part for groups in kinds.values() for part in _split(_joined(groups))]


def _oriented(cloud: Cloud, law: Law, a: np.ndarray, b: np.ndarray) -> tuple[Group, np.ndarray]:
    """Links with the fixed end, or else the lower index, first.

    With them, of each, whether it is to a fixed point, and the sign that its group has in one dimension.
    """
    free, x = cloud.free, cloud.positions
    swapped = (free[b] < 0) | ((free[a] >= 0) & (free[a] > free[b]))
    sign = np.where(x[b, 0] >= x[a, 0], 1, -1) if x.shape[1] == 1 else np.ones(a.size, dtype=np.int64)
    if x.shape[1] == 1:
        sign = np.where(swapped, -sign, sign)
    a, b = np.where(swapped, b, a), np.where(swapped, a, b)
    anchored = free[a] < 0
    first = np.where(anchored, free[b], free[a])
    sort = np.column_stack([anchored, sign])
    return Group([law], first, free[b], x[a]), sort


def _split(group: Group) -> Iterator[Group]:
    """Sort links by the difference of their two indices, then by the first index: this gives the longest runs.

    Where many links have the same difference, as along the rows and columns of a net, they get a loop of their own, in
    which the compiler can see that consecutive links share no mass. The number of such loops is limited, because each
    costs compile time: links with many differences, such as all pairs of masses, share one loop over runs.
    """
    if group.second is None:
        yield group.take(np.argsort(group.first, kind="stable"))
        return
    difference = group.second - group.first
    order = np.lexsort((group.first, difference))
    parts = np.split(order, np.flatnonzero(np.diff(difference[order])) + 1)
    alike = {difference[part[0]] for part in parts if part.size >= _MANY and group.take(part).in_runs}
    own = {1, *(alike if len(alike) <= _LOOPS else ())}
    for part in parts:
        if difference[part[0]] in own:
            yield group.take(part)
    rest = [part for part in parts if difference[part[0]] not in own]
    if rest:
        yield group.take(np.concatenate(rest))


def _kind(effect: Effect) -> tuple:
    """What effects have in common that one loop can serve; an array belongs to its one effect."""
    return type(effect), *effect.functions().items(), id(effect) if effect.arrays else None


def _joined(groups: list[Group]) -> Group:
    """One group of all members of groups of the same kind and sort."""
    one = groups[0]
    if len(groups) == 1:
        return one

    def together(name: str) -> Any:
        parts = [getattr(group, name) for group in groups]
        return None if parts[0] is None else np.concatenate(parts)

    columns = {
        name: one.laws[0].columns[name]
        if name in one.laws[0].effect.arrays
        else np.concatenate([group.laws[0].columns[name] for group in groups])
        for name in one.laws[0].columns
    }
    law = Law(one.laws[0].effect, columns)
    return replace(one, laws=[law], first=together("first"), second=together("second"), anchor=together("anchor"))


def _fused(groups: list[Group]) -> list[Group]:
    """Groups on the very same points as one, so that what they have in common is computed once."""
    fused: dict[Any, Group] = {}
    for group in groups:
        key = *(None if x is None else x.tobytes() for x in (group.first, group.second, group.anchor)), group.motions
        known = fused.get((*key, group.sign))
        fused[(*key, group.sign)] = replace(group, laws=[*known.laws, *group.laws]) if known else group
    return list(fused.values())


def sources(assembly: Assembly) -> str:
    """Where the effects come from."""
    effects = [law.effect for law in assembly.laws + assembly.motions]
    return "; ".join(dict.fromkeys(f"{effect.title}: {effect.source}" for effect in effects if effect.source))


def note(assembly: Assembly) -> str:
    """What a scene contains, in lines."""
    masses = f"{assembly.n} mass{'es' * (assembly.n > 1)}"
    lines = [f"{masses} in {assembly.dimension} dimension{'s' * (assembly.dimension > 1)}"]
    acting: Counter[str] = Counter()
    for law in assembly.motions:
        acting[law.effect.title] += 1
    for group in assembly.bodies + assembly.links:
        for law in group.laws:
            acting[law.effect.title] += group.first.size
    lines += [f"{count} x {title}" for title, count in acting.items()]
    reads = [law.effect.title for law in assembly.laws if law.effect.reads_velocity()]
    reads += ["the work that is followed"] * assembly.follows_work
    if reads:
        lines.append(f"velocity is read by {', '.join(dict.fromkeys(reads))}")
    else:
        lines.append("nothing reads the velocity: central difference takes one evaluation a step")
    if assembly.follows_work:
        lines.append('the work done is followed: solution.integrals["work"], J')
    return "\n".join(lines)
