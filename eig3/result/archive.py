"""Files of results: arrays of NumPy, and a record in JSON of the rest. Nothing is pickled."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import time
import uuid
import zipfile
from collections.abc import Callable, Iterator, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from ..functions.events import Occurrences
from ..functions.extremes import Extremes
from ..methods import METHODS, Method
from .labels import Labels
from .mapped import DamagedFileError
from .status import Status

_VERSION = 5  # raise it with every change that another eig3 would read wrongly
_RECORD = "eig3"  # the name of the record among the arrays
TRIALS, PAUSE = 5, 0.02  # to read or replace a file that another process uses, and the seconds between them
#: The records that a file may have among its values, by name.
PARTS: dict[str, Any] = {kind.__name__: kind for kind in (Extremes, Labels, Occurrences)}
WITHOUT_JACOBIAN = "The jacobian of the method is a function, which a file does not keep: give it again for a new run."


class _UnknownMethodError(ValueError):
    """The file is sound, but the class of its method is not known."""


def write(method: Method, state: dict[str, Any], target: Path, *, is_lasting: bool = True, **rest: Any) -> Path:
    """Write fields to a file, `rest` has the kind of a file that is not one of a `Solution`."""
    if method.jacobian is not None:
        state["notes"] = *state["notes"], WITHOUT_JACOBIAN
    arrays: dict[str, np.ndarray] = {}
    fields = {name: _plain(value, name.lstrip("_"), arrays) for name, value in state.items()}
    arrays[_RECORD] = np.array(json.dumps({"version": _VERSION, "solution": fields, **rest}))
    temporary = target.with_name(f".{uuid.uuid4().hex}.part")
    try:
        with temporary.open("xb") as stream:
            np.savez(stream, **arrays)  # type: ignore[arg-type]
            stream.flush()
            if is_lasting:
                os.fsync(stream.fileno())  # a system may find only now that the disk is full
        _rename(temporary, target)
    except BaseException:
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise
    return target


def _rename(source: Path, target: Path) -> None:
    """Replace a file by another one. Windows refuses this while another process reads the file."""
    for _ in range(TRIALS - 1):
        with contextlib.suppress(PermissionError):
            source.replace(target)
            return
        time.sleep(PAUSE)
    source.replace(target)


def read(target: Path, make: Callable[[Mapping[str, Any], Mapping[str, np.ndarray]], Any]) -> Any:
    """Return the solution that a function makes from the record and the arrays of a file."""
    foreign = f"{target} is not a file that Solution.save has written, or it is damaged: name such a file."
    with target.open("rb") as stream:
        try:
            arrays = _Members(stream)
            text = str(arrays[_RECORD])
        except Exception as error:  # many kinds, from zipfile, zlib and NumPy
            raise ValueError(foreign) from error
        try:
            record = json.loads(text)
            version = int(record["version"])
            if version == _VERSION:
                return make(record, arrays)
        except _UnknownMethodError as error:
            raise ValueError(f"{target} {error}") from None
        except DamagedFileError:
            raise
        except Exception as error:
            raise DamagedFileError(target) from error
    raise ValueError(f"{target} has version {version} of its format, and not {_VERSION}: use the eig3 that wrote it.")


class _Members(Mapping[str, np.ndarray]):
    """The arrays of a file, which are read when they are asked for. A compressed one could be larger than memory."""

    def __init__(self, file: Any) -> None:
        self._content = np.load(file, allow_pickle=False)
        if any(member.compress_type != zipfile.ZIP_STORED for member in self._content.zip.infolist()):
            raise ValueError("Solution.save compresses no array.")

    def __getitem__(self, name: str) -> np.ndarray:
        return self._content[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._content)

    def __len__(self) -> int:
        return len(self._content)


def file(path: str | PathLike[str]) -> Path:
    target = Path(path)
    return target if target.suffix == ".npz" else target.with_name(f"{target.name}.npz")


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
    if type(value) in PARTS.values():
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


def value(plain: Any, arrays: Mapping[str, np.ndarray]) -> Any:
    """Return the value that `_plain` has described."""
    if isinstance(plain, list):
        return tuple(value(item, arrays) for item in plain)
    if not isinstance(plain, dict):
        return plain
    if "array" in plain:
        return arrays[plain["array"]]
    if "status" in plain:
        return Status[plain["status"]]
    if "names" in plain:
        return dict(zip(plain["names"], value(plain["values"], arrays), strict=True))
    if "part" in plain:
        return PARTS[plain["part"]](**{name: value(item, arrays) for name, item in plain["fields"].items()})
    return _method(plain, {name: value(item, arrays) for name, item in plain["options"].items()})


def _method(plain: Mapping[str, Any], options: Mapping[str, Any]) -> Method:
    cls = _method_class(plain["method"], plain["class"])
    if cls is None:
        raise _UnknownMethodError(
            f"has a result of the method {plain['method']!r}: import its class {plain['class']} from the module "
            f"{plain['module']} before you load it."
        )
    return cls(**options)
