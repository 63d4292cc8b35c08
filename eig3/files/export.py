"""Write a run to a file of another program: the ending of the path sets the format."""

from __future__ import annotations

import importlib
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..functions.checks import check_count
from ..geometry import Geometry
from ..run.progress import Progress, check_progress
from .libraries import library
from .trajectory import Trajectory

#: By the ending: the module that writes a file, and the libraries that it needs.
FORMATS = {
    ".extxyz": ("extxyz",),
    ".xyz": ("extxyz",),
    ".dump": ("lammps_dump",),
    ".dcd": ("dcd", "MDAnalysis"),
    ".pvd": ("paraview", "meshio"),
    ".vtkhdf": ("vtkhdf", "h5py"),
}


def export(
    geometry: Geometry | None,
    solution: Any,
    path: str | PathLike[str],
    *,
    types: Any = None,
    scale: float = 1.0,
    every: int = 1,
    progress: bool = False,
    name: str = "the problem",
) -> Path:
    """Write a run, as `Problem.export` describes it. `name` is the problem's, for errors."""
    path = Path(path)
    geometry = check_export(geometry, path, name)
    if not (np.ndim(scale) == 0 and np.isfinite(scale) and scale > 0):
        raise ValueError(f"scale must be a positive number, not {scale!r}.")
    check_progress(progress)
    writer = importlib.import_module(f".{FORMATS[path.suffix][0]}", __package__)
    trajectory = Trajectory(geometry, solution, float(scale), check_count(every, "every"))
    if not trajectory.count:
        raise ValueError(f"{name} has no points to write.")
    kinds = _checked_types(types, trajectory)
    with writer.opened(path, trajectory, kinds) as write, Progress(len(trajectory), "state", progress) as bar:
        for snapshot in trajectory:
            write(snapshot)
            bar.add(1)
    return path


def check_export(geometry: Geometry | None, path: Path, name: str) -> Geometry:
    """Return the geometry, or raise an error if a problem with it cannot be written to this path."""
    if path.suffix == ".xdmf":
        raise ValueError(
            f"path must end with .vtkhdf or .pvd, which ParaView reads, and not with .xdmf: {path.name!r}."
        )
    if path.suffix not in FORMATS:
        raise ValueError(f"path must end with {', '.join(FORMATS)}, not {path.name!r}.")
    if not path.parent.is_dir():
        raise FileNotFoundError(f"path must be in an existing folder: create {str(path.parent)!r} first.")
    if path.suffix == ".pvd" and path.with_suffix("").is_file():
        raise FileExistsError(f"path must have another name than {path.name!r}: its folder {path.stem!r} is a file.")
    if geometry is None:
        raise ValueError(
            f"{name} has no points in space to write: build it as a scene or a frame, or give it a view of its points "
            "with problem.with_(view=eig3.animation.Mechanism(places))."
        )
    if path.suffix == ".dcd" and np.count_nonzero(geometry.box) not in (0, 3):
        raise ValueError("a .dcd file needs a box with three periodic axes or none: write .extxyz or .dump instead.")
    of_contacts = ["scipy.spatial"] * (geometry.contacts is not None and path.suffix in (".pvd", ".vtkhdf"))
    for module in (*FORMATS[path.suffix][1:], *of_contacts):
        library(module, path.suffix)
    return geometry


def _checked_types(types: ArrayLike | None, trajectory: Trajectory) -> np.ndarray:
    """Return the type of each point, a number or a text; by default 1, and 2 for fixed points."""
    if types is None:
        return np.where(trajectory.is_fixed, 2, 1)
    given = np.asarray(types)
    if given.shape not in ((), (trajectory.count,)):
        raise ValueError(
            f"types must be one for all points, or have the shape ({trajectory.count},), not {given.shape}."
        )
    if given.dtype.kind == "U":
        if any(not text or len(text.split()) != 1 or text != text.strip() for text in np.unique(given).tolist()):
            raise ValueError("types must be words without spaces, such as 'Ar'.")
    elif given.dtype.kind not in "iu" or (given < 1).any():
        raise ValueError("types must be words, or whole numbers of at least 1.")
    return np.broadcast_to(given, (trajectory.count,))
