"""Ensembles in files, and in directories to which their parts are written as they finish."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..result import storage
from ..result.soundness import check_members
from .occurrences import MemberOccurrences

if TYPE_CHECKING:
    from .solution import EnsembleSolution

_WHOLE, _PARTS = "ensemble.npz", "part-*.npz"  # the files of a directory: all members at their start, and the parts
_TEXTS = ("status", "message")  # fields with an array of objects


def save(solution: EnsembleSolution, path: str | PathLike[str]) -> Path:
    """Write an ensemble to a file, as `EnsembleSolution.save` describes it."""
    fields = solution.__getstate__()
    fields |= {name: fields[name].tolist() for name in _TEXTS}
    return storage.write(solution.method, fields, storage.file(path), kind="ensemble")


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

    def begin(self, start: EnsembleSolution) -> None:
        """Write the ensemble at its start."""
        save(start, self._path / _WHOLE)

    def put(self, part: EnsembleSolution) -> None:
        """Write a part."""
        save(part, self._path / _PARTS.replace("*", f"{part.first:012d}"))


def _loaded(fields: Mapping[str, Any]) -> EnsembleSolution:
    """Return the ensemble with the fields of a file."""
    from .solution import EnsembleSolution

    state = dict(fields)
    for name in _TEXTS:
        state[name] = np.array((*state[name], None), dtype=object)[:-1]  # NumPy would make texts of another type
    state["_last"] = dict(state["_last"])
    check_members(state, MemberOccurrences)
    if len(state["t"]) < len(state["u"]):
        state["t"] = np.broadcast_to(state["t"], state["u"].shape[:2])
    return EnsembleSolution(**state)


def _loaded_directory(path: Path) -> EnsembleSolution:
    """Return an ensemble with the parts that are in a directory. The other members are at their start."""
    whole: EnsembleSolution = storage.load(path / _WHOLE)
    for part in sorted(path.glob(_PARTS)):
        whole._place(storage.load(part))
    return whole


storage.PARTS[MemberOccurrences.__name__] = MemberOccurrences
storage.KINDS["ensemble"] = _loaded
storage.DIRECTORIES[_WHOLE] = _loaded_directory
