"""The contacts between points that push each other, and their normal forces: the force chains of granular materials."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .assembly import Cloud
from .bonds import bonded_pairs, bonds_of
from .effect import Link, arguments
from .frictional_contact import FrictionalContact
from .pair_force import PairForce
from .placed import Placed

_NONE = np.empty((0, 2), dtype=np.int64)


@dataclass(frozen=True, eq=False)
class ForceChains:
    """The contacts of a scene: ``contacts(t, x, v)`` returns the pairs that push each other, and their forces.

    Attributes
    ----------
    inverse_masses : ndarray, shape (points,)
        1/kg; 0 for fixed points.
    laws : list of (Placed, ndarray of int, shape (pairs, 2))
        Contacts of given pairs or of near points, and the pairs that bonds exclude.
    """

    inverse_masses: np.ndarray
    laws: list[tuple[Placed, np.ndarray]]

    @classmethod
    def of(cls, cloud: Cloud, placed: Sequence[Placed], pair_forces: Sequence[PairForce]) -> ForceChains | None:
        """Return the contacts of a scene, or None if it has none."""
        laws: list[tuple[Placed, np.ndarray]] = []
        for law in (*placed, *pair_forces):
            if not isinstance(law.effect, Link) or law.effect.picture != "discs":
                continue
            tension = law.effect.functions().get("tension")
            if tension is not None and "state" not in arguments(tension):  # geometries have no states
                orders = law.exclude_bonded if isinstance(law, PairForce) else ()
                bonds = bonds_of(placed, cloud.bodies.carried) if orders else _NONE
                laws.append((law, bonded_pairs(bonds, orders)))
        inverse = 1 / np.where(cloud.masses > 0, cloud.masses, np.inf)
        return cls(inverse, laws) if laws else None

    def __call__(self, t: float, x: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the pairs that push each other, shape (pairs, 2), and their normal forces, N, shape (pairs,).

        Parameters
        ----------
        t : float
        x, v : ndarray, shape (points, dimension)
            Positions inside the periodic box, and velocities. Pairs across a side of the box are left out.
        """
        found = [(_NONE, np.empty(0))]
        for law, excluded in self.laws:
            ends, given = _near(law, x, excluded) if isinstance(law, PairForce) else _listed(law)
            i, j = ends.T
            way = x[j] - x[i]
            r = np.linalg.norm(way, axis=1)
            inverse = self.inverse_masses[i] + self.inverse_masses[j]
            given |= {
                "t": np.full(len(r), t),
                "r": r,
                "rate": ((v[j] - v[i]) * way).sum(axis=1) / r,
                "mass": 1 / np.where(inverse > 0, inverse, np.inf),
            }
            tension = law.effect.functions()["tension"]
            columns = [given[name].tolist() for name in arguments(tension)]
            push = -np.array([tension(*values) for values in zip(*columns, strict=True)], dtype=float)
            is_felt = (push > 0) & (inverse > 0)  # fixed points do not push each other
            found.append((ends[is_felt], push[is_felt]))
        pairs, forces = zip(*found, strict=True)
        return np.concatenate(pairs), np.concatenate(forces)


def _listed(law: Placed) -> tuple[np.ndarray, dict[str, Any]]:
    """Return the pairs of a contact that are given, and its parameters."""
    ends = np.column_stack(law.points)
    return ends, {name: np.broadcast_to(law.columns[name], len(ends)) for name in _read(law)}


def _read(law: Placed) -> set[str]:
    """Return the parameters on which the force and the radii of a contact depend."""
    return law.columns.keys() & {*arguments(law.effect.functions()["tension"]), "contact_distance", "wall_radius"}


def _near(law: PairForce, x: np.ndarray, excluded: np.ndarray) -> tuple[np.ndarray, dict[str, Any]]:
    """Return the pairs of near points that can touch, and the parameters of the contact for each pair."""
    from scipy.spatial import cKDTree

    numbers, first = np.concatenate(law.points), law.first.size
    reach = law.columns[law.effect.cutoff_field]
    ends = np.sort(cKDTree(x[numbers]).query_pairs(reach.max(), output_type="ndarray"), axis=1)
    if law.second.size:
        ends = ends[(ends[:, 0] < first) & (ends[:, 1] >= first)]
    if len(excluded):
        known = set(map(tuple, excluded.tolist()))
        ends = ends[[tuple(sorted(pair)) not in known for pair in numbers[ends].tolist()]]
    i, j = ends.T
    columns = law.between(i, j).columns
    given: dict[str, Any] = {name: np.broadcast_to(columns[name], len(ends)) for name in _read(law)}
    if isinstance(law.effect, FrictionalContact):
        radii = np.broadcast_to(reach, first) / 2
        other = given["wall_radius"] if law.second.size else radii[j]
        given["radius"] = (given["contact_distance"] - other) * other / given["contact_distance"]
    return numbers[ends], given
