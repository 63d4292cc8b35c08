"""Solutions in files, and in the directories to which runs write their rows."""

from __future__ import annotations

import contextlib
import dataclasses
import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from ..methods import shown
from .archive import PAUSE, TRIALS, file, read, value, write
from .labels import Labels
from .mapped import DamagedFileError, MappedRows, check_directory, output_files, read_mapped
from .solution import TRANSIENT, Solution, separated
from .soundness import check_fields
from .status import Status

_RUN = "run.npz"  # the file with everything but the rows, in a directory of `save_to`
_ROWS = ("t", "u", "v", "steps")  # the fields whose rows have files of their own there, as those of outputs have
_LEAST_PAUSE, _LARGEST_SHARE = 0.1, 0.05  # seconds between two records of a run, and the part of its time they may take
_FIELDS = {field.name: field for field in dataclasses.fields(Solution)}
#: Functions that return what a file of another kind has, from the fields in it.
KINDS: dict[str, Callable[[dict[str, Any]], Any]] = {}
#: Functions that read a directory of another kind, by a file that it has.
DIRECTORIES: dict[str, Callable[[Path], Any]] = {}


@dataclasses.dataclass
class Place:
    """Where a run saves its rows, and what it saves beside them.

    Attributes
    ----------
    directory : Path
    labels : Labels or None
        Those of the problem that runs.
    integrals : tuple of str
        The names of integrals, whose values are the last velocities of a row.
    """

    directory: Path
    labels: Labels | None = None
    integrals: tuple[str, ...] = ()
    _next: float = dataclasses.field(default=0.0, init=False)  # the time of the next record of a run that goes on

    @classmethod
    def of(cls, save_to: Any, labels: Labels | None = None, integrals: tuple[str, ...] = ()) -> Place:
        """Return the place that `save_to` names, which must be a new or an empty directory."""
        if not isinstance(save_to, str | PathLike):
            raise TypeError(f"save_to must be the path of a directory, not {shown(save_to)}.")
        directory = Path(save_to)
        check_directory(directory)
        return cls(directory, labels, integrals)

    def keep(self, files: MappedRows, rows: int, solution: Callable[[], Solution]) -> None:
        """Write now and then what a run has found so far: what is left if its process is killed.

        Parameters
        ----------
        files : MappedRows
        rows : int
            Number of rows that are complete in them.
        solution : callable
            It returns the run up to these rows.
        """
        begin = time.perf_counter()
        if begin >= self._next:
            self.write(solution(), files, rows, has_ended=False)
            end = time.perf_counter()
            self._next = end + max(_LEAST_PAUSE, (end - begin) / _LARGEST_SHARE)

    def write(self, solution: Solution, files: MappedRows, rows: int, *, has_ended: bool) -> None:
        """Write what a solution has beside its rows, whose number in the files is `rows`."""
        state = {name: None if name in _ROWS else value for name, value in solution._fields().items()}
        state |= dict.fromkeys(TRANSIENT) | {"_resume": solution._state, "labels": self.labels, "outputs": {}}
        rest = {"outputs": list(solution.outputs), "integrals": self.integrals, "has_ended": has_ended}
        rest |= {"rows": rows, "checksums": files.checksums(rows)}
        write(solution.method, state, self.directory / _RUN, is_lasting=has_ended, **rest)


def load(path: str | PathLike[str]) -> Any:
    """Read what `save` or a run with `save_to` has written, as `eig3.load` describes it."""
    target = Path(path)
    for name, read_directory in {_RUN: _load_directory, **DIRECTORIES}.items():
        if (target / name).is_file():
            return read_directory(target)
    target = file(path)
    if Path(path).is_dir() and not target.exists():
        raise ValueError(f"{path} is not a directory that save_to has written: name such a directory, or a file.")
    return read(target, _of_kind)


def _of_kind(record: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> Any:
    if "kind" not in record:
        return _solution(record["solution"], arrays)
    return KINDS[record["kind"]]({name: value(plain, arrays) for name, plain in record["solution"].items()})


def _load_directory(directory: Path) -> Solution:
    """Read a directory. If its run ends at this moment, its files change between two of them that are read."""
    for _ in range(TRIALS - 1):
        try:
            return read(directory / _RUN, partial(_solution_in, directory))
        except DamagedFileError:
            time.sleep(PAUSE)
    return read(directory / _RUN, partial(_solution_in, directory))


def _solution_in(directory: Path, record: Mapping[str, Any], others: Mapping[str, np.ndarray]) -> Solution:
    """Return the solution from the files of a directory, and the record and arrays that are not rows."""
    rows, files = record["rows"], output_files(record["outputs"])
    if not (isinstance(rows, int) and rows >= 0):
        raise ValueError(f"{rows} is not a number of rows.")
    checksums = {name: record["checksums"][name] for name in (*_ROWS, *files.values()) if name in record["checksums"]}
    arrays = read_mapped(directory, checksums, rows)
    given: dict[str, Any] = {name: arrays.get(name) for name in _ROWS}
    whole, names = (given["u"], given["v"]), [str(name) for name in record["integrals"]]
    if names:
        given["u"], given["v"], given["integrals"] = separated(*whole, names)
    if files:
        given["outputs"] = {name: arrays[file] for name, file in files.items()}
    result = _solution(record["solution"], others, given)
    result._whole = whole if names else None
    if not record["has_ended"]:
        result.status = Status.INTERRUPTED
        result.message = (
            f"The process of this run was killed after t = {result.t[-1]:g}, the last state here, or it is still "
            "running."
        )
    return result


@contextlib.contextmanager
def going_on() -> Iterator[None]:
    """While a run takes the state of a file, say of each error that the state is damaged."""
    try:
        yield
    except Exception as error:
        raise ValueError(
            f"the run cannot go on from its file ({error}): give the functions of the run; if they are these, the file "
            "is damaged."
        ) from error


def whole_rows(solution: Solution, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return t, u and v of the saved states with all n degrees of freedom, also those of integrals.

    A file of `Solution.save` has the velocities of integrals only: the displacements, which nothing reads, are NaN.
    """
    u, v = solution._whole or (solution.u, solution.v)
    if solution._whole is None and solution.integrals:
        v = np.column_stack([v, *solution.integrals.values()])
        u = np.column_stack([u, np.full((len(u), len(solution.integrals)), np.nan)])
    if (u.shape[1] if u.ndim == 2 else 1) != n:
        raise ValueError(f"the states have {u.shape[1:]} degrees of freedom and not {n}.")
    return solution.t, u, v


def _solution(
    fields: Mapping[str, Any], arrays: Mapping[str, np.ndarray], given: Mapping[str, Any] | None = None
) -> Solution:
    """Return the solution with the fields of a record, and those that are `given`."""
    state = {name: value(plain, arrays) for name, plain in fields.items()} | dict(given or {})
    check_fields(state)
    found = {name: state.pop(name) for name in [*state] if not _FIELDS[name].init}
    solution = Solution(**state)
    vars(solution).update(found)
    return solution
