"""The text dump of LAMMPS, which OVITO, VMD, ASE and MDAnalysis read: https://docs.lammps.org/dump.html.

Positions are wrapped into the box, with image flags. There is no "ITEM: TIME", because MDAnalysis cannot read it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from .table import lines, text_file
from .trajectory import Snapshot, Trajectory, bounds, wrapped


@contextmanager
def opened(path: Path, trajectory: Trajectory, types: np.ndarray) -> Iterator[Callable[[Snapshot], None]]:
    """Yield a function that writes one state after the other."""
    is_named = types.dtype.kind == "U"
    numbers = 1 + np.unique(types, return_inverse=True)[1] if is_named else types
    ids = np.arange(1, trajectory.count + 1)
    periodic = trajectory.periodic

    def write(snapshot: Snapshot) -> None:
        x, images = wrapped(snapshot.x, snapshot.lattice, periodic)
        columns = [("id", ids), ("type", numbers), ("element", types if is_named else None), ("x y z", x)]
        columns += [("ix iy iz", images if periodic.any() else None), ("vx vy vz", snapshot.v)]
        columns += [("mass", trajectory.masses), ("radius", trajectory.radii), ("omegax omegay omegaz", snapshot.spin)]
        present = [(name, values) for name, values in columns if values is not None]
        file.write(f"ITEM: TIMESTEP\n{snapshot.step}\nITEM: NUMBER OF ATOMS\n{trajectory.count}\n")
        file.write(_box(snapshot, periodic))
        file.write(f"ITEM: ATOMS {' '.join(name for name, _ in present)}\n")
        file.write(lines([values for _, values in present]))

    with text_file(path) as file:
        yield write


def _box(snapshot: Snapshot, periodic: np.ndarray) -> str:
    """Return the bounds of the box. With a tilt, x has the bounds of all corners."""
    low, high = bounds(snapshot, periodic)
    tilt = float(snapshot.lattice[1, 0])
    flags = " ".join("pp" if x else "ss" for x in periodic)
    if not tilt:
        rows = [f"{a:.15g} {b:.15g}\n" for a, b in zip(low, high, strict=True)]
        return f"ITEM: BOX BOUNDS {flags}\n{''.join(rows)}"
    low[0], high[0] = low[0] + min(0.0, tilt), high[0] + max(0.0, tilt)
    rows = [f"{a:.15g} {b:.15g} {c:.15g}\n" for a, b, c in zip(low, high, (tilt, 0.0, 0.0), strict=True)]
    return f"ITEM: BOX BOUNDS xy xz yz {flags}\n{''.join(rows)}"
