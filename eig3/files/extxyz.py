"""Extended XYZ, which ASE and OVITO read. The names of the columns are of OVITO and of libAtoms' specification.

Positions are as in the solution, not wrapped into the box, because the format has no image flags.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from .table import lines, text_file
from .trajectory import Snapshot, Trajectory, bounds

_ANY = "X"  # the species of a point without a name


@contextmanager
def opened(path: Path, trajectory: Trajectory, types: np.ndarray) -> Iterator[Callable[[Snapshot], None]]:
    """Yield a function that writes one state after the other."""
    is_named = types.dtype.kind == "U"
    species = types if is_named else np.full(trajectory.count, _ANY)
    ids = np.arange(1, trajectory.count + 1)
    numbers = [] if is_named else [("type_number:I:1", types)]
    known = [("masses:R:1", trajectory.masses), ("radius:R:1", trajectory.radii)]

    def write(snapshot: Snapshot) -> None:
        columns = [("species:S:1", species), ("pos:R:3", snapshot.x), ("velo:R:3", snapshot.v), *known]
        columns += [("angular_velocity:R:3", snapshot.spin), ("id:I:1", ids), *numbers]
        present = [(name, values) for name, values in columns if values is not None]
        properties = ":".join(name for name, _ in present)
        file.write(f"{trajectory.count}\n{_cell(snapshot, trajectory.periodic)}")
        file.write(f"Properties={properties} Time={snapshot.t:.15g} Step={snapshot.step}\n")
        file.write(lines([values for _, values in present]))

    with text_file(path) as file:
        yield write


def _cell(snapshot: Snapshot, periodic: np.ndarray) -> str:
    """Return the box: along axes that are not periodic, it has the extent of the points."""
    if not periodic.any():
        return 'pbc="F F F" '
    low, high = bounds(snapshot, periodic)
    edges = np.where(np.eye(3, dtype=bool), np.diag(high - low), snapshot.lattice)
    flags = " ".join("T" if x else "F" for x in periodic)
    texts = [" ".join(f"{value:.15g}" for value in array) for array in (edges.ravel(), low)]
    return f'Lattice="{texts[0]}" Origin="{texts[1]}" pbc="{flags}" '
