"""The points and cells of one state, as files of ParaView have them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .trajectory import Snapshot, Trajectory, wrapped

_OF_BODIES = {3: "triangle", 4: "quad", 8: "hexahedron"}  # by the number of corners
_OF_CELLS = {3: "triangle", 4: "tetra"}


@dataclass(frozen=True, eq=False)
class MeshParts:
    """One state as points with data, and cells.

    Attributes
    ----------
    points : ndarray, shape (points, 3)
        The corners of rigid bodies follow the points of the trajectory.
    cells : list of (str, ndarray of int, shape (cells, corners))
        With the names of meshio: single points, links, triangles, tetrahedra and the surfaces or boxes of bodies.
    data : dict of str to ndarray, shape (points, 3)
        The data that change.
    cell_data : dict of str to list of ndarray, shape (cells,)
        The normal force of contacts, and 0 for other cells, by the elements of `cells`.
    """

    points: np.ndarray
    cells: list[tuple[str, np.ndarray]]
    data: dict[str, np.ndarray]
    cell_data: dict[str, list[np.ndarray]]


class Cells:
    """The cells of a trajectory, which are the same in all states, except for links that break or leave the box.

    `constant` has the data that are the same in all states, shape (points,).
    """

    def __init__(self, trajectory: Trajectory, types: np.ndarray) -> None:
        self._trajectory = trajectory
        self._start = trajectory.at(0)
        self._extra = len(self._start.corners)
        numbers = np.unique(types, return_inverse=True)[1] + 1 if types.dtype.kind == "U" else types
        columns = {"mass": trajectory.masses, "radius": trajectory.radii, "type": numbers}
        columns["id"] = np.arange(1, trajectory.count + 1)
        self.constant = {name: self._extended(column) for name, column in columns.items() if column is not None}
        found = [(_OF_CELLS[cells.shape[1]], cells) for cells in trajectory.cells]
        found += [(_OF_BODIES[cells.shape[1]], trajectory.count + cells) for cells in trajectory.solids]
        used = np.concatenate([trajectory.links.ravel(), *(cells.ravel() for cells in trajectory.cells)])
        single = np.setdiff1d(np.arange(trajectory.count), used)
        self._fixed = [("vertex", single[:, None])] * bool(single.size) + found

    def of(self, snapshot: Snapshot) -> MeshParts:
        """Return the points, cells and data of a state."""
        trajectory = self._trajectory
        x, images = wrapped(snapshot.x, snapshot.lattice, trajectory.periodic)
        cells = [(kind, some[self._is_inside(some, images)]) for kind, some in self._fixed]
        links = trajectory.links[snapshot.whole & self._is_inside(trajectory.links, images)]
        cells += [("line", links)] * bool(links.size)
        cells = [(kind, some) for kind, some in cells if some.size]
        points, cell_data = np.concatenate([x, snapshot.corners]), {}
        if contacts := trajectory.contacts(snapshot.row):
            pairs, forces = contacts
            cell_data["normal_force"] = [np.zeros(len(some)) for _, some in cells] + [forces] * bool(forces.size)
            cells += [("line", pairs)] * bool(forces.size)
        return MeshParts(points, cells, self._data(snapshot), cell_data)

    def _is_inside(self, cells: np.ndarray, images: np.ndarray) -> np.ndarray:
        """Whether all corners of each cell are in the same image of the box. Bodies are in no box."""
        if not self._trajectory.periodic.any():
            return np.ones(len(cells), dtype=bool)
        of_corners = images[cells]
        return (of_corners == of_corners[:, :1]).all(axis=(1, 2))

    def _data(self, snapshot: Snapshot) -> dict[str, np.ndarray]:
        start = self._start
        moved = snapshot.x - start.x, snapshot.corners - start.corners
        known = {"velocity": (snapshot.v, snapshot.corner_v), "displacement": moved}
        data = {
            name: np.concatenate([values, of_corners])
            for name, (values, of_corners) in known.items()
            if values is not None
        }
        return data if snapshot.spin is None else data | {"angular_velocity": self._extended(snapshot.spin)}

    def _extended(self, column: np.ndarray) -> np.ndarray:
        """Return a column with 0 at the corners of bodies."""
        return np.concatenate([column, np.zeros((self._extra, *column.shape[1:]), dtype=column.dtype)])
