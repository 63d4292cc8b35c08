"""Solutions in files and directories: NumPy arrays, and a JSON record of the other values. Nothing is pickled."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import time
import uuid
import zipfile
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from ..functions.extremes import Extremes
from ..functions.first_order import NONE, FirstOrder
from ..methods import METHODS, Method, shown
from .columns import OF_STATES, ROWS
from .error_estimate import ErrorEstimate
from .labels import Labels
from .mapped import DamagedFileError, MappedRows, check_directory, output_files, read_mapped
from .occurrences import Occurrences
from .status import Status

_VERSION = 7  # increase it with every change that another version would misread; each 1.x reads 7 and later
_RECORD = "eig3"  # the name of the record among the arrays
_RUN = "run.npz"  # the file with everything but the rows, in a directory of `save_to`
_TRIALS, _PAUSE = 5, 0.02  # attempts to read or replace a file that another process uses, and the seconds between them
_LEAST_PAUSE, _LARGEST_SHARE = 0.1, 0.05  # seconds between two records of a run, and their largest share of its time
#: The records that a file may have among its values, by name.
PARTS: dict[str, Any] = {kind.__name__: kind for kind in (ErrorEstimate, Extremes, Labels, Occurrences)}
RUN = "run"  # the kind of a file with one run
#: Functions that make the object of a file of each kind from its fields.
KINDS: dict[str, Callable[[dict[str, Any]], Any]] = {}
#: Functions that read a directory of each kind, by the name of a file in it.
DIRECTORIES: dict[str, Callable[[Path], Any]] = {}
WITHOUT_JACOBIAN = "The jacobian of the method is a function, which a file does not keep: give it again for a new run."


class _UnknownMethodError(ValueError):
    """The file is valid, but the class of its method is not known."""


@dataclasses.dataclass
class Place:
    """The directory of a run, for its rows and its record.

    Attributes
    ----------
    directory : Path
    labels : Labels or None
        The labels of the problem.
    first_order : FirstOrder
        The first-order unknowns, whose values are the last velocities of a row.
    """

    directory: Path
    labels: Labels | None = None
    first_order: FirstOrder = NONE
    _next: float = dataclasses.field(default=0.0, init=False)  # the time of the next record of a running run

    @classmethod
    def of(cls, save_to: Any, labels: Labels | None = None, first_order: FirstOrder = NONE) -> Place:
        """Return the place that `save_to` names, which must be a new or an empty directory."""
        directory = path_of(save_to)
        check_directory(directory)
        return cls(directory, labels, first_order)

    def keep(self, files: MappedRows, rows: int, solution: Callable[[], Any]) -> None:
        """Write a record of the run at intervals, which remains if the process is killed.

        ``solution()`` returns the run up to the complete rows in the files, whose number is `rows`.
        """
        begin = time.perf_counter()
        if begin >= self._next:
            self.write(solution(), files, rows, has_ended=False)
            end = time.perf_counter()
            self._next = end + max(_LEAST_PAUSE, (end - begin) / _LARGEST_SHARE)

    def write(self, solution: Any, files: MappedRows, rows: int, *, has_ended: bool) -> None:
        """Write the values of a `Solution` except its rows, whose number in the files is `rows`."""
        fields = {name: value for name, value in solution._kept().items() if name not in OF_STATES}
        fields |= {"_resume": solution._state, "labels": self.labels}
        rest = {"outputs": list(solution.outputs), "first_order": self.first_order, "has_ended": has_ended}
        rest |= {"rows": rows, "checksums": files.checksums(rows)}
        write(RUN, fields, self.directory / _RUN, is_lasting=has_ended, **rest)


def path_of(save_to: Any) -> Path:
    """Return the path that `save_to` names, which stays the same if the process goes to another directory."""
    if not isinstance(save_to, str | PathLike):
        raise TypeError(f"save_to must be the path of a directory, not {shown(save_to)}.")
    return Path(save_to).absolute()


def write(kind: str, fields: dict[str, Any], target: Path, *, is_lasting: bool = True, **rest: Any) -> Path:
    """Write the fields of an object of a kind, and `rest` in its record.

    The file is replaced as a whole or not at all; if `is_lasting`, also in a power failure.
    """
    if fields["method"].jacobian is not None:
        fields = fields | {"notes": (*fields["notes"], WITHOUT_JACOBIAN)}
    arrays: dict[str, np.ndarray] = {}
    plain = {name: _plain(value, name.lstrip("_"), arrays) for name, value in fields.items()}
    return _put(target, {"version": _VERSION, "kind": kind, "solution": plain, **rest}, arrays, is_lasting=is_lasting)


def keep_error(save_to: Any, error: ErrorEstimate) -> None:
    """Add the estimated errors of a run to the record in its directory."""
    target = path_of(save_to) / _RUN
    with target.open("rb") as stream:
        arrays = dict(_arrays(stream))
    record = json.loads(str(arrays.pop(_RECORD)))
    record["solution"]["error"] = _plain(error, "error", arrays)
    _put(target, record, arrays)


def _put(target: Path, record: Mapping[str, Any], arrays: dict[str, np.ndarray], *, is_lasting: bool = True) -> Path:
    """Write a record and its arrays to a file, as `write` describes."""
    arrays[_RECORD] = np.array(json.dumps(record))
    if not target.parent.is_dir():
        raise FileNotFoundError(f"No such file or directory: make the folder {target.parent} for {target.name} first.")
    temporary = target.with_name(f".{uuid.uuid4().hex}.part")
    try:
        with temporary.open("xb") as stream:
            np.savez(stream, **arrays)  # type: ignore[arg-type]
            stream.flush()
            if is_lasting:
                os.fsync(stream.fileno())  # a system may report only here that the disk is full
        _rename(temporary, target)
    except BaseException:
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise
    return target


def _rename(source: Path, target: Path) -> None:
    """Replace a file by another file. Windows refuses this while another process reads the file."""
    for _ in range(_TRIALS - 1):
        with contextlib.suppress(PermissionError):
            source.replace(target)
            return
        time.sleep(_PAUSE)
    source.replace(target)


def torn(directory: Path) -> list[Path]:
    """Return the files in a directory that a killed process has not written to their ends."""
    return list(directory.glob(f".{'[0-9a-f]' * 32}.part"))


def load(path: str | PathLike[str]) -> Any:
    """Read a file of `save`, or a directory of `save_to`, as `eig3.load` describes."""
    target = Path(path)
    for name, read in DIRECTORIES.items():
        if (target / name).is_file():
            return read(target.absolute())
    target = file(path)
    if Path(path).is_dir() and not target.exists():
        raise ValueError(f"{path} is not a directory that save_to has written: name such a directory, or a file.")
    return _read(target, _of_kind)


def fields_in(target: Path) -> dict[str, Any]:
    """Return the fields in a file, without an object of them."""
    return _read(target, _fields_of)


def _fields_of(record: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> dict[str, Any]:
    return {name: _value(plain, arrays) for name, plain in record["solution"].items()}


def _of_kind(
    record: Mapping[str, Any], arrays: Mapping[str, np.ndarray], given: Mapping[str, Any] | None = None
) -> Any:
    """Return the object with the fields of a record, and the fields `given`."""
    return KINDS[record["kind"]](_fields_of(record, arrays) | dict(given or {}))


def _load_directory(directory: Path) -> Any:
    """Read a directory. If its run ends at this moment, its files may change between two reads."""
    for _ in range(_TRIALS - 1):
        try:
            return _read(directory / _RUN, partial(_solution_in, directory))
        except DamagedFileError:
            time.sleep(_PAUSE)
    return _read(directory / _RUN, partial(_solution_in, directory))


def _solution_in(directory: Path, record: Mapping[str, Any], others: Mapping[str, np.ndarray]) -> Any:
    """Return the solution from the rows in a directory, and from its record and other arrays."""
    rows, files = record["rows"], output_files(record["outputs"])
    if not (isinstance(rows, int) and rows >= 0):
        raise ValueError(f"{rows} is not a number of rows.")
    checksums = {name: record["checksums"][name] for name in (*ROWS, *files.values()) if name in record["checksums"]}
    arrays = read_mapped(directory, checksums, rows)
    given: dict[str, Any] = {name: arrays.get(name) for name in ROWS}
    given["outputs"] = {name: arrays[file] for name, file in files.items()}
    names, shapes, is_read = record["first_order"]
    unknowns = FirstOrder(tuple(map(str, names)), tuple(tuple(map(int, shape)) for shape in shapes), bool(is_read))
    whole = given["u"], given["v"]
    given["u"], given["v"], given["z"] = unknowns.separated(*whole) if unknowns else (*whole, {})
    result = _of_kind(record, others, given)
    result._whole = whole if unknowns else None
    if not record["has_ended"]:
        result.status = Status.INTERRUPTED
        result.message = (
            f"The process of this run was killed after t = {result.t[-1]:g}, the last state here, or it is still "
            "running."
        )
    return result


def _read(target: Path, solution: Callable[[Mapping[str, Any], Mapping[str, np.ndarray]], Any]) -> Any:
    """Return the solution that a function makes from the record and the arrays of a file."""
    foreign = f"{target} is not a file that Solution.save has written, or it is damaged: name such a file."
    with target.open("rb") as stream:
        try:
            arrays = _arrays(stream)
            text = str(arrays[_RECORD])
        except Exception as error:  # many kinds, from zipfile, zlib and NumPy
            raise ValueError(foreign) from error
        try:
            record = json.loads(text)
            version = int(record["version"])
            if version == _VERSION:
                return solution(record, arrays)
        except _UnknownMethodError as error:
            raise ValueError(f"{target} {error}") from None
        except DamagedFileError:
            raise
        except Exception as error:
            raise DamagedFileError(target) from error
    raise ValueError(f"{target} has version {version} of its format, and not {_VERSION}: use the eig3 that wrote it.")


def _arrays(stream: Any) -> Mapping[str, np.ndarray]:
    """Return the arrays of a file, which are read on access."""
    arrays = np.load(stream, allow_pickle=False)
    if any(member.compress_type != zipfile.ZIP_STORED for member in arrays.zip.infolist()):
        raise ValueError("Solution.save compresses no array: it could be larger than memory.")
    return arrays


@contextlib.contextmanager
def going_on() -> Iterator[None]:
    """Convert errors while a run takes the state of a file to errors about the file."""
    try:
        yield
    except Exception as error:
        raise ValueError(
            f"the run cannot be continued from its file ({error}): give the functions of the run; if they are right, "
            "the file is damaged."
        ) from error


def file(path: str | PathLike[str]) -> Path:
    target = Path(path)
    return target if target.suffix == ".npz" else Path(f"{target}.npz")


def _plain(value: Any, key: str, arrays: dict[str, np.ndarray]) -> Any:
    """Return a value in JSON types; its arrays go to `arrays` under names that begin with `key`."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        arrays[key] = value
        return {"array": key}
    if isinstance(value, np.ndarray) and value.ndim == 1 and all(isinstance(one, str | Status) for one in value):
        return {"objects": _plain(value.tolist(), key, arrays)}
    if isinstance(value, Status):
        return {"status": value.name}
    if isinstance(value, Method):
        return _plain_method(value, key, arrays)
    if type(value) in PARTS.values():
        return {"part": type(value).__name__, "fields": _plain_all(_fields(value), key, arrays)}
    if isinstance(value, dict):
        values = _plain_all({str(i): item for i, item in enumerate(value.values())}, key, arrays)
        return {"names": list(value), "values": list(values.values())}
    if isinstance(value, tuple | list):
        if set(map(type, value)) == {str}:  # the names of many degrees of freedom
            return list(value)
        return list(_plain_all({str(i): item for i, item in enumerate(value)}, key, arrays).values())
    raise TypeError(f"{key} of the solution is of the type {type(value).__name__}, which a file cannot keep.")


