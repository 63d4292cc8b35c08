"""The data file of LAMMPS: https://docs.lammps.org/read_data.html."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from .atoms import AtomTable

#: The columns of the section Atoms by its style; image flags may follow.
_STYLES = {
    "atomic": "id type x y z",
    "charge": "id type q x y z",
    "bond": "id molecule type x y z",
    "angle": "id molecule type x y z",
    "molecular": "id molecule type x y z",
    "full": "id molecule type q x y z",
    "sphere": "id type diameter density x y z",
}
_TUPLES = {"Bonds": 2, "Angles": 3, "Dihedrals": 4, "Impropers": 4}
_PLAIN = {"Atoms", "Velocities", "Masses", *_TUPLES}


def read_lammps_data(path: Path, style: str | None = None) -> AtomTable:
    """Read a data file. The style of its atoms is in the comment after "Atoms", or given as `style`."""
    header, sections, named = _sections(path)
    style = style or named
    if style not in _STYLES:
        raise ValueError(
            f"{path} has atoms of the style {style or 'that it does not name'}: give style=, one of "
            f"{', '.join(_STYLES)}."
        )
    columns = _STYLES[style].split()
    atoms = _numbers(path, "Atoms", sections)
    width = atoms.shape[1] - len(columns)
    if width not in (0, 3):
        raise ValueError(f"{path} must have the columns {_STYLES[style]} in Atoms, and perhaps 3 image flags.")
    atoms = atoms[np.argsort(atoms[:, 0])]
    index = {int(k): i for i, k in enumerate(atoms[:, 0])}
    if len(index) != header.get("atoms"):
        raise ValueError(f"{path} must have {header.get('atoms')} atoms with different numbers, not {len(index)}.")
    of = dict(zip(columns, atoms.T, strict=False))
    sides = header["sides"]
    images = atoms[:, len(columns) :] if width else np.zeros((len(atoms), 3))
    types = of["type"].astype(np.int64)
    radii = of.get("diameter", np.zeros(len(atoms))) / 2
    return AtomTable(
        positions=np.column_stack([of[axis] for axis in "xyz"]) + images * sides,
        velocities=_velocities(path, sections, index),
        masses=_masses(path, sections, types, of),
        charges=of.get("q", np.zeros(len(atoms))),
        radii=radii,
        types=types,
        sides=sides,
        tuples={name.lower(): _tuples(path, name, sections, index) for name in _TUPLES if name in sections},
        coefficients={
            name: {int(row[0]): tuple(row[1:]) for row in rows}
            for name, rows in sections.items()
            if name.endswith("Coeffs")
        },
    )


def _sections(path: Path) -> tuple[dict, dict[str, list[list[str]]], str]:
    """Return the header, the words of the lines of each section, and the style in the comment after "Atoms"."""
    header: dict = {}
    sections: dict[str, list[list[str]]] = {}
    sides, style, rows = np.zeros(3), "", None
    for line in path.read_text().splitlines()[1:]:  # the first line is a comment
        text, _, comment = (part.strip() for part in line.partition("#"))
        if not text:
            continue
        if text in _PLAIN or text.endswith("Coeffs"):
            rows = sections.setdefault(text, [])
            style = comment if text == "Atoms" else style
        elif re.match("[A-Z]", text):
            supported = ", ".join(sorted(_PLAIN))
            raise ValueError(
                f"{path} has the section {text}, which is not supported; {supported} and coefficients are."
            )
        elif rows is not None:
            rows.append(text.split())
        else:
            _add_to_header(path, header, sides, text)
    header["sides"] = sides
    return header, sections, style


def _add_to_header(path: Path, header: dict, sides: np.ndarray, text: str) -> None:
    words = text.split()
    if words[-1] in ("xhi", "yhi", "zhi"):
        sides["xyz".index(words[-1][0])] = float(words[1]) - float(words[0])
    elif words[-1] in ("avec", "bvec", "cvec") or (words[-1] == "yz" and any(map(float, words[:3]))):
        raise ValueError(f"{path} has a tilted box, which a scene does not support.")
    elif len(words) == 2:
        if words[1] in ("ellipsoids", "lines", "triangles", "bodies") and int(words[0]):
            raise ValueError(f"{path} has {words[1]}, which a scene does not support.")
        header[words[1]] = int(words[0])


def _numbers(path: Path, name: str, sections: dict[str, list[list[str]]]) -> np.ndarray:
    rows = sections.get(name)
    if not rows:
        raise ValueError(f"{path} has no section {name}.")
    if len({len(row) for row in rows}) > 1:
        raise ValueError(f"{path} must have lines with the same number of columns in {name}.")
    try:
        return np.array(rows, dtype=float)
    except ValueError:
        raise ValueError(f"{path} must have numbers in {name}; names of types are not supported.") from None


def _masses(
    path: Path, sections: dict[str, list[list[str]]], types: np.ndarray, of: dict[str, np.ndarray]
) -> np.ndarray:
    """Return the mass of each atom: of a sphere from its density, and otherwise of its type."""
    if "density" in of:
        volume = np.pi / 6 * of["diameter"] ** 3
        return of["density"] * np.where(of["diameter"] > 0, volume, 1.0)  # of a point, LAMMPS takes it as the mass
    known = {int(kind): mass for kind, mass in _numbers(path, "Masses", sections)}
    missing = set(types.tolist()) - set(known)
    if missing:
        raise ValueError(f"{path} has no mass of the type {min(missing)} in Masses.")
    return np.array([known[kind] for kind in types.tolist()])


def _velocities(path: Path, sections: dict[str, list[list[str]]], index: dict[int, int]) -> np.ndarray:
    v = np.zeros((len(index), 3))
    if "Velocities" in sections:
        rows = _numbers(path, "Velocities", sections)
        v[_indices(path, "Velocities", rows[:, 0], index)] = rows[:, 1:4]
    return v


def _tuples(
    path: Path, name: str, sections: dict[str, list[list[str]]], index: dict[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the types of bonds, angles or dihedrals, and the indices of their atoms."""
    rows = _numbers(path, name, sections)
    if rows.shape[1] != 2 + _TUPLES[name]:
        raise ValueError(f"{path} must have {2 + _TUPLES[name]} columns in {name}, not {rows.shape[1]}.")
    return rows[:, 1].astype(np.int64), _indices(path, name, rows[:, 2:], index)


def _indices(path: Path, name: str, numbers: np.ndarray, index: dict[int, int]) -> np.ndarray:
    unknown = [int(number) for number in numbers.ravel() if int(number) not in index]
    if unknown:
        raise ValueError(f"{path} has the atom {unknown[0]} in {name}, but not in Atoms.")
    return np.array([index[int(number)] for number in numbers.ravel()], dtype=np.int64).reshape(numbers.shape)
