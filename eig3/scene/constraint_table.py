"""The table of the constraints of a scene, which `eig3.kernels.constraints` reads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from ..kernels.constraints import FLOATS, HEAD, Areas
from ..kernels.neighbours import as_floats


@dataclass(frozen=True, eq=False)
class Arm:
    """A sum of positions of masses with factors, and a constant vector.

    Attributes
    ----------
    points : ndarray of int
        The indices of masses.
    factors : ndarray
    constant : ndarray, shape (dimension,)
    """

    points: np.ndarray
    factors: np.ndarray
    constant: np.ndarray


@dataclass(frozen=True, eq=False)
class Row:
    """A constraint s (D . E - c) = 0, or a constraint that defines `phi`.

    Attributes
    ----------
    arms : tuple of int
        The indices of D and E among the arms; for a constraint that defines `phi`, the indices of the positions of its
        points.
    scale, target : float
        s and c.
    slopes : tuple of int
        The arms for the gradients of a constraint that defines `phi`, one for each of its points.
    """

    arms: tuple[int, ...]
    scale: float = 1.0
    target: float = 0.0
    slopes: tuple[int, ...] = ()


class Packed(NamedTuple):
    """The table at a place of p.

    Attributes
    ----------
    values : ndarray
        Its numbers.
    order : ndarray of int
        The order of its rows.
    areas, begins : Areas
        Its areas, and their places in p.
    structure : (int, ndarray)
        The place in p of the sparsity structure (which points belong to which row), and the structure.
    """

    values: np.ndarray
    order: np.ndarray
    areas: Areas
    begins: Areas
    structure: tuple[int, np.ndarray]


@dataclass(frozen=True, eq=False)
class ConstraintTable:
    """The constraints between n masses.

    Attributes
    ----------
    weights : ndarray, shape (n,)
        The inverse masses, 1/kg.
    dimension : int
    arms : list of Arm
    rows : list of Row
    own_arms : int
        The number of arms for the gradients of constraints that define `phi`. They follow the other arms.
    length : float
        The largest length of the scene, m.
    degrees : int
        The largest number of degrees of freedom of a run.
    """

    weights: np.ndarray
    dimension: int
    arms: Sequence[Arm]
    rows: Sequence[Row]
    own_arms: int
    length: float
    degrees: int

    def packed(self, place: int) -> Packed:
        """Return the table at a place of p."""
        entries = self.entries()
        order = _order(entries, len(self.rows), len(self.weights))
        areas = self._areas(entries, order)
        parts = [area if k < FLOATS else as_floats(area) for k, area in enumerate(areas)]
        begins = np.cumsum([place + HEAD + 2 * len(areas), *map(len, parts)])[:-1]
        count = len(self.rows), len(self.weights), len(self.arms), len(self.arms) + self.own_arms, len(entries)
        head = [*count, self.length, 0.0, 0.0]
        table = np.column_stack([begins, [len(area) for area in areas]]).ravel()
        # 32-bit integers are stored in pairs, and have no separate index in p
        places = [int(begin) if k < FLOATS else None for k, begin in enumerate(begins)]
        structure = int(begins[FLOATS]), np.concatenate(parts[FLOATS:])
        return Packed(np.concatenate([head, table, *parts]), order, areas, Areas(*places), structure)

    def entries(self) -> np.ndarray:
        """Return a row (row, point, arm, factor) for each entry of the gradients."""
        found: list[tuple[float, ...]] = []
        for k, row in enumerate(self.rows):
            if row.slopes:
                ends = [(of, slope, 1.0) for of, slope in zip(row.arms, row.slopes, strict=True)]
            else:
                first, second = row.arms
                ends = [(first, second, row.scale), (second, first, row.scale)]
                ends = [(first, second, 2 * row.scale)] if first == second else ends
            for of, other, factor in ends:
                arm = self.arms[of]
                factors = factor * arm.factors
                found += [(k, point, other, f) for point, f in zip(arm.points, factors, strict=True)]
        return np.array(found, dtype=np.float64).reshape(len(found), 4)

    def _areas(self, entries: np.ndarray, order: np.ndarray) -> Areas:
        n, d, rows = len(self.weights), self.dimension, [self.rows[k] for k in order]
        count, all_arms = len(rows), len(self.arms) + self.own_arms
        rank = np.argsort(order)
        sequence = np.argsort(rank[entries[:, 0].astype(int)], kind="stable")
        entries = entries[sequence]
        row, point, arm = rank[entries[:, 0].astype(int)], entries[:, 1].astype(int), entries[:, 2].astype(int)
        lows, starts, pairs, lefts, rights = _profile(row, point, count, n)
        fixed = np.zeros((all_arms, d))
        fixed[: len(self.arms)] = [x.constant for x in self.arms]
        none = np.zeros(count)
        two = np.array([(0, 0) if row.slopes else row.arms for row in rows], dtype=int).reshape(count, 2)
        scales = [0.0 if row.slopes else row.scale for row in rows]
        return Areas(
            weights=self.weights,
            fixed=fixed.ravel(),
            arms=fixed.ravel(),
            rates=np.zeros(fixed.size),
            factors=_joined([x.factors for x in self.arms]),
            gradients=np.zeros(d * len(entries)),
            parts=entries[:, 3],
            scales=np.array(scales),
            targets=np.array([row.target for row in rows]),
            target_rates=none,
            target_curvatures=none,
            values=none,
            multipliers=none,
            pivots=none,
            profile=np.zeros(starts[-1]),
            before=np.zeros(self.degrees),
            ways=np.zeros(n * d),
            forces=np.zeros(self.degrees),
            factored=np.zeros(n * d),
            begins=_begins([x.points.size for x in self.arms]),
            points=_joined([x.points for x in self.arms]),
            first_arms=two[:, 0],
            second_arms=two[:, 1],
            entries=_begins(np.bincount(row, minlength=count)),
            entry_points=point,
            entry_arms=arm,
            lows=lows,
            starts=starts,
            pairs=pairs,
            lefts=lefts,
            rights=rights,
        )


def _order(entries: np.ndarray, rows: int, n: int) -> np.ndarray:
    """Return an order of the rows that gives S a small profile."""
    row, point = entries[:, 0].astype(int), entries[:, 1].astype(int)
    touches = csr_array((np.ones(len(row)), (row, point)), shape=(rows, n))
    return np.asarray(reverse_cuthill_mckee(csr_array(touches @ touches.T), symmetric_mode=True))


def _profile(row: np.ndarray, point: np.ndarray, rows: int, n: int) -> tuple[np.ndarray, ...]:
    """Return the profile of S, and the pairs of entries whose products sum to its entries."""
    holds = csr_array((np.ones(len(row)), (np.arange(len(row)), point)), shape=(len(row), n))
    both = (holds @ holds.T).tocoo()
    left, right = both.row, both.col
    is_low = row[right] <= row[left]
    left, right = left[is_low], right[is_low]
    lows = np.arange(rows)
    np.minimum.at(lows, row[left], row[right])
    starts = _begins(np.arange(rows) - lows + 1)
    slot = starts[row[left]] + row[right] - lows[row[left]]
    sequence = np.lexsort((right, left, slot))
    pairs = np.searchsorted(slot[sequence], np.arange(starts[-1] + 1))
    return lows, starts, pairs, left[sequence], right[sequence]


def _begins(counts: Sequence[int] | np.ndarray) -> np.ndarray:
    return np.concatenate([[0], np.cumsum(counts)]).astype(int)


def _joined(arrays: list[np.ndarray]) -> np.ndarray:
    return np.concatenate(arrays) if arrays else np.empty(0)
