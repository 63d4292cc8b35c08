"""The bonds of a scene, and the pairs of points that are 1, 2 or 3 bonds apart, as for `special_bonds` in LAMMPS."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np

from .cell import Cell
from .constraint import Constraint
from .effect import Link
from .placed import Placed

ORDERS = ("1-2", "1-3", "1-4")  # the ends of a bond, of two bonds in a row, and of three
_NONE = np.empty((0, 2), dtype=np.int64)


def check_orders(given: Any) -> tuple[str, ...]:
    """Return which pairs are excluded, by the names of `ORDERS`.

    Raises
    ------
    TypeError, ValueError
        If they are not such names.
    """
    remedy = 'exclude_bonded must name pairs that bonds join, such as ("1-2", "1-3", "1-4")'
    if isinstance(given, str) or not isinstance(given, Collection):
        raise TypeError(f"{remedy}, not {given!r}.")
    for order in given:
        if order not in ORDERS:
            raise ValueError(f"{remedy}, not {order!r}.")
    return tuple(order for order in ORDERS if order in given)


def bonds_of(placed: Sequence[Placed], carried: Mapping[int, tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """Return the bonds, of shape (bonds, 2), the smaller number first.

    Bonds join the ends of a link or constraint, the corners of a cell with a volume, and all points of a rigid body.
    Angles and dihedrals are not bonds.
    """
    found = [_NONE]
    for law in placed:
        if isinstance(law.effect, Link | Constraint) or (isinstance(law.effect, Cell) and law.effect.extent):
            found += [np.column_stack(ends) for ends in combinations(law.points, 2)]
    bodies: dict[int, list[int]] = {}
    for point, (parts, _) in carried.items():
        bodies.setdefault(int(parts[0]), [int(parts[0])]).append(point)
    found += [np.array(list(combinations(points, 2))) for points in bodies.values()]
    return _each_once(np.concatenate(found))


def bonded_pairs(bonds: np.ndarray, orders: Collection[str]) -> np.ndarray:
    """Return the pairs whose shortest path over bonds has one of these lengths, of shape (pairs, 2), each once."""
    steps = np.concatenate([bonds, bonds[:, ::-1]])
    steps = steps[np.argsort(steps[:, 0], kind="stable")]
    pairs, shorter, found = bonds, _NONE, [_NONE]
    for order in ORDERS:
        if order in orders:
            found.append(pairs)
        shorter = np.concatenate([shorter, pairs])
        pairs = _without(_each_once(_longer(pairs, steps)), shorter)
    return _each_once(np.concatenate(found))


def _longer(pairs: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Return the pairs that are one bond longer."""
    found = [_NONE]
    for begin, end in (pairs.T, pairs[:, ::-1].T):
        first, last = (np.searchsorted(steps[:, 0], end, side=side) for side in ("left", "right"))
        counts = last - first
        along = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        found.append(np.column_stack([np.repeat(begin, counts), steps[np.repeat(first, counts) + along, 1]]))
    longer = np.concatenate(found)
    return longer[longer[:, 0] != longer[:, 1]]


def _each_once(pairs: np.ndarray) -> np.ndarray:
    return np.unique(np.sort(pairs, axis=1), axis=0)


def _without(pairs: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return the pairs, in order, that are not among others."""
    known = set(map(tuple, others.tolist()))
    return pairs[[pair not in known for pair in map(tuple, pairs.tolist())]] if len(pairs) else pairs
