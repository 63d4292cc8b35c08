"""Pair forces: links between all pairs of points within a cutoff, by a neighbour list in compiled code."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..kernels import neighbours
from ..kernels.neighbours import Areas
from .effect import RATE, Link
from .placed import Placed

#: For each rule of `Link.mixed`: the function that computes the share of a point from its value, and the operator
#: between the shares of two points.
_MIXING: dict[str, tuple[Callable[[np.ndarray], np.ndarray], str]] = {
    "arithmetic": (lambda values: values / 2, "+"),
    "geometric": (np.sqrt, "*"),
    "product": (lambda values: values, "*"),
}

_OPERATIONS = {"+": np.add, "*": np.multiply}
_SKIN = 0.2  # relative to the largest cutoff
_DENSE = {1: 3, 2: 8, 3: 16}  # neighbours of a point in a dense packing, by the dimension
_MANY_MATES = 8  # with at least this number of pairs of a point, each point has separate batches
_JUMP = 3.0  # points are sorted if consecutive points are farther apart than this number of point spacings
_GROWTH = 2.0  # capacity of the list, relative to the pairs at the start


@dataclass(frozen=True, eq=False)
class PairForce(Placed):
    """A link with a cutoff between all pairs of points of a group, or of two groups.

    The parameters have one value, or one for each point of the first group.

    Attributes
    ----------
    exclude_bonded : tuple of str
        The excluded pairs, by the number of bonds between them: see `bonds`.
    neighbor_capacity : int or None
        Pairs of each point for which there is memory.
    """

    effect: Link
    exclude_bonded: tuple[str, ...] = ()
    neighbor_capacity: int | None = None

    @property
    def first(self) -> np.ndarray:
        """The points of the first or only group."""
        return self.points[0]

    @property
    def second(self) -> np.ndarray:
        """The points of the second group; empty if there is only one group."""
        return self.points[1]

    @property
    def size(self) -> int:
        """The number of points."""
        return self.first.size + self.second.size

    def operator(self, name: str) -> str:
        """Return the operator between the shares of two points in a field."""
        return _MIXING[self.effect.mixing_rules()[name]][1]

    def shares(self, name: str) -> np.ndarray:
        """Return the shares of all points in the values of their pairs, for a field with a value for each point.

        With two groups, the value of a pair is the value of its point of the first group.
        """
        column, neutral = self.columns[name], 0.0 if self.operator(name) == "+" else 1.0
        if self.second.size:
            return np.concatenate([column, np.full(self.second.size, neutral)])
        return _MIXING[self.effect.mixing_rules()[name]][0](column)

    def between(self, one: np.ndarray, other: np.ndarray) -> Placed:
        """Return the link with the parameters of pairs of points of the first group; with two groups, of `one`."""
        mate = np.full_like(other, self.first.size) if self.second.size else other
        columns = dict(self.columns)
        for name in (name for name, column in self.columns.items() if len(column) > 1):
            shares = self.shares(name)
            columns[name] = _OPERATIONS[self.operator(name)](shares[one], shares[mate])
        return Placed(self.effect, columns)


def _order(numbers: np.ndarray, cloud: Any) -> np.ndarray:
    """Return the order of points in a list: masses, then fixed points.

    They are ordered by their index in the scene, or by their positions at the start if consecutive points are too far
    apart: near points are then near each other in memory, and mostly in the part of one thread.
    """
    free, positions = cloud.free[numbers], cloud.positions[numbers]
    order = np.lexsort((free, free < 0))
    return np.lexsort((*_cells(positions), free < 0)) if _jumps(positions[order]) else order


def _spacing(x: np.ndarray) -> float:
    """Return the spacing of points that would fill the region of most of the points uniformly, or 0.

    A region that is thinner than the spacing is filled by a line or a layer of points.
    """
    sides = np.sort(np.ptp(np.quantile(x, [0.05, 0.95], axis=0), axis=0))[::-1]
    return float(np.max((np.cumprod(sides) / len(x)) ** (1 / np.arange(1, sides.size + 1))))


def _jumps(x: np.ndarray) -> bool:
    """Return whether consecutive points are mostly far from each other."""
    steps = np.linalg.norm(np.diff(x, axis=0), axis=1)
    return len(x) > 1 and float(np.median(steps)) > _JUMP * _spacing(x) > 0


def _cells(x: np.ndarray) -> Iterator[np.ndarray]:
    """Return the cell indices of points by axis, with the longest extent, the first sort key, last."""
    extents, spacing = np.ptp(x, axis=0), _spacing(x)
    return (np.floor(x[:, k] / spacing) for k in np.argsort(extents, kind="stable"))


def check_pair_force(pair_force: PairForce, cloud: Any) -> None:
    """Check that a link can act between the points of a pair force.

    Raises
    ------
    TypeError, ValueError
        If the link cannot. The error names the effect.
    """
    effect, numbers, box = pair_force.effect, np.concatenate(pair_force.points), cloud.box
    is_mass = cloud.masses[numbers] > 0
    title = effect.title
    if not effect.cutoff_field:
        raise TypeError(f"{title} has no cutoff, and thus needs two arguments of points: the ends of each link.")
    for name, what in (("event", "an event"), (RATE, "a state")):
        if name in effect.functions():
            raise TypeError(f"{title} has {what}, and thus needs two arguments of points: the ends of each link.")
    if np.unique(numbers).size < numbers.size:
        raise ValueError(f"{title} was given a point twice: a point of others must not be in the first array.")
    if not is_mass.any():
        raise ValueError(f"{title} was given fixed points only, which cannot move: give masses.")
    if cloud.shear and not is_mass.all():
        raise ValueError(f"{title} was given fixed points, which do not move with a box that shears: give masses.")
    for name, column in pair_force.columns.items():
        if len(column) > 1 and name not in effect.mixed:
            able = " and ".join(effect.mixed) or "no field"
            raise ValueError(
                f"{name} of {title} must be a number for the pairs of a group: {able} can have a value for each point."
            )
        if len(column) > 1 and effect.mixing_rules()[name] == "geometric":
            effect.require(column >= 0, f"{name} must not be negative, because the mean of two points is geometric")
    reach = pair_force.columns[effect.cutoff_field]
    effect.require(reach > 0, f"{effect.cutoff_field} must be positive")
    if (reach.max() > box[box > 0] / 2).any():
        raise ValueError(
            f"{effect.cutoff_field} of {title} must be at most half a side of the box, {box[box > 0].min() / 2:g}."
        )
    places = cloud.positions[numbers].copy()
    places[:, box > 0] %= box[box > 0]
    if np.unique(places, axis=0).shape[0] < numbers.size:
        raise ValueError(f"{title} has no direction where two points coincide at the start: put them apart.")
    effect.check_group(pair_force, cloud)


@dataclass(frozen=True, eq=False)
class Listing:
    """The neighbour list of a pair force in p.

    Attributes
    ----------
    place : int
    areas : Areas
    points, masses, room : int
        The number of points, the number of masses among them, and the capacity in pairs.
    own : dict of str to int
        The places of the fields with a value for each point: the shares of the points, see `PairForce.shares`.
    begin : int
        The index of the first mass if the indices are consecutive, otherwise -1.
    is_dense : bool
        Whether points have many neighbours at the start.
    fixed : ndarray of int
        The numbers of the fixed points in the scene, which are the last points of the list.
    values : ndarray
        The content of p at the place.
    """

    place: int
    areas: Areas
    points: int
    masses: int
    room: int
    own: dict[str, int]
    begin: int
    is_dense: bool
    fixed: np.ndarray
    values: np.ndarray


def listed(pair_force: PairForce, place: int, cloud: Any, u0: np.ndarray, pairs: np.ndarray) -> Listing:
    """Return the neighbour list of a pair force at the start, stored from a place in p on."""
    dimension, x, cutoff = cloud.positions.shape[1], cloud.positions, pair_force.effect.cutoff_field
    numbers = np.concatenate(pair_force.points)
    order = _order(numbers, cloud)
    points, count = numbers[order], numbers.size
    index = cloud.free[points]
    index = index[index >= 0]
    own: dict[str, int] = {}
    fields = [np.empty(0)]
    for name in (name for name, column in pair_force.columns.items() if len(column) > 1):
        own[name] = place + sum(field.size for field in fields)
        fields.append(pair_force.shares(name)[order])
    begin = place + sum(field.size for field in fields)
    firsts, mates = _apart(points, pairs, cloud.masses.size)
    widest, has_groups = float(pair_force.columns[cutoff].max()), pair_force.second.size > 0
    tables = {"number": index, "group": order >= pair_force.first.size, "apart": firsts, "apart_mates": mates}

    def attempt(room: int, skin: float) -> tuple[np.ndarray, Areas, int | None]:
        """Return p, the areas, and the number of pairs, or None if the pairs exceed the capacity."""
        areas, end = Areas.of(begin, count, room, _buckets(count), mates.size, dimension)
        p = np.zeros(end)
        p[place:begin] = np.concatenate(fields)
        constants = count, index.size, np.count_nonzero(cloud.masses), skin, has_groups, widest, own.get(cutoff, 0)
        p[begin : begin + neighbours.BOX] = *constants, room, _buckets(count), neighbours.IS_LIST
        p[begin + neighbours.BOX :][:dimension] = cloud.box
        p[begin + neighbours.PARTS] = p[begin + neighbours.WANTED] = 1
        p[begin + neighbours.SHEAR], p[begin + neighbours.PRESENT_SKIN] = cloud.shear, skin
        p[begin + neighbours.HEAD :][: len(areas)] = areas
        p[areas.x :][: dimension * count] = x[points].ravel()
        for name, table in tables.items():
            _integers(p, getattr(areas, name), table.size)[:] = table
        neighbours.LISTS[dimension](neighbours.REFRESH, 0.0, u0, p, begin, 0, 0)
        is_whole = p[begin + neighbours.LISTED] == index.size and p[begin + neighbours.PRESENT_SKIN] == skin
        return p, areas, int(_integers(p, areas.stop, index.size)[-1]) if is_whole else None

    room = count * (pair_force.neighbor_capacity or _DENSE[dimension]) + 64
    p, areas, found = attempt(room, 0.0)
    while found is None and pair_force.neighbor_capacity is None:
        room *= 2
        p, areas, found = attempt(room, 0.0)
    skin = _skin(pair_force, (room if found is None else found) / count, dimension)
    p, areas, found = attempt(room, skin)
    while pair_force.neighbor_capacity is None and (found is None or _GROWTH * found > room):
        room = 2 * room if found is None else int(_GROWTH * found) + 64
        p, areas, found = attempt(room, skin)
    first = int(index[0]) if (np.diff(index) == 1).all() else -1
    is_dense = (room if found is None else found) >= _MANY_MATES * count
    return Listing(begin, areas, count, index.size, room, own, first, is_dense, points[index.size :], p[place:])


def near_pairs(
    pair_force: PairForce, cloud: Any, u0: np.ndarray, pairs: np.ndarray
) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
    """Return the positions of the two points of all pairs that are near each other at u0, and their cutoffs."""
    listing = listed(replace(pair_force, neighbor_capacity=None), 0, cloud, u0, pairs)
    p, areas, cutoff = listing.values, listing.areas, pair_force.effect.cutoff_field
    count = int(_integers(p, areas.stop, listing.masses)[-1])
    one, other = (_integers(p, area, count) for area in (areas.owners, areas.mates))
    x = p[areas.x :][: listing.points * cloud.positions.shape[1]].reshape(listing.points, -1)
    if cutoff not in listing.own:
        return (x[one], x[other]), np.full(count, pair_force.columns[cutoff][0])
    share = p[listing.own[cutoff] :]
    return (x[one], x[other]), share[one] + share[other]


def _skin(pair_force: PairForce, found: float, dimension: int) -> float:
    """Return the skin of a list, from the number of pairs within the cutoff for each point.

    If many points are within the cutoff, the skin is proportional to their spacing.
    """
    widest = float(pair_force.columns[pair_force.effect.cutoff_field].max())
    return _SKIN * widest * min(1.0, (_DENSE[dimension] / (2 * found + 1)) ** (1 / dimension))


def _apart(points: np.ndarray, pairs: np.ndarray, n_points: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the excluded pairs of a list: the index where the mates of each point begin, and the mates."""
    local = np.full(n_points, -1)
    local[points] = np.arange(points.size)
    ends = np.sort(local[pairs], axis=1)
    ends = ends[ends[:, 0] >= 0]
    ends = ends[np.lexsort(ends.T[::-1])]
    return np.searchsorted(ends[:, 0], np.arange(points.size + 1)), ends[:, 1]


def _buckets(count: int) -> int:
    """Return the number of hash buckets for the cells of points: a power of two that leaves most buckets empty."""
    return 1 << (4 * count - 1).bit_length()


def _integers(p: np.ndarray, begin: int, count: int) -> np.ndarray:
    return p[begin : begin + (count + 1) // 2].view(np.int32)[:count]
