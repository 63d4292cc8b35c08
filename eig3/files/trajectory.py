"""The rows of a solution as positions in space, which are read one at a time."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..geometry import Geometry


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The state of all points at one saved time. Vectors have three components.

    Attributes
    ----------
    row : int
        Of the solution.
    t : float
    step : int
        The number of the step; with tolerances, or with two states in a step, the number of the row.
    x : ndarray, shape (points, 3)
    v, spin : ndarray, shape (points, 3), or None
        Velocities and angular velocities, if they are known.
    corners, corner_v : ndarray, shape (corners, 3)
        The corners of rigid bodies, and their velocities.
    whole : ndarray of bool, shape (links,)
        Whether each link is unbroken.
    lattice : ndarray, shape (3, 3)
        The edges of the periodic box as rows, with unit vectors along axes that are not periodic.
    """

    row: int
    t: float
    step: int
    x: np.ndarray
    v: np.ndarray | None
    spin: np.ndarray | None
    corners: np.ndarray
    corner_v: np.ndarray
    whole: np.ndarray
    lattice: np.ndarray


class Trajectory:
    """The saved states of a run, for the writers of files, with all lengths times `scale`.

    Iteration reads one row of the solution at a time, so that a run in files may be larger than memory. With `every`,
    it takes every so many of the saved states. The points that represent vectors of rigid bodies are left out.

    `masses` and `radii` are known or None, and `links` and `cells` have the numbers of the points that are left.
    `solids` are the corners, shape (cells, corners), of the triangles of given shapes and of the boxes of other bodies.
    """

    def __init__(self, geometry: Geometry, solution: Any, scale: float = 1.0, every: int = 1) -> None:
        self._geometry, self._solution, self._scale, self._every = geometry, solution, scale, every
        x = self._of_row(geometry.places, 0, "u")
        self._material = np.setdiff1d(np.arange(len(x)), geometry.vectors)
        self._number = number = np.full(len(x), -1)
        number[self._material] = np.arange(len(self._material))
        self.count = len(self._material)
        self.links = number[np.asarray(geometry.links, dtype=int).reshape(-1, 2)]
        self.cells = [number[cells] for cells in geometry.cells]
        self.is_fixed = np.isin(self._material, geometry.fixed)
        self.masses, self.radii = self._column(geometry.masses), self._column(geometry.radii)
        self.radii = None if self.radii is None else scale * self.radii
        self._sides = np.zeros(3)
        self._sides[: len(geometry.box)] = scale * np.asarray(geometry.box, dtype=float)
        self.periodic = self._sides > 0
        self._bodies = np.asarray(geometry.bodies, dtype=int)
        self._rows, self._factors, self.solids = self._shapes()

    def __len__(self) -> int:
        return len(range(0, len(self._solution.t), self._every))

    def __iter__(self) -> Iterator[Snapshot]:
        for row in range(0, len(self._solution.t), self._every):
            yield self.at(row)

    @property
    def times(self) -> np.ndarray:
        return np.asarray(self._solution.t[:: self._every])

    def at(self, row: int) -> Snapshot:
        """Return the state in a row of the solution."""
        geometry, solution, scale = self._geometry, self._solution, self._scale
        t = float(solution.t[row])
        x = scale * self._of_row(geometry.places, row, "u")
        v = None if geometry.velocities is None else scale * self._of_row(geometry.velocities, row, "v")
        spin = None
        if geometry.spins is not None:
            of_points = geometry.spins(np.reshape(solution.v[row], (1, -1)))[0]
            spin = np.zeros((len(of_points), 3))
            spin[:, -of_points.shape[1] :] = of_points  # in the plane about z
        return Snapshot(
            row=row,
            t=t,
            step=int(self._steps[row]),
            x=x[self._material],
            v=None if v is None else v[self._material],
            spin=None if spin is None else spin[self._material],
            corners=self._corners(x),
            corner_v=self._corners(np.zeros_like(x) if v is None else v),
            whole=self._whole(row),
            lattice=self._lattice(t),
        )

    @functools.cached_property
    def _steps(self) -> np.ndarray:
        """The number of each row, which are different: readers may drop a second state with the same number."""
        t = np.asarray(self._solution.t)
        steps = np.rint((t - t[0]) / self._solution.h).astype(int)
        is_step = self._solution.steps is None and (np.diff(steps) > 0).all()
        return steps if is_step else np.arange(len(t))

    def contacts(self, row: int) -> tuple[np.ndarray, np.ndarray] | None:
        """Return the pairs of points that push each other, and their normal forces, N; None without contacts."""
        geometry, t = self._geometry, float(self._solution.t[row])
        if geometry.contacts is None:
            return None
        assert geometry.velocities is not None
        x, v = self._of_row(geometry.places, row, "u"), self._of_row(geometry.velocities, row, "v")
        inside, _ = wrapped(x, self._lattice(t) / self._scale, self.periodic)
        pairs, forces = geometry.contacts(t, inside, v)
        return self._number[pairs], forces

    def _of_row(self, function: Any, row: int, letter: str) -> np.ndarray:
        """Return positions or velocities of all points, shape (points, 3)."""
        values = np.reshape(getattr(self._solution, letter)[row], (1, -1))
        found = np.asarray(function(np.array([self._solution.t[row]], dtype=float), values))[0]
        return np.pad(found, ((0, 0), (0, 3 - found.shape[1])))

    def _column(self, values: Any) -> np.ndarray | None:
        return np.asarray(values, dtype=float)[self._material] if np.any(values) else None

    def _shapes(self) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
        """Return the body of each corner, its factors of the vectors of the body, and the cells between corners.

        A body without a given shape is a box with its mass and inertia: a box of mass m and side a has the integral of
        x^2 over its mass m a^2 / 12.
        """
        kinds = self._bodies.shape[1] - 1 if self._bodies.size else 0
        masses, given = np.asarray(self._geometry.masses, dtype=float), dict(self._geometry.surfaces)
        around = [(-1, -1), (1, -1), (1, 1), (-1, 1)]  # the order of the corners in a quadrilateral or hexahedron
        signs = np.array(around if kinds == 2 else [(*s, z) for z in (-1, 1) for s in around])
        rows: list[int] = []
        factors, cells = [np.empty((0, kinds))], []
        for row, (centre, *vectors) in enumerate(self._bodies.tolist()):
            half = np.sqrt(3 * masses[vectors] / masses[centre])
            corners, some = given.get(row, (signs * half, np.arange(len(signs))[None]))
            cells.append(some + len(rows))
            rows += [row] * len(corners)
            factors.append(corners)
        sizes = sorted({some.shape[1] for some in cells})
        joined = [np.concatenate([some for some in cells if some.shape[1] == size]) for size in sizes]
        return np.array(rows, dtype=int), np.concatenate(factors), joined

    def _corners(self, x: np.ndarray) -> np.ndarray:
        if not self._rows.size:
            return np.empty((0, 3))
        of = self._bodies[self._rows]
        # x is scaled, and so are the unit vectors in it; the factors are not
        return x[of[:, 0]] + np.einsum("nk,nkd->nd", self._factors, x[of[:, 1:]])

    def _whole(self, row: int) -> np.ndarray:
        whole = np.ones(len(self.links), dtype=bool)
        for number, degree in dict(self._geometry.strings).items():
            whole[number] = self._solution.u[row, degree] == 0
        return whole

    def _lattice(self, t: float) -> np.ndarray:
        edges = np.diag(np.where(self.periodic, self._sides, 1.0))
        if self._geometry.shear:
            shift = self._geometry.shear * self._sides[1] * t
            edges[1, 0] = shift - self._sides[0] * round(shift / self._sides[0])
        return edges


def wrapped(x: np.ndarray, lattice: np.ndarray, periodic: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the images of points inside the box, and how many edges of the box they were moved, shape (points, 3)."""
    images = np.where(periodic, np.floor(x @ np.linalg.inv(lattice)), 0.0)
    return x - images @ lattice, images.astype(np.int64)


def bounds(snapshot: Snapshot, periodic: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return two corners of the box: along axes that are not periodic, of the least box around the points."""
    low, high = snapshot.x.min(axis=0), snapshot.x.max(axis=0)
    flat = high == low
    low, high = np.where(flat, low - 0.5, low), np.where(flat, high + 0.5, high)
    return np.where(periodic, 0.0, low), np.where(periodic, np.diag(snapshot.lattice), high)