def _plain_all(values: Mapping[str, Any], key: str, arrays: dict[str, np.ndarray]) -> dict[str, Any]:
    return {name: _plain(value, f"{key}.{name}", arrays) for name, value in values.items()}


def _plain_method(method: Method, key: str, arrays: dict[str, np.ndarray]) -> Any:
    cls = type(method)
    if _method_class(method.name, cls.__qualname__) is not cls:
        raise TypeError(f"the method {method!r} is not in eig3.METHODS: give its class {cls.__qualname__} a name.")
    options: dict[str, Any] = _fields(method) if dataclasses.is_dataclass(method) else {}
    options.pop("jacobian", None)
    origin = {"method": method.name, "class": cls.__qualname__, "module": cls.__module__}
    return {**origin, "options": _plain_all(options, key, arrays)}


def _method_class(name: str, qualname: str) -> Any:
    """Return the record class of this name, or None."""
    # "eig9" is a function that returns an EIG, and EIG(grade=3) has the name of another class.
    classes = (getattr(entry, "func", entry) for entry in (METHODS.get(name), *METHODS.values()))
    return next((cls for cls in classes if cls is not None and cls.__qualname__ == qualname), None)


def _fields(record: Any) -> dict[str, Any]:
    if isinstance(record, Extremes):
        return record._asdict()
    names = (field.name for field in dataclasses.fields(record))
    return {name: getattr(record, name) for name in names if name != "labels"}  # of occurrences: of their solution


def _value(plain: Any, arrays: Mapping[str, np.ndarray]) -> Any:
    """Return the value that `_plain` has described."""
    if isinstance(plain, list):
        return tuple(_value(item, arrays) for item in plain)
    if not isinstance(plain, dict):
        return plain
    if "array" in plain:
        return arrays[plain["array"]]
    if "objects" in plain:
        return np.array((*_value(plain["objects"], arrays), None), dtype=object)[:-1]  # never of texts or of two axes
    if "status" in plain:
        return Status[plain["status"]]
    if "names" in plain:
        return dict(zip(plain["names"], _value(plain["values"], arrays), strict=True))
    if "part" in plain:
        return PARTS[plain["part"]](**{name: _value(item, arrays) for name, item in plain["fields"].items()})
    return _method(plain, {name: _value(item, arrays) for name, item in plain["options"].items()})


def _method(plain: Mapping[str, Any], options: Mapping[str, Any]) -> Method:
    cls = _method_class(plain["method"], plain["class"])
    if cls is None:
        raise _UnknownMethodError(
            f"has a result of the method {plain['method']!r}: import its class {plain['class']} from the module "
            f"{plain['module']} before you load it."
        )
    return cls(**options)


DIRECTORIES[_RUN] = _load_directory
