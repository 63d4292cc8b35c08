"""Solutions in files and directories: arrays of NumPy, and a record in JSON of the rest. Nothing is pickled."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import uuid
from collections.abc import Callable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from .events import Occurrences
from .extremes import Extremes
from .labels import Labels
from .mapped import check_directory, read_mapped
from .methods import METHODS, Method, shown
from .solution import Solution, Status

_VERSION = 1  # raise it with every change that an older eig3 would read wrongly
_RECORD = "eig3"  # the name of the record among the arrays
_RUN = "run.npz"  # the file with everything but the rows, in a directory of `save_to`
_ROWS = ("t", "u", "v", "steps")  # the fields whose rows have files of their own there
_FIELDS = {field.name: field for field in dataclasses.fields(Solution)}
_PARTS = {kind.__name__: kind for kind in (Extremes, Labels, Occurrences)}
_WITHOUT_JACOBIAN = "The jacobian of the method is a function, which a file does not keep: give it again for a new run."


class _UnknownMethodError(ValueError):
    """The file is sound, but the class of its method is not known."""


def save(solution: Solution, path: str | PathLike[str]) -> Path:
    """Write a solution to a file, as `Solution.save` describes it."""
    return _write(solution, solution.__getstate__(), _file(path))


@dataclasses.dataclass(frozen=True)
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

    @classmethod
    def of(cls, save_to: Any, labels: Labels | None = None, integrals: tuple[str, ...] = ()) -> Place:
        """Return the place that `save_to` names, which must be a new or an empty directory."""
        if isinstance(save_to, Place):
            return save_to
        if not isinstance(save_to, str | PathLike):
            raise TypeError(f"save_to must be the path of a directory, not {shown(save_to)}.")
        directory = Path(save_to)
        check_directory(directory)
        return cls(directory, labels, integrals)

    def write(self, solution: Solution, *, has_ended: bool) -> None:
        """Write what a solution has beside its rows."""
        state = {name: None if name in _ROWS else value for name, value in vars(solution).items()}
        state |= {
            "reason": None,
            "_accelerations": None,
            "_extend": None,
            "_between": None,
            "_knots": None,
            "labels": self.labels,
        }
        rest = {"integrals": self.integrals, "has_ended": has_ended}
        _write(solution, state, self.directory / _RUN, **rest)


def _write(solution: Solution, values: Mapping[str, Any], target: Path, **rest: Any) -> Path:
    """Write the values of the fields of a solution, and `rest` in the record beside them."""
    state = {name: value for name, value in values.items() if name in _FIELDS}
    if solution.method.jacobian is not None:
        state["notes"] = *solution.notes, _WITHOUT_JACOBIAN
    arrays: dict[str, np.ndarray] = {}
    fields = {name: _plain(value, name.lstrip("_"), arrays) for name, value in state.items()}
    arrays[_RECORD] = np.array(json.dumps({"version": _VERSION, "solution": fields, **rest}))
    temporary = target.with_name(f".{uuid.uuid4().hex}.part")
    try:
        with temporary.open("xb") as file:
            np.savez(file, **arrays)  # type: ignore[arg-type]
            file.flush()
            os.fsync(file.fileno())  # a system may find only now that the disk is full
        temporary.replace(target)
    except BaseException:
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise
    return target


def load(path: str | PathLike[str]) -> Solution:
    """Read a solution that `Solution.save` or a run with `save_to` has written.

    Parameters
    ----------
    path : str or path
        The file, to which ".npz" is added if it does not end with this, or the directory of `save_to`.

    Returns
    -------
    Solution
        With every number as it was saved. It has no right-hand side: `explain` returns what it had found before, and
        `at` takes the saved accelerations. A directory has none of these, so that `at` is a cubic polynomial. Its t, u
        and v are maps of the files that can only be read. If the process of its run was killed, or is still running,
        the status is INTERRUPTED, and the solution has the states up to then, with its counts, but without `drift`,
        `extremes`, `outputs`, `events` and `notes`.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it is not a file of `Solution.save`, is damaged or comes from a newer eig3, or if its method is a class of
        the user that is not imported yet.
    """
    target = Path(path)
    if (target / _RUN).is_file():
        return _load_directory(target)
    target = _file(path)
    if Path(path).is_dir() and not target.exists():
        raise ValueError(f"{path} is not a directory that save_to has written: name such a directory, or a file.")
    return _read(target, lambda record, arrays: _solution(record["solution"], arrays))


def _load_directory(directory: Path) -> Solution:
    def solution(record: Mapping[str, Any], others: Mapping[str, np.ndarray]) -> Solution:
        rows, counts = read_mapped(directory, _ROWS)
        result = _solution({**record["solution"], **dict.fromkeys(_ROWS)}, others)
        result.t, result.u, result.v, result.steps = rows["t"], rows["u"], rows["v"], rows.get("steps")
        if not record["has_ended"]:
            vars(result).update(counts)
            if result.steps is not None:  # with tolerances, h is the mean of the steps
                result.h = float(result.t[-1] - result.t[0]) / max(1, result.n_steps)
            result.status = Status.INTERRUPTED
            result.message = (
                f"The process of this run was killed after t = {result.t[-1]:g}, the last state here, or it is still "
                "running."
            )
        if record["integrals"]:
            result._separate(record["integrals"])
        return result

    return _read(directory / _RUN, solution)


def _read(target: Path, solution: Callable[[Mapping[str, Any], Mapping[str, np.ndarray]], Solution]) -> Solution:
    """Return the solution that a function makes from the record and the arrays of a file."""
    with target.open("rb") as file:
        arrays = _arrays(file, target)
    try:
        record = json.loads(str(arrays.pop(_RECORD)))
        version = int(record["version"])
        if version <= _VERSION:
            return solution(record, arrays)
    except _UnknownMethodError as error:
        raise ValueError(f"{target} {error}") from None
    except Exception as error:
        raise ValueError(f"{target} is damaged: take a copy of it, or run again.") from error
    raise ValueError(f"{target} was written by a newer eig3, in version {version} of its format: update eig3.")


def _file(path: str | PathLike[str]) -> Path:
    target = Path(path)
    return target if target.suffix == ".npz" else target.with_name(f"{target.name}.npz")


def _arrays(file: Any, path: Path) -> dict[str, np.ndarray]:
    foreign = f"{path} is not a file that Solution.save has written, or it is damaged: name such a file."
    try:
        content = np.load(file, allow_pickle=False)
        arrays = dict(content)
    except Exception as error:  # many kinds, from zipfile, zlib and NumPy
        raise ValueError(foreign) from error
    if _RECORD not in arrays:
        raise ValueError(foreign)
    return arrays


def _solution(fields: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> Solution:
    state = {name: _value(plain, arrays) for name, plain in fields.items()}
    found = {name: state.pop(name) for name in [*state] if not _FIELDS[name].init}
    solution = Solution(**state)
    vars(solution).update(found)
    return solution


def _plain(value: Any, key: str, arrays: dict[str, np.ndarray]) -> Any:
    """Return a value as JSON has it, with its arrays put into `arrays` under names that begin with `key`."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        arrays[key] = value
        return {"array": key}
    if isinstance(value, Status):
        return {"status": value.name}
    if isinstance(value, Method):
        return _plain_method(value, key, arrays)
    if type(value) in _PARTS.values():
        return {"part": type(value).__name__, "fields": _plain_all(_fields(value), key, arrays)}
    if isinstance(value, dict):
        values = _plain_all({str(i): item for i, item in enumerate(value.values())}, key, arrays)
        return {"names": list(value), "values": list(values.values())}
    if isinstance(value, tuple | list):
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
    # "eig9" stands for a function that makes an EIG, and EIG(grade=3) has the name of another class.
    classes = (getattr(entry, "func", entry) for entry in (METHODS.get(name), *METHODS.values()))
    return next((cls for cls in classes if cls is not None and cls.__qualname__ == qualname), None)


def _fields(record: Any) -> dict[str, Any]:
    if isinstance(record, Extremes):
        return record._asdict()
    return {field.name: getattr(record, field.name) for field in dataclasses.fields(record)}


def _value(plain: Any, arrays: Mapping[str, np.ndarray]) -> Any:
    """Return the value that `_plain` has described."""
    if isinstance(plain, list):
        return tuple(_value(item, arrays) for item in plain)
    if not isinstance(plain, dict):
        return plain
    if "array" in plain:
        return arrays[plain["array"]]
    if "status" in plain:
        return Status[plain["status"]]
    if "names" in plain:
        return dict(zip(plain["names"], _value(plain["values"], arrays), strict=True))
    if "part" in plain:
        return _PARTS[plain["part"]](**{name: _value(item, arrays) for name, item in plain["fields"].items()})
    return _method(plain, {name: _value(item, arrays) for name, item in plain["options"].items()})


def _method(plain: Mapping[str, Any], options: Mapping[str, Any]) -> Method:
    cls = _method_class(plain["method"], plain["class"])
    if cls is None:
        raise _UnknownMethodError(
            f"has a result of the method {plain['method']!r}: import its class {plain['class']} from the module "
            f"{plain['module']} before you load it."
        )
    return cls(**options)
