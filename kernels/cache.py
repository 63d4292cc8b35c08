"""Compiled code on the disk: Numba's cache, made to survive damaged files, full disks and folders that are read-only.

Numba keeps an index of a function's signatures in one file, and the machine code in others. It loads both as they are:
a damaged file raises an error in every later process, or crashes it. Here each signature has one file, which begins
with a checksum of its content, and an error of the cache is a warning: the function is then compiled in this process.
"""

import contextlib
import glob
import hashlib
import pickle
import shutil
import uuid
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import llvmlite
import numba
from numba.core.caching import FunctionCache

from .captured import digest

_CHECKSUM_BYTES = 32
_warned: set[str] = set()


class CheckedCache(FunctionCache):
    """The cache of one function."""

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        source_stamp = self._impl.locator.get_source_stamp()
        self._cache_file: Any = _Files(Path(self._cache_path), self._impl.filename_base, source_stamp)

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        """Numba's key does not have the values of global variables, which are compiled into the function."""
        return *super()._index_key(sig, codegen), digest(self._py_func)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)
        except Exception as error:
            _warn("load", self._cache_path, error)
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            super().save_overload(sig, data)
        except Exception as error:
            _warn("keep", self._cache_path, error)


class _Files:
    """The files of one function: one for each signature, version of the source, processor and version of Numba."""

    def __init__(self, folder: Path, name: str, source_stamp: Any) -> None:
        self._folder, self._name = folder, name
        self._stamp = source_stamp
        # Code that checks indices must not be taken for code that does not.
        self._versions = numba.__version__, llvmlite.__version__, numba.config.BOUNDSCHECK

    def _path(self, key: Any) -> Path:
        return self._folder / f"{self._name}.{_digest(self._stamp)}.{_digest(key)}.nbc"

    def load(self, key: Any) -> Any:
        key = key, self._versions
        path = self._path(key)
        try:
            content = path.read_bytes()
        except FileNotFoundError:
            return None
        checksum, data = content[:_CHECKSUM_BYTES], content[_CHECKSUM_BYTES:]
        if checksum != hashlib.sha256(data).digest():
            path.unlink()
            raise ValueError(f"{path.name} was damaged")
        found, result = pickle.loads(data)
        return result if found == key else None  # two types may have the same text

    def save(self, key: Any, data: Any) -> None:
        key = key, self._versions
        content = pickle.dumps((key, data))
        path = self._path(key)
        temporary = path.with_name(f"{path.name}.{uuid.uuid4().hex[:16]}")
        try:
            temporary.write_bytes(hashlib.sha256(content).digest() + content)
            temporary.replace(path)  # at once, so that no other process reads a part of the file
        except BaseException:
            with contextlib.suppress(OSError):
                temporary.unlink()
            raise
        for other in self._all():
            if not other.name.startswith(f"{self._name}.{_digest(self._stamp)}."):  # of the source before an edit
                other.unlink(missing_ok=True)

    def flush(self) -> None:
        """Delete all files of the function. `Dispatcher.recompile` calls this."""
        for path in self._all():
            path.unlink(missing_ok=True)

    def _all(self) -> Iterator[Path]:
        return self._folder.glob(f"{glob.escape(self._name)}.*.nbc")


def _digest(value: Any) -> str:
    return hashlib.sha256(repr(value).encode()).hexdigest()[:16]


def keep_on_disk(function: Any) -> Any:
    """Give a jitted function, which is not compiled yet, a cache on the disk; return the function."""
    try:
        function._cache = CheckedCache(function.py_func)
    except RuntimeError as error:
        if "no locator available" not in str(error):
            raise
        _warn("keep", "any folder", error)
    return function


def check_cache(function: Any) -> None:
    """Give a jitted function of a user that has Numba's cache a `CheckedCache` instead."""
    if type(function._cache) is FunctionCache:
        keep_on_disk(function)


def folder_of(function: Any) -> Path:
    """Return the folder for the compiled code of a function, and of all others in files of the same folder.

    Raises
    ------
    RuntimeError
        If no folder can be written.
    """
    return Path(CheckedCache(function).cache_path)


def clear(folder: Path) -> int:
    """Delete compiled code in a folder, and return the number of files."""
    paths = [path for pattern in ("*.nbi", "*.nbc", "*.nbc.*") for path in folder.glob(pattern)]
    for path in paths:
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
    return len(paths)


def _warn(what: str, folder: str, error: Exception) -> None:
    """Warn once in a process: all functions of a folder usually have the same problem."""
    if _warned:
        return
    _warned.add(what)
    reason = str(error) or type(error).__name__
    warnings.warn(
        f"eig3 cannot {what} compiled code in {folder} ({reason}), so it is compiled in this process: delete the .nbc "
        "files there (`eig3 cache --clear` does this in the folders of eig3), or choose another folder with the "
        "environment variable NUMBA_CACHE_DIR.",
        RuntimeWarning,
        stacklevel=2,
    )
