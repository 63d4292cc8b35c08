"""Ensembles in files, and in directories to which their parts are written as they finish."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from ..result import storage
from ..result.soundness import check_ensemble
from .occurrences import MemberOccurrences

_KIND = "ensemble"
_WHOLE, _PARTS = "ensemble.npz", "part-*.npz"  # the files of a directory: all members at their start, and the parts


def save(solution: Any, path: str | PathLike[str]) -> Path:
    """Write an ensemble to a file, as `EnsembleSolution.save` describes."""
    return storage.write(_KIND, solution.__getstate__(), storage.file(path))


class Directory:
    """A directory to which the parts of an ensemble are written as they finish.

    Parameters
    ----------
    path : str or path
        A new or empty directory.

    Raises
    ------
    FileExistsError
        If it is not empty.
    """

    def __init__(self, path: Any) -> None:
        self._path = storage.Place.of(path).directory
        self._path.mkdir(parents=True, exist_ok=True)

    def begin(self, start: Any) -> None:
        """Write the ensemble at its start."""
        save(start, self._path / _WHOLE)

    def put(self, part: Any) -> None:
        """Write a part."""
        save(part, self._path / _PARTS.replace("*", f"{part.first:012d}"))


def register(kind: type) -> None:
    """Register the class of the results for files of ensembles."""
    storage.PARTS[MemberOccurrences.__name__] = MemberOccurrences
    storage.KINDS[_KIND] = partial(_loaded, kind)
    storage.DIRECTORIES[_WHOLE] = _loaded_directory


def _loaded(kind: type, fields: Mapping[str, Any]) -> Any:
    """Return the ensemble with the fields of a file."""
    t, u = fields["t"], fields["u"]
    if len(t) == 1 < len(u):  # the times of all members
        fields = {**fields, "t": np.broadcast_to(t, u.shape[:2])}
    check_ensemble(fields, MemberOccurrences)
    return kind(**fields)


def _loaded_directory(path: Path) -> Any:
    """Return an ensemble with the parts from a directory. The other members are at their start."""
    whole = storage.load(path / _WHOLE)
    for part in sorted(path.glob(_PARTS)):
        whole._place(storage.load(part))
    return whole
