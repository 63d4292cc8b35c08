"""Estimate how hard the points of a scene strike each other and its planes, from their energy.

Two points approach until the work against the force between them equals their kinetic energy. The stiffness there,
by differences of the force, is among the highest in the motion. For two points on which nothing else acts, it is a
bound. For many points it is an estimate: the energy of a collision is the energy of the two fastest points at the
start, with the speed that the forces on single masses and a bounce off a moving wall would add over the span, and of
the most compressed pair at the start.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from .assembly import Assembly, Group
from .bonds import bonded_pairs
from .effect import FORCES
from .frictional_contact import FrictionalContact
from .pair_force import PairForce, near_pairs
from .placed import Placed, moves

_LEAST, _HALF, _CLOSEST = 1e-8, 0.5, 1e-12  # of the cutoff: where the approach of a pair begins, is halved, and ends
_DEPTHS = 1e-18, 1e6  # depths of penetration into a plane, m
_IN_A_DECADE = 100  # distances in a decade
_TIMES = 65  # of a span, for the speed of walls
_DIFFERENCE = 1e-4  # the relative step of differences over a distance or a speed

#: The repulsive force of two points, as a function of their distance and of its rate.
Push = Callable[[float, float], float]


@dataclass(frozen=True, eq=False)
class _Meeting:
    """The collision of two points, or of a point and a plane.

    Attributes
    ----------
    push : Push
    way : ndarray
        Decreasing distances, from the first contact on.
    begin : float
        The least distance at the start.
    energy, speed : float
        The energy and the speed of the two points, J and m/s.
    inverse : float
        The inverse of their effective mass, times the number of contacts that act together: in the densest lattices of
        d dimensions, the highest frequency is sqrt(d + 1) times the frequency of a pair.
    slide : Callable or None
        A function that returns the tangential stiffness and damping at a distance.
    turning : float
        The inverse of the effective tangential mass.
    """

    push: Push
    way: np.ndarray
    begin: float
    energy: float
    speed: float
    inverse: float
    slide: Callable[[float], tuple[float, float]] | None = None
    turning: float = 0.0

    def hardest(self) -> Iterator[tuple[float, float]]:
        """Return the squared frequencies and the damping rates of the stiffest states of the approach.

        Raises
        ------
        ArithmeticError
            If the points attract each other without any repulsion.
        """
        way, forces = self.way, [self.push(r, 0.0) for r in self.way.tolist()]
        steps = np.concatenate([[0.0], -np.diff(way) * (np.array(forces[1:]) + forces[:-1]) / 2])
        work = np.cumsum(steps)
        energy = self.energy + max(0.0, float(np.interp(-self.begin, -way, work)))
        far = np.flatnonzero(~(work <= energy))
        if not far.size:
            if forces[-1] < 0:
                raise ArithmeticError("nothing keeps the points apart")
            closest = way
        else:
            end = int(far[0])
            part = (energy - work[end - 1]) / steps[end]
            closest = np.append(way[:end], way[end - 1] + part * (way[end] - way[end - 1]))
        found = [(*self._slopes(float(r)), float(r)) for r in closest]
        stiffness, damping, r = max(found)
        yield stiffness * self.inverse, damping * self.inverse
        if self.slide:
            stiffness, damping = self.slide(r)
            yield stiffness * self.turning, damping * self.turning

    def _slopes(self, r: float) -> tuple[float, float]:
        """Return the stiffness and the damping at a distance."""
        step, rate = _DIFFERENCE * abs(r), _DIFFERENCE * (self.speed or 1.0)
        stiffness = (self.push(r - step, 0.0) - self.push(r + step, 0.0)) / (2 * step)
        return stiffness, (self.push(r, rate) - self.push(r, -rate)) / (2 * rate)


class Encounters:
    """The possible collisions of the points of a scene."""

    def __init__(self, assembly: Assembly, placed: Sequence[Placed]) -> None:
        self._assembly, self._motions, cloud = assembly, moves(placed), assembly.cloud
        self._dimension, self._box = assembly.dimension, cloud.box
        self._masses = cloud.in_order(cloud.masses)
        self._inertia = cloud.in_order(cloud.inertia)

    @classmethod
    def of(cls, assembly: Assembly, placed: Sequence[Placed]) -> Encounters | None:
        """Return the encounters of a scene; None if nothing can collide, or points have no separate effective mass."""
        self = cls(assembly, placed)
        meets = bool(assembly.pair_forces or any(self._of_links()) or any(self._planes()))
        return self if meets and not assembly.cloud.bodies.vectors else None

    def __call__(self, t: float, u: np.ndarray, v: np.ndarray, span: float) -> tuple[np.ndarray, np.ndarray] | None:
        """Return the squared frequencies and the damping rates of the hardest collisions.

        None if two points attract each other without any repulsion.
        """
        shape, count = (self._dimension, -1), self._dimension * self._masses.size
        x, velocity = u[:count].reshape(shape).T, v[:count].reshape(shape).T
        speeds = np.linalg.norm(velocity, axis=1) + span * np.linalg.norm(self._pulls(t, x, velocity), axis=1)
        speeds += 2 * self._speed_of_walls(np.linspace(t, t + span, _TIMES).tolist())
        meetings = [*self._pairs(t, x, speeds), *self._pair_forces(t, x, speeds), *self._on_planes(t, x, speeds)]
        try:
            found = [one for meeting in meetings for one in meeting.hardest()]
        except ArithmeticError:
            return None
        k, c = np.array([one for one in found if one[0] > 0 and np.isfinite(one).all()]).reshape(-1, 2).T
        return k, c

    # Forces ---------------------------------------------------------------------------------------------------------

    def _of_links(self) -> Iterator[tuple[Group, list[Placed]]]:
        for group in self._assembly.links:
            laws = [
                law for law in group.laws if law.effect.cutoff_field and law.effect.functions().keys() & set(FORCES)
            ]
            if laws:
                yield group, laws

    def _planes(self) -> Iterator[tuple[Group, Placed]]:
        for group in self._assembly.on_masses:
            for law in group.laws:
                if law.effect.picture == "plane" and "force" in law.effect.functions():
                    yield group, law

    def _pulls(self, t: float, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        """The accelerations by the forces on single masses, without the forces of planes."""
        a, planes = np.zeros_like(x), [law for _, law in self._planes()]
        for group in self._assembly.on_masses:
            for law in (law for law in group.laws if law not in planes):
                for name in law.effect.functions().keys() & {"force", "acceleration"}:
                    for s, i in enumerate(group.first.tolist()):
                        m = float(self._masses[i])
                        given = {"t": t, "x": tuple(x[i].tolist()), "v": tuple(v[i].tolist()), "m": m}
                        a[i] += np.array(law.call(name, s, given)) / (m if name == "force" else 1.0)
        return a

    def _speed_of_walls(self, times: Sequence[float]) -> float:
        """The largest speed at some times with which a motion moves a fixed point."""
        return max(
            (
                float(np.linalg.norm(direction)) * max(abs(function(t, *given)[1]) for t in times)
                for function, given, direction, _ in self._motions
            ),
            default=0.0,
        )

    # Collisions -----------------------------------------------------------------------------------------------------

    def _pairs(self, t: float, x: np.ndarray, speeds: np.ndarray) -> Iterator[_Meeting]:
        """The links with a cutoff between given points."""
        energies, inverses = self._masses * speeds**2 / 2, 1 / self._masses
        for group, laws in self._of_links():
            other = group.anchor if group.second is None else x[group.second]
            r = self._distances(x[group.first], other)
            ends = [group.first] if group.second is None else [group.first, group.second]
            energy, speed, inverse = (sum(y[i] for i in ends).max() for y in (energies, speeds, inverses))
            crowd = min(int(np.bincount(np.concatenate(ends)).max()), self._dimension + 1)
            depth = max(float((law.columns[law.effect.cutoff_field] - r).max()) for law in laws)
            for s in _extremes(laws):
                yield _meeting(t, laws, s, depth, energy, speed, crowd * inverse)

    def _pair_forces(self, t: float, x: np.ndarray, speeds: np.ndarray) -> Iterator[_Meeting]:
        """The pair forces. Forces between the same points act together."""
        cloud, together = self._assembly.cloud, dict[Any, list[PairForce]]()
        for pair_force in self._assembly.pair_forces:
            together.setdefault((pair_force.first.tobytes(), pair_force.second.tobytes()), []).append(pair_force)
        of_masses = self._masses * speeds**2 / 2, speeds, 1 / self._masses
        energies, rates, inverses = (np.where(cloud.free < 0, 0.0, np.append(y, 0.0)[cloud.free]) for y in of_masses)
        for pair_forces in together.values():
            first, second = pair_forces[0].first, pair_forces[0].second
            groups = (first, second) if second.size else (first,)

            def of_two(values: np.ndarray, groups: tuple = groups) -> float:
                if len(groups) == 1:
                    return float(np.sort(values[groups[0]])[-2:].sum())
                return float(sum(values[group].max() for group in groups))

            most = first.size - 1 if len(groups) == 1 else max(first.size, second.size)
            inverse = min(most, self._dimension + 1) * of_two(inverses)
            depth = max(self._depth(pair_force, x) for pair_force in pair_forces)
            one, other = _couples(pair_forces)
            laws = [pair_force.between(one, other) for pair_force in pair_forces]
            for s in range(one.size):
                meeting = _meeting(t, laws, s, depth, of_two(energies), of_two(rates), inverse)
                yield self._rolling(meeting, t, laws[0], s, of_two(inverses), bool(second.size))

    def _rolling(self, meeting: _Meeting, t: float, law: Placed, s: int, inverse: float, has_groups: bool) -> _Meeting:
        """Return a collision of grains, which have a radius, a mass, and tangential springs."""
        if not isinstance(law.effect, FrictionalContact):
            return meeting
        reach = float(law.value("contact_distance", s))
        arms = [reach / 2] * 2
        if has_groups:
            near = float(law.columns["wall_radius"][0])
            arms = [reach - near, near]
        given = {"t": t, "rate": 0.0, "radius": arms[0] * arms[1] / reach, "mass": 1 / inverse}
        of_spin = 1 / self._inertia[self._inertia > 0].min() if self._inertia.any() else 0.0
        turns = sum(arm * arm for arm in arms[: 1 if has_groups else 2]) * of_spin
        names = [name for name in ("shear_stiffness", "shear_damping") if name in law.effect.functions()]

        def slide(r: float) -> tuple[float, float]:
            stiffness, *damping = (law.call(name, s, given | {"r": r}) for name in names)
            return stiffness, *(damping or [0.0])

        def push(r: float, rate: float) -> float:
            return -law.call("tension", s, given | {"r": r, "rate": -rate})

        crowd = meeting.inverse / inverse
        return replace(meeting, push=push, slide=slide, turning=crowd * (inverse + turns))

    def _depth(self, pair_force: PairForce, x: np.ndarray) -> float:
        """The largest overlap of two points, as a depth within their cutoff, at the start."""
        bonded = bonded_pairs(self._assembly.bonds, pair_force.exclude_bonded)
        ends, cutoffs = near_pairs(pair_force, self._assembly.cloud, x.T.ravel(), bonded)
        return float((cutoffs - self._distances(*ends)).max(initial=0.0))

    def _on_planes(self, t: float, x: np.ndarray, speeds: np.ndarray) -> Iterator[_Meeting]:
        energies = self._masses * speeds**2 / 2
        decades = math.log10(_DEPTHS[1] / _DEPTHS[0])
        way = -np.geomspace(*_DEPTHS, round(_IN_A_DECADE * decades))
        for group, law in self._planes():
            i, normals, offsets = group.first, law.columns["normal"], law.columns["offset"]
            depth = float((offsets - np.einsum("ij,ij->i", normals, x[i])).max())
            for s in _extremes([law]):
                normal, offset, m = normals[s], float(offsets[s]), float(self._masses[i[s]])

                def push(r: float, rate: float, law=law, s=s, normal=normal, offset=offset, m=m) -> float:  # type: ignore[no-untyped-def]
                    at = {"x": tuple(((offset + r) * normal).tolist()), "v": tuple((-rate * normal).tolist())}
                    return float(np.dot(law.call("force", s, {"t": t, "m": m, **at}), normal))

                inverse = 1 / float(self._masses[i].min())
                yield _Meeting(push, way, -depth, energies[i].max(), speeds[i].max(), inverse)

    def _distances(self, x: Any, y: Any) -> np.ndarray:
        """The distances of points from the nearest images of others."""
        d, has_box = x - y, self._box > 0
        d[:, has_box] -= self._box[has_box] * np.rint(d[:, has_box] / self._box[has_box])
        return np.linalg.norm(d, axis=1)


def _meeting(
    t: float, laws: Sequence[Placed], s: int, depth: float, energy: float, speed: float, inverse: float
) -> _Meeting:
    """Return the collision of two points by laws with a cutoff; `depth` is their depth within it at the start."""
    reach = max(float(law.value(law.effect.cutoff_field, s)) for law in laws)
    decades = [math.log10(_HALF / part) for part in (_LEAST, _CLOSEST)]
    far, near = (round(_IN_A_DECADE * d) for d in decades)
    way = np.append(1 - np.geomspace(_LEAST, _HALF, far), np.geomspace(_HALF, _CLOSEST, near)[1:]) * reach

    def push(r: float, rate: float) -> float:
        at = {"t": t, "r": r, "rate": -rate}
        total = 0.0
        for law in laws:
            functions = law.effect.functions()
            total -= law.call("tension", s, at) if "tension" in functions else 0.0
            total -= r * law.call("force_density", s, at) if "force_density" in functions else 0.0
        return total

    return _Meeting(push, way, reach - depth, energy, speed, inverse)


def _extremes(laws: Sequence[Placed]) -> list[int]:
    """Return members with the least and the largest value of each field."""
    found = {0}
    for law in laws:
        for values in (column for name, column in law.columns.items() if name not in law.effect.arrays):
            for one in values.reshape(len(values), -1).T:
                found |= {int(one.argmin()), int(one.argmax())}
    return sorted(found)


def _couples(pair_forces: Sequence[PairForce]) -> np.ndarray:
    """Return two rows of members, with equal extreme values, and if values are multiplied, also with different ones."""
    members = _extremes(pair_forces)
    has_products = any("product" in pair_force.effect.mixing_rules().values() for pair_force in pair_forces)
    others = list(combinations(members, 2)) if has_products else []
    return np.array([*((s, s) for s in members), *others]).T
