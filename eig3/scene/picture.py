"""The geometry of a scene, and its picture in an animation: points, links, faces, supports and planes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..animation import Mechanism, Solid, triangles
from ..animation.shapes import unit_faces
from ..geometry import Geometry
from .assembly import STATE, Bodies, Cloud
from .cell import Cell
from .constraint import Constraint
from .effect import Body, Link
from .force_chains import ForceChains
from .mesh import surface
from .pair_force import PairForce
from .placed import Placed, moves

_TRAILS = 3  # masses of a scene with trails, at most
_PLANES = 20  # planes of effects that are drawn, at most
_ROUND_OFF = 1e-12  # the relative error of radii, and of the offsets of planes that are the same


@dataclass(frozen=True, eq=False)
class Places:
    """The positions of all points of a scene: ``places(t, u)``.

    Attributes
    ----------
    positions : ndarray, shape (points, dimension)
        At the start.
    free : ndarray of int, shape (points,)
        The index of each point among the masses; -1 for fixed points.
    upright : bool
        Whether a one-dimensional scene is drawn vertically.
    bodies : Bodies
        The points of rigid bodies. Points that represent vectors are drawn at the first other point.
    moves : list of (function, arguments, direction, points)
        The motions of supports: ``function(t, *arguments)`` returns the displacement along the direction, and its rate.
    angles : int
        The number of angles of a mass; 0 if no mass spins.
    corners : list of (parts, factors)
        The points and factors of further points, which follow the points of the scene and show the shapes of bodies.
    """

    positions: np.ndarray
    free: np.ndarray
    upright: bool = False
    bodies: Bodies = field(default_factory=Bodies.none)
    moves: list[tuple[Any, tuple, np.ndarray, np.ndarray]] = field(default_factory=list)
    angles: int = 0
    corners: list[tuple[np.ndarray, np.ndarray]] = field(default_factory=list)

    def __call__(self, t: np.ndarray, u: np.ndarray) -> np.ndarray:
        x = self.points(t, u)
        corners = [np.einsum("p,tpk->tk", factors, x[:, parts]) for parts, factors in self.corners]
        others = np.setdiff1d(np.arange(len(self.free)), self.bodies.vectors)
        x[:, self.bodies.vectors] = x[:, others[:1]]
        return np.concatenate([x, np.stack(corners, axis=1)], axis=1) if corners else x

    def points(self, t: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Return the positions of all points, with the components of vectors."""
        return self._all(t, u, 0)

    def velocities(self, t: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the velocities of all points, with the rates of vectors."""
        return self._all(t, v, 1)

    def spins(self, v: np.ndarray) -> np.ndarray:
        """Return the angular velocities of all points; 0 for fixed points."""
        is_mass, angles = self.free >= 0, self.positions.shape[1] + np.arange(self.angles)
        values = v[:, np.where(is_mass, self.free, 0)[:, None] + np.count_nonzero(is_mass) * angles]
        values[:, ~is_mass] = 0.0
        return values

    def of(self, numbers: np.ndarray, given: np.ndarray, t: Any, rate: int) -> np.ndarray:
        """Return the positions of some points in states of any shape, or with rate = 1 their velocities.

        `given` has the displacements or the velocities, and t the times of the states, for points that a motion moves.
        """
        is_own = self.free >= 0
        is_own[list(self.bodies.carried)] = False
        free, axes = np.where(is_own, self.free, 0), np.count_nonzero(is_own) * np.arange(self.positions.shape[1])
        found = given[..., free[numbers, None] + axes]
        is_fixed = self.free[numbers] < 0
        found[..., is_fixed, :] = 0.0 if rate else self.positions[numbers[is_fixed]]
        for k, number in enumerate(numbers.tolist()):
            if number in self.bodies.carried:
                parts, factors = self.bodies.carried[number]
                found[..., k, :] = np.einsum("p,...pk->...k", factors, given[..., free[parts, None] + axes])
        for function, arguments_of, direction, some in self.moves if is_fixed.any() else ():
            is_moved = np.isin(numbers, some)
            if is_moved.any():
                way = np.reshape([function(float(time), *arguments_of)[rate] for time in np.ravel(t)], np.shape(t))
                found[..., is_moved, :] += way[..., None, None] * direction
        return found

    def _all(self, t: np.ndarray, given: np.ndarray, rate: int) -> np.ndarray:
        return _in_picture(self.of(np.arange(len(self.free)), given, t, rate), self.upright)


def _in_picture(x: np.ndarray, upright: bool) -> np.ndarray:
    """Return vectors in the dimensions of the picture, which has two for a scene of one."""
    if x.shape[-1] > 1:
        return x
    across = np.zeros_like(x)
    return np.concatenate([across, x] if upright else [x, across], axis=-1)


def geometry_and_view(
    cloud: Cloud, placed: Sequence[Placed], pair_forces: Sequence[PairForce] = ()
) -> tuple[Geometry, Mechanism]:
    """Return the geometry of a scene, and the view that draws it.

    Parameters
    ----------
    cloud : Cloud
    placed : sequence of Placed
        Effects whose columns include the numbers of their states.
    """
    dimension, masses = cloud.positions.shape[1], cloud.material
    radii = _radii(cloud, placed, pair_forces)
    upright = dimension == 1 and any(law.effect.picture == "weight" for law in placed)
    links, strings = _links(cloud, placed)
    cells = _cells(placed)
    faces = np.concatenate([np.empty((0, 3), dtype=np.int64), *(surface(kind) for kind in cells)])
    bodies = _bodies(cloud)
    corners, solids = _solids(cloud, bodies)
    not_drawn = [*cloud.bodies.vectors, *range(len(radii), len(radii) + len(corners))]
    hidden = np.unique(np.concatenate([faces.ravel(), *(kind.ravel() for kind in cells), not_drawn])).astype(int)
    inside = set(hidden.tolist())
    order = list(links)
    drawn = [k for k, ends in enumerate(order) if not inside.issuperset(ends)]
    places = Places(cloud.positions, cloud.free, upright, cloud.bodies, moves(placed), cloud.spins.shape[1], corners)
    geometry = Geometry(
        places=places.points,
        velocities=places.velocities,
        spins=places.spins if places.angles else None,
        links=np.array(order, dtype=int).reshape(-1, 2),
        strings={k: strings[ends] for k, ends in enumerate(order) if links[ends] == "string"},
        cells=cells,
        bodies=bodies,
        surfaces=_surfaces(cloud, bodies),
        vectors=cloud.bodies.vectors,
        fixed=np.flatnonzero(cloud.free < 0),
        masses=np.where(cloud.is_carried, 0.0, cloud.masses),
        radii=radii,
        contacts=ForceChains.of(cloud, placed, pair_forces) if dimension > 1 else None,
        box=tuple(_in_picture(cloud.box, upright).tolist()) if cloud.box.any() else (),
        shear=cloud.shear,
    )
    shown = {
        "places": places,
        "links": geometry.links[drawn],
        "strings": {k: geometry.strings[number] for k, number in enumerate(drawn) if number in geometry.strings},
        "radii": np.append(radii, np.zeros(len(corners))),
    }
    view = Mechanism(
        **(vars(geometry) | shown),
        springs=[k for k, number in enumerate(drawn) if links[order[number]] == "spring"],
        faces=faces,
        hidden=hidden,
        trails=masses if dimension > 1 and masses.size <= _TRAILS else (),
        planes=_planes(placed, radii, masses, upright),
        labels=(("", "x (m)") if upright else ("x (m)", "")) if dimension == 1 else ("x (m)", "y (m)", "z (m)"),
        solids=solids,
    )
    return geometry, view


def _links(cloud: Cloud, placed: Sequence[Placed]) -> tuple[dict[tuple[int, int], str], dict[tuple[int, int], int]]:
    """Return the picture of each link by its ends, and the degree of freedom that says whether a string is broken."""
    links: dict[tuple[int, int], str] = {}
    strings: dict[tuple[int, int], int] = {}
    first_state = (cloud.positions.shape[1] + cloud.spins.shape[1]) * np.count_nonzero(cloud.is_own)
    for law in placed:
        picture = law.effect.picture
        if isinstance(law.effect, Link | Constraint) and picture not in ("", "discs") and len(law.points) == 2:
            for k, ends in enumerate(zip(*(x.tolist() for x in law.points), strict=True)):
                if links.get(ends) != "spring":
                    links[ends] = picture
                if picture == "string":
                    strings[ends] = first_state + int(law.columns[STATE][k])
    for point, (parts, _) in cloud.bodies.carried.items():
        if point not in cloud.bodies.vectors:
            links.setdefault((int(parts[0]), point), "line")
    return links, strings


def _solids(cloud: Cloud, bodies: np.ndarray) -> tuple[list[tuple[np.ndarray, np.ndarray]], list[Solid]]:
    """Return points on the surfaces of bodies, and their shapes: given ones, or boxes with the inertias of the bodies.

    A box of the mass m with the sides a_k has the moments J_k = m a_k^2 / 12. In the plane, a body with further points
    has no box, because its inertia does not say how slender it is: its lines show it better.
    """
    held = {int(parts[0]) for parts, _ in cloud.bodies.carried.values()} if cloud.positions.shape[1] == 2 else set()
    corners: list[tuple[np.ndarray, np.ndarray]] = []
    solids = []
    for centre, *vectors in bodies.tolist():
        if centre in held and centre not in cloud.bodies.shapes:
            continue
        half = np.sqrt(3 * cloud.masses[vectors] / cloud.masses[centre])
        plain = [("box", np.zeros(len(vectors)), np.diag(half))]
        for kind, middle, axes in cloud.bodies.shapes.get(centre, plain):
            parts = np.array([centre, *vectors])
            first = centre
            if middle.any():
                first = len(cloud.masses) + len(corners)
                corners.append((parts, np.array([1.0, *middle])))
            numbers = len(cloud.masses) + len(corners) + np.arange(len(vectors))
            corners += [(parts, np.array([1.0, *factors])) for factors in middle + axes]
            solids.append(Solid(kind, (first, *numbers.tolist()), centre in cloud.bodies.shapes))
    return corners, solids


def _cells(placed: Sequence[Placed]) -> list[np.ndarray]:
    """Return the cells of sheets and solids, with one array for each number of corners."""
    meshes = [
        np.column_stack(law.points)
        for law in placed
        if isinstance(law.effect, Cell) and law.effect.picture == "surface"
    ]
    sizes = {cells.shape[1] for cells in meshes}
    return [np.concatenate([cells for cells in meshes if cells.shape[1] == size]) for size in sizes]


def _bodies(cloud: Cloud) -> np.ndarray:
    """Return the numbers of the centre and of the vectors of each rigid body."""
    dimension, numbers = cloud.positions.shape[1], cloud.bodies.numbers
    order = sorted(numbers, key=lambda point: (numbers[point], point in cloud.bodies.vectors, point))
    return np.array(order, dtype=int).reshape(-1, 1 + dimension)


def _surfaces(cloud: Cloud, bodies: np.ndarray) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """Return the corners and triangles of the shapes that are given, by the row of the body: see `Geometry`."""
    found = {}
    for row, centre in enumerate(bodies[:, 0].tolist()):
        corners: list[np.ndarray] = []
        faces: list[np.ndarray] = []
        for kind, middle, axes in cloud.bodies.shapes.get(centre, ()):
            places = unit_faces(kind, axes) @ axes + middle
            flat = places.reshape(-1, places.shape[-1])
            unit = _ROUND_OFF * 1e3 * np.abs(flat).max()
            _, first, number = np.unique(np.round(flat / unit), axis=0, return_index=True, return_inverse=True)
            some = triangles(number.reshape(places.shape[:2]))
            some = some[(some != np.roll(some, 1, axis=1)).all(axis=1)]  # others are flat, at the poles of round shapes
            a, b, c = np.moveaxis(flat[first][some] - middle, 1, 0)
            if len(middle) == 3:
                is_inward = np.einsum("fk,fk->f", np.cross(a, b), c) < 0
                some[is_inward] = some[is_inward, ::-1]
            faces.append(some + sum(len(places) for places in corners))
            corners.append(flat[first])
        if corners:
            found[row] = np.concatenate(corners), np.concatenate(faces)
    return found


def _radii(cloud: Cloud, placed: Sequence[Placed], pair_forces: Sequence[PairForce]) -> np.ndarray:
    """Return the radius of each point: two points touch at their contact distance; 0 without a contact.

    If the radii are not unique, as for two balls, they have the least sum of squares, which makes them equal.
    Conjugate gradients find the least-squares solution of ``r[i] + r[j] = reach`` with the least norm, without a
    matrix. SciPy's `lsqr` is not used, because scenes need no SciPy.
    """
    given = [
        (*law.points, law.columns["contact_distance"])
        for law in placed
        if isinstance(law.effect, Link) and law.effect.picture == "discs"
    ]
    count = cloud.masses.size
    radii = np.zeros(count)
    for pair_force in pair_forces:
        if pair_force.effect.picture == "discs" and not pair_force.second.size:
            radii[pair_force.first] = pair_force.columns["contact_distance"] / 2
    for pair_force in pair_forces:
        if pair_force.effect.picture == "discs" and pair_force.second.size:
            _add_radii_of_two_groups(radii, pair_force)
    if not given:
        return radii
    of_pair_forces, radii = radii, np.zeros(count)
    i, j, reach = (np.concatenate(parts) for parts in zip(*given, strict=True))
    i, j, reach = (values[reach > 0] for values in (i, j, reach))  # a distance of 0 gives no radii

    def at_points(pairs: np.ndarray) -> np.ndarray:
        return np.bincount(i, pairs, count) + np.bincount(j, pairs, count)

    residual = at_points(reach)
    way, square = residual, residual @ residual
    least = _ROUND_OFF**2 * square
    for _ in range(count):
        if square <= least:
            break
        change = at_points(way[i] + way[j])
        step = square / (way @ change)
        radii, residual = radii + step * way, residual - step * change
        before, square = square, residual @ residual
        way = residual + square / before * way
    return np.where(of_pair_forces > 0, of_pair_forces, np.maximum(radii, 0.0))


def _add_radii_of_two_groups(radii: np.ndarray, pair_force: PairForce) -> None:
    """Add the radii of points in contacts between two groups, where they are not known.

    Without a radius of walls, the points of the second group have what the largest of the first leaves.
    """
    first, second, reach = *pair_force.points, pair_force.columns["contact_distance"]
    wall = getattr(pair_force.effect, "wall_radius", None)
    radii[first] = np.where(radii[first] > 0, radii[first], reach / 2 if wall is None else reach - wall)
    of_second = max(0.0, np.min(reach - radii[first])) if wall is None else wall
    radii[second] = np.where(radii[second] > 0, radii[second], of_second)


def _planes(
    placed: Sequence[Placed], radii: np.ndarray, masses: np.ndarray, upright: bool
) -> list[tuple[tuple, float]]:
    """Return the distinct planes of effects, in the dimensions of the picture. A mass with a radius touches a plane."""
    planes: dict[tuple, tuple[tuple, float]] = {}
    for law in placed:
        if isinstance(law.effect, Body) and law.effect.picture == "plane":
            radius = radii[law.points[0] if law.points else masses]
            unit = _ROUND_OFF * (np.abs(law.columns["offset"]) + radius).max() or 1.0
            for normal, offset in zip(law.columns["normal"], law.columns["offset"] - radius, strict=True):
                along = tuple(_in_picture(normal, upright).tolist())
                planes.setdefault((along, round(offset / unit)), (along, float(offset)))
    return list(planes.values())[:_PLANES]
