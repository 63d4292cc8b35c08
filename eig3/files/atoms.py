"""Atoms as files have them: arrays, before they are in a scene."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .libraries import library

_FULL_TURN = 1e-9  # largest relative size of the tilt of a box


@dataclass(frozen=True, eq=False)
class AtomTable:
    """The content of a file of atoms.

    Attributes
    ----------
    positions, velocities : ndarray, shape (atoms, 3)
    masses, charges, radii : ndarray, shape (atoms,)
        0 if the file has none.
    types : ndarray of int or str, shape (atoms,)
    sides : ndarray, shape (3,)
        Of the box; 0 without a box.
    tuples : dict of str to (ndarray of int or str, ndarray of int)
        For "bonds", "angles", "dihedrals" and "impropers": the type of each, shape (k,), and the indices of its atoms.
    coefficients : dict of str to dict of int to tuple of str
        The words of each line of sections such as "Pair Coeffs".
    """

    positions: np.ndarray
    velocities: np.ndarray
    masses: np.ndarray
    charges: np.ndarray
    radii: np.ndarray
    types: np.ndarray
    sides: np.ndarray
    tuples: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    coefficients: dict[str, dict[int, tuple[str, ...]]] = field(default_factory=dict)


def read_with_ase(path: Path) -> AtomTable:
    """Read the last state of an XYZ or PDB file. Bonds are from the lines CONECT of a PDB file."""
    ase_io = library("ase.io", path.suffix)
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}.")
    atoms = ase_io.read(path, index=-1)
    arrays, count = atoms.arrays, len(atoms)
    velocities = arrays["velo"] if "velo" in arrays else atoms.get_velocities()
    cell = atoms.cell.array
    if atoms.pbc.any() and abs(cell - np.diag(np.diag(cell))).max() > _FULL_TURN * abs(cell).max():
        raise ValueError(f"{path} has a tilted box, which a scene does not support.")
    return AtomTable(
        positions=atoms.positions,
        velocities=np.zeros((count, 3)) if velocities is None else velocities,
        masses=atoms.get_masses(),
        charges=np.asarray(atoms.get_initial_charges(), dtype=float),
        radii=np.asarray(arrays.get("radius", np.zeros(count)), dtype=float),
        types=np.array(atoms.get_chemical_symbols()),
        sides=np.where(atoms.pbc, np.diag(cell), 0.0),
        tuples={"bonds": _connected(path)} if path.suffix == ".pdb" else {},
    )


def _connected(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return the bonds of a PDB file, each once, by the columns of its format. They have one type, 1."""
    serials: dict[str, int] = {}
    pairs = set()
    for line in path.read_text().splitlines():
        if line.startswith("ENDMDL") and serials:
            raise ValueError(f"{path} has several models, of which a scene can have one: keep one in the file.")
        if line.startswith(("ATOM  ", "HETATM")):
            serials[line[6:11].strip()] = len(serials)
        elif line.startswith("CONECT"):
            words = [line[k : k + 5].strip() for k in range(6, 31, 5)]
            unknown = [word for word in words if word and word not in serials]
            if unknown:
                raise ValueError(f"{path} has a CONECT of atom {unknown[0]}, which it does not have.")
            first, *others = (serials[word] for word in words if word)
            pairs |= {(min(first, other), max(first, other)) for other in others}
    bonds = np.array(sorted(pairs), dtype=np.int64).reshape(-1, 2)
    return np.ones(len(bonds), dtype=np.int64), bonds
