"""Scenes from files of atoms, meshes and mechanisms."""

from __future__ import annotations

import importlib
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..files.atoms import AtomTable, read_with_ase
from ..files.lammps_data import read_lammps_data
from ..files.meshes import MeshTable, read_mesh
from .description import Description, Points

_WITH_ASE = (".xyz", ".extxyz", ".pdb")
_LAMMPS = (".data", ".lmp", ".lammps")


@dataclass(frozen=True, eq=False)
class FileOfAtoms:
    """A scene with the atoms of a file, and the groups of points on which effects act.

    Attributes
    ----------
    scene : Scene
    atoms : Points
        All atoms, in the order of the file; of LAMMPS in the order of their numbers.
    types : ndarray of int or str, shape (atoms,)
        The numbers of LAMMPS, or the elements.
    points : dict of int or str to Points
        The atoms of each type.
    bonds, angles, dihedrals, impropers : dict of int to tuple of Points
        For each type, the first atoms, the second atoms and so on: ``scene.add(effect, *found.bonds[1])``.
    charges, radii : ndarray, shape (atoms,)
        In the units of the file, except for the length of the radii; 0 if the file has none.
    coefficients : dict of str to dict of int to tuple of str
        The words in sections of LAMMPS such as "Bond Coeffs", by type. No effects are made of these.
    """

    scene: Any
    atoms: Points
    types: np.ndarray
    points: dict[Any, Points]
    bonds: dict[int, tuple[Points, ...]]
    angles: dict[int, tuple[Points, ...]]
    dihedrals: dict[int, tuple[Points, ...]]
    impropers: dict[int, tuple[Points, ...]]
    charges: np.ndarray
    radii: np.ndarray
    coefficients: dict[str, dict[int, tuple[str, ...]]]


@dataclass(frozen=True, eq=False)
class FileOfMesh:
    """An empty scene, and the arrays of a mesh for ``scene.add_mesh(found.positions, found.cells, effect, density=)``.

    Attributes
    ----------
    scene : Scene
    positions : ndarray, shape (points, dimension)
    cells : ndarray of int, shape (cells, 3 or 4)
        The tetrahedra; without tetrahedra, the triangles.
    groups : dict of str to ndarray of int
        The numbers of the points of each group, such as for ``fixed=found.groups["clamped"]``.
    cell_groups : dict of str to ndarray of int
        The numbers of the cells of each group.
    """

    scene: Any
    positions: np.ndarray
    cells: np.ndarray
    groups: dict[str, np.ndarray]
    cell_groups: dict[str, np.ndarray]


def read(
    kind: type,
    path: Path,
    dimension: int,
    periodic: bool | Sequence[bool],
    units: Sequence[float],
    style: str | None,
    ignore: Collection[str],
) -> Any:
    """Read a file, as `Scene.read` describes it; `units` are of length, mass and time."""
    if any(not (np.ndim(x) == 0 and np.isfinite(x) and x > 0) for x in units):
        raise ValueError("length, mass and time must be positive numbers: the units of the file in the scene's units.")
    is_lammps = path.suffix in _LAMMPS or path.name.startswith("data.")
    if style is not None and not is_lammps:
        raise ValueError(f"style is for data files of LAMMPS, with the ending {' or '.join(_LAMMPS)}.")
    if path.suffix == ".xml" and b"<mujoco" in path.read_bytes():  # meshes may have this ending too
        if dimension != 3 or tuple(units) != (1.0, 1.0, 1.0):
            raise ValueError("a mechanism of MuJoCo has 3 dimensions, and its units: leave out dimension and units.")
        mechanism = importlib.import_module("eig3.mechanism")  # it adds effects, which are over scenes
        return mechanism.read_mechanism(kind, path, ignore)
    if ignore:
        raise ValueError("ignore is for mechanisms of MuJoCo, with the ending .xml.")
    if not (is_lammps or path.suffix in _WITH_ASE):
        return _with_mesh(kind, read_mesh(path), path, dimension, units[0])
    if dimension != 3:
        raise ValueError("dimension must be 3 for a file of atoms.")
    table = read_lammps_data(path, style) if is_lammps else read_with_ase(path)
    sides = np.where(np.broadcast_to(periodic, 3), units[0] * table.sides, 0.0)
    return _with_atoms(kind(dimension=3, box=sides if sides.any() else None), table, units)


def _with_atoms(scene: Description, table: AtomTable, units: Sequence[float]) -> FileOfAtoms:
    length, mass, time = units
    if not (np.isfinite(table.masses).all() and (table.masses >= 0).all()):
        raise ValueError("the masses of the atoms in a file must be finite, and positive or 0 for fixed points.")
    x, v = length * table.positions, length / time * table.velocities
    atoms = scene._added(x, mass * table.masses, np.where(table.masses[:, None] > 0, v, 0.0))

    def grouped(name: str) -> dict[int, tuple[Points, ...]]:
        kinds, members = table.tuples.get(name, (np.empty(0, dtype=int), np.empty((0, 2), dtype=int)))
        return {kind: tuple(atoms[column] for column in members[kinds == kind].T) for kind in np.unique(kinds).tolist()}

    return FileOfAtoms(
        scene=scene,
        atoms=atoms,
        types=table.types,
        points={kind: atoms[table.types == kind] for kind in np.unique(table.types).tolist()},
        bonds=grouped("bonds"),
        angles=grouped("angles"),
        dihedrals=grouped("dihedrals"),
        impropers=grouped("impropers"),
        charges=table.charges,
        radii=length * table.radii,
        coefficients=table.coefficients,
    )


def _with_mesh(kind: type, table: MeshTable, path: Path, dimension: int, length: float) -> FileOfMesh:
    if np.ptp(table.positions[:, dimension:]) if dimension < 3 else False:
        raise ValueError(f"dimension must be 3 for {path}: its points are not in a plane of constant z.")
    places = length * table.positions[:, :dimension]
    return FileOfMesh(kind(dimension=dimension), places, table.cells, table.groups, table.cell_groups)
