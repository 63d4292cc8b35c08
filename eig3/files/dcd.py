"""DCD, which VMD and MDAnalysis read: positions in single precision, without velocities and types.

A file has one time between two states, in the units of CHARMM. Readers take lengths as Ångström.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from .libraries import library
from .table import complete
from .trajectory import Snapshot, Trajectory

_UNIT = 4.888821e-14  # s: CHARMM's unit of time, sqrt(dalton angstrom^2 / (kcal / mol))
_EVEN = 1e-6  # largest relative difference of the times between states


@contextmanager
def opened(path: Path, trajectory: Trajectory, types: np.ndarray) -> Iterator[Callable[[Snapshot], None]]:
    """Yield a function that writes one state after the other."""
    libdcd = library("MDAnalysis.lib.formats.libdcd", path.suffix)
    triclinic_box = library("MDAnalysis.lib.mdamath", path.suffix).triclinic_box
    dt = _even_time(trajectory.times)
    is_periodic = bool(trajectory.periodic.any())

    def write(snapshot: Snapshot) -> None:
        a, b, c, *angles = triclinic_box(*snapshot.lattice).tolist() if is_periodic else [0.0] * 6
        box = np.array([a, angles[2], b, angles[1], angles[0], c])  # the order in the file
        file.write(snapshot.x.astype(np.float32), box)

    with complete(path) as part:
        with libdcd.DCDFile(str(part), "w") as file:
            file.write_header("written by eig3", trajectory.count, 0, 1, dt / _UNIT, int(is_periodic))
            yield write
        with libdcd.DCDFile(str(part)) as file:  # the library raises no error if it cannot write
            if len(file) < len(trajectory):
                raise OSError(f"{path} could not be written to its end: is the disk full?")


def _even_time(times: np.ndarray) -> float:
    """Return the time between two states, or raise an error if it differs."""
    between = np.diff(times)
    if not between.size:
        return 0.0
    if np.ptp(between) > _EVEN * between.mean():
        raise ValueError(
            "a .dcd file has one time between two states, but the saved states are not at equal distances in time: "
            "integrate with t_eval, or write .extxyz or .dump."
        )
    return float(between.mean())
