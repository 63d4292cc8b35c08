"""Ensembles in files, and in directories to which their parts are written as they finish."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from ..result import storage
from ..result.mapped import check_directory
from ..result.occurrences import labelled
from ..result.soundness import check_ensemble
from ..result.status import Status
from .member_errors import MemberErrors
from .occurrences import MemberOccurrences
from .recipe import differing

_KIND = "ensemble"
#: The file of a directory with all members at their start.
WHOLE = "ensemble.npz"
_RECIPE, _PARTS = "recipe.npz", "part-*.npz"  # what determines the result, and the finished parts
_NOTES = "notes.npz"  # the notes about all members
_ERROR = "error.npz"  # the ensembles that a finished ensemble is compared with


def save(solution: Any, path: str | PathLike[str]) -> Path:
    """Write an ensemble to a file, as `EnsembleSolution.save` describes."""
    fields = solution.__getstate__()
    if solution.error is not None:
        fields["error"] = solution.error.kept()
    return storage.write(_KIND, fields, storage.file(path))


class Directory:
    """A directory to which the parts of an ensemble are written as they finish.

    Each file appears in it as a whole, when all of it is on the disk: a process may be killed at any time. It is a new
    or empty directory, or has parts of the same ensemble: the `recipe`, from `recipe_of`, determines the result.

    Raises
    ------
    FileExistsError
        If it has other files, or another ensemble.
    """

    def __init__(self, path: Any, recipe: Mapping[str, Any]) -> None:
        self.path, self._recipe = storage.path_of(path), dict(recipe)
        held = recipe_in(self.path)
        if held is None:
            check_directory(self.path, besides=storage.torn(self.path))
        elif names := differing(recipe["marks"], held["marks"]):
            raise FileExistsError(
                f"save_to must name a new or an empty directory, or one with this ensemble, but {path} holds an "
                f"ensemble with another {' and another '.join(names)}: name another directory, or remove this one."
            )

    def begin(self, start: Any) -> None:
        """Write the recipe, and the ensemble at its start, if they are not in the directory."""
        self.path.mkdir(parents=True, exist_ok=True)
        for path in storage.torn(self.path):
            path.unlink()
        if not (self.path / _RECIPE).is_file():
            storage.write("recipe", self._recipe, self.path / _RECIPE)
        if not (self.path / WHOLE).is_file():
            save(start, self.path / WHOLE)

    def put(self, part: Any) -> None:
        """Write a part."""
        save(part, self._file(part.first))

    def keep_notes(self, method: Any, notes: tuple[str, ...]) -> None:
        """Write the notes about all members, which no part has."""
        storage.write("notes", {"method": method, "notes": notes}, self.path / _NOTES)

    def keep_error(self, solution: Any) -> None:
        """Write the estimated errors of the finished ensemble."""
        fields = {"method": solution.method, "notes": (), "error": solution.error.kept()}
        storage.write("errors", fields, self.path / _ERROR)

    def finished(self, first: int, count: int) -> Any:
        """Return the part with these members, or None if it is not there, is damaged or was interrupted."""
        path = self._file(first)
        if not path.is_file():
            return None
        try:
            part = storage.load(path)
        except ValueError:  # it is damaged, and runs again
            return None
        return part if len(part) == count and not (part.status == Status.INTERRUPTED).any() else None

    def _file(self, first: int) -> Path:
        return self.path / _PARTS.replace("*", f"{first:012d}")


def register(kind: type) -> None:
    """Register the class of the results for files of ensembles."""
    storage.PARTS[MemberOccurrences.__name__] = MemberOccurrences
    storage.KINDS[_KIND] = partial(_loaded, kind)


def _loaded(kind: type, fields: Mapping[str, Any]) -> Any:
    """Return the ensemble with the fields of a file."""
    fields = dict(fields)
    kept = fields.pop("error", None)
    t, u = fields["t"], fields["u"]
    if len(t) == 1 < len(u):  # the times of all members
        fields = {**fields, "t": np.broadcast_to(t, u.shape[:2])}
    check_ensemble(fields, MemberOccurrences)
    solution = kind(**fields | {"events": labelled(fields["events"], fields["labels"])})
    if kept is not None:
        solution.error = MemberErrors.loaded(solution, kept, partial(_loaded, kind))
    return solution


def whole_in(path: Path) -> Any:
    """Return an ensemble with the sound parts from a directory. The other members are at their start."""
    whole = storage.load(path / WHOLE)
    for part in sorted(path.glob(_PARTS)):
        try:
            whole._place(storage.load(part))
        except ValueError:
            whole.notes = (*whole.notes, f"{part.name} is damaged: its members have not run, and resume runs them.")
    if (path / _NOTES).is_file():
        whole.notes = (*dict.fromkeys((*whole.notes, *storage.fields_in(path / _NOTES)["notes"])),)
    return with_error(whole, path)


def with_error(whole: Any, path: Path) -> Any:
    """Give an ensemble the estimated errors from its directory, if they are there, and return it."""
    if (path / _ERROR).is_file():
        kept = storage.fields_in(path / _ERROR)["error"]
        whole.error = MemberErrors.loaded(whole, kept, partial(_loaded, type(whole)))
    return whole


def recipe_in(path: Path) -> Any:
    """Return the recipe of the ensemble in a directory, or None."""
    return storage.fields_in(path / _RECIPE) if (path / _RECIPE).is_file() else None
