"""Meshes of points and cells, and their groups, as meshio reads them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .libraries import library

_SOLID, _SHEET = "tetra", "triangle"
_BELOW = ("vertex", "line", _SHEET)  # cells that only mark parts of a mesh


@dataclass(frozen=True, eq=False)
class MeshTable:
    """The content of a file with a mesh.

    Attributes
    ----------
    positions : ndarray, shape (points, 3)
        Of the points of the cells.
    cells : ndarray of int, shape (cells, 3 or 4)
        The tetrahedra; without tetrahedra, the triangles.
    groups : dict of str to ndarray of int
        The numbers of the points of each group of cells or points.
    cell_groups : dict of str to ndarray of int
        The numbers of the cells of each group.
    """

    positions: np.ndarray
    cells: np.ndarray
    groups: dict[str, np.ndarray]
    cell_groups: dict[str, np.ndarray]


def read_mesh(path: Path) -> MeshTable:
    """Read a mesh of tetrahedra or triangles. Points without cells, such as the centres of circles, are left out."""
    meshio = library("meshio", path.suffix)
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}.")
    try:
        mesh = meshio.read(path)
    except Exception as error:  # many kinds, from meshio, NumPy and XML
        raise ValueError(
            f"{path} is not a mesh that meshio reads ({error}), no data file of LAMMPS (.data, .lmp), no "
            "atoms (.xyz, .extxyz, .pdb) and no mechanism (.xml); trajectories such as .dump and .dcd are only written."
        ) from error
    kinds = [block.type for block in mesh.cells]
    kind = _SOLID if _SOLID in kinds else _SHEET
    unknown = [name for name in kinds if name not in (*_BELOW, _SOLID)]
    if unknown or kind not in kinds:
        found = unknown[0] if unknown else "no cells with an area or a volume"
        raise ValueError(f"{path} must have tetrahedra or triangles of 4 or 3 points, but it has {found}.")
    blocks = [k for k, name in enumerate(kinds) if name == kind]
    cells = np.concatenate([mesh.cells[k].data for k in blocks]).astype(np.int64)
    used, ends = np.unique(cells, return_inverse=True)
    number = np.full(len(mesh.points), -1)
    number[used] = np.arange(len(used))
    first = dict(zip(blocks, np.cumsum([0, *(len(mesh.cells[k].data) for k in blocks)]).tolist(), strict=False))
    groups: dict[str, list[np.ndarray]] = {name: [points] for name, points in mesh.point_sets.items()}
    cell_groups: dict[str, list[np.ndarray]] = {}
    for name, parts in _cell_sets(mesh).items():
        for k, part in enumerate(parts):
            rows = np.asarray(part, dtype=np.int64)
            groups.setdefault(name, []).append(mesh.cells[k].data[rows].ravel())
            if k in first and rows.size:
                cell_groups.setdefault(name, []).append(first[k] + rows)
    return MeshTable(
        positions=np.pad(mesh.points[used], ((0, 0), (0, 3 - mesh.points.shape[1]))),
        cells=ends.reshape(cells.shape),
        groups={name: _kept(number, parts) for name, parts in groups.items()},
        cell_groups={name: np.concatenate(parts) for name, parts in cell_groups.items()},
    )


def _kept(number: np.ndarray, parts: list[np.ndarray]) -> np.ndarray:
    """Return the new numbers of the points that are kept."""
    found = number[np.unique(np.concatenate(parts).astype(np.int64))]
    return found[found >= 0]


def _cell_sets(mesh: Any) -> dict[str, list[Any]]:
    """Return the cells of each group in each block: sets of cells, or the physical groups of Gmsh by name or tag."""
    sets = {name: parts for name, parts in mesh.cell_sets.items() if not name.startswith("gmsh:")}
    tags = mesh.cell_data.get("gmsh:physical", [])
    names = {(int(tag), int(dimension)): name for name, (tag, dimension) in mesh.field_data.items()}
    for k, (block, of_cells) in enumerate(zip(mesh.cells, tags, strict=False)):
        for tag in np.unique(of_cells).tolist():
            name = names.get((int(tag), block.dim), str(tag))
            parts = sets.setdefault(name, [[] for _ in mesh.cells])
            parts[k] = np.flatnonzero(np.asarray(of_cells) == tag)
    return sets
