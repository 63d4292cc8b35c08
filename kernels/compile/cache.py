"""Compiled code on the disk: Numba's cache, made to survive damaged files, full disks and folders that are read-only.

Numba keeps an index of a function's signatures in one file, and the machine code in others. It loads both as they are:
a damaged file raises an error in every later process, or crashes it. Here each signature has one file, which begins
with a checksum of its content, and an error of the cache is a warning: the function is then compiled in this process.

To load machine code is to run it. So a file is loaded only if nobody could write it, or in its folder, but this user,
root, and those who can write the source of the function, who could run code here anyway. Windows has no such owners and
modes: there, keep NUMBA_CACHE_DIR in a folder of your own.
"""

import contextlib
import functools
import glob
import hashlib
import os
import pickle
import shutil
import stat
import uuid
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numba

from .captured import digest, helpers_first
from .numba_internals import VERSIONS, DiskCache, NoFolderError, has_numbas_cache, set_cache

try:
    import grp
    import pwd
except ImportError:  # Windows
    _HAS_OWNERS = False
else:
    _HAS_OWNERS = True

#: Who can write a file or in a folder: a user or a group, with its number, or any user.
Writer = tuple[str, int | str]

_CHECKSUM_BYTES = 32
_NEW_FILE = 0o644  # less what the umask takes: no one else may write the file
_ROOT: frozenset[Writer] = frozenset({("user", 0), ("group", 0)})
_warned: set[str] = set()


class _UntrustedError(Exception):
    """Other users could write what would be loaded."""


class CheckedCache(DiskCache):
    """The cache of one function."""

    def open_files(self, folder: Path, name: str, source_stamp: Any) -> Any:
        return _Files(folder, name, source_stamp, _trusted(self.function.__code__.co_filename))

    def more_of_key(self) -> Any:
        """The values of global variables, which are compiled into the function."""
        return digest(self.function)

    def failed(self, what: str, error: Exception) -> None:
        _warn(what, self.files.folder, error)


class _Files:
    """The files of one function: one for each signature, version of the source, processor and version of Numba."""

    def __init__(self, folder: Path, name: str, source_stamp: Any, trusted: frozenset[Writer]) -> None:
        self.folder, self._name = folder, name
        self._stamp, self._trusted = source_stamp, trusted
        # Code that checks indices must not be taken for code that does not.
        self._versions = *VERSIONS, numba.config.BOUNDSCHECK

    def _path(self, key: Any) -> Path:
        return self.folder / f"{self._name}.{_digest(self._stamp)}.{_digest(key)}.nbc"

    def load(self, key: Any) -> Any:
        key = key, self._versions
        path = self._path(key)
        try:
            with self._only_trusted() as folder, open(path, "rb", opener=_opener_in(folder)) as file:
                self._check_writers(file.fileno(), path)
                content = file.read()
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
            with self._only_trusted(), open(temporary, "xb", opener=_open_new) as file:
                file.write(hashlib.sha256(content).digest() + content)
            temporary.replace(path)  # at once, so that no other process reads a part of the file
        except BaseException:
            with contextlib.suppress(OSError):
                temporary.unlink()
            raise
        for other in self._all():
            if not other.name.startswith(f"{self._name}.{_digest(self._stamp)}."):  # of the source before an edit
                other.unlink(missing_ok=True)

    def flush(self) -> None:
        """Delete all files of the function. `recompile` of the jitted function calls this."""
        for path in self._all():
            path.unlink(missing_ok=True)

    def _all(self) -> Iterator[Path]:
        return self.folder.glob(f"{glob.escape(self._name)}.*.nbc")

    @contextlib.contextmanager
    def _only_trusted(self) -> Iterator[int | None]:
        """Open the folder if nobody else can write there, and give its descriptor; None on Windows."""
        if not _HAS_OWNERS:
            yield None
            return
        folder = os.open(self.folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            self._check_writers(folder, self.folder)
            yield folder
        finally:
            os.close(folder)

    def _check_writers(self, descriptor: int, path: Path) -> None:
        """Refuse what others can write. The descriptor is that of the open file: a path may change its meaning."""
        others = sorted(_writers(os.fstat(descriptor)) - self._trusted) if _HAS_OWNERS else []
        if others:
            raise _UntrustedError(f"{', '.join(f'{kind} {number}' for kind, number in others)} can write {path}")


def _writers(status: os.stat_result) -> frozenset[Writer]:
    found: set[Writer] = {("user", status.st_uid)}
    if status.st_mode & stat.S_IWGRP:
        found.add(("group", status.st_gid))
    if status.st_mode & stat.S_IWOTH:
        found.add(("any", "user"))
    return frozenset(found)


@functools.cache
def _trusted(source: str) -> frozenset[Writer]:
    """Whose machine code is loaded for the functions of a source file."""
    if not _HAS_OWNERS:
        return frozenset()
    with contextlib.suppress(OSError):  # a cell of a notebook has no file
        return _ROOT | _this_user() | _writers(Path(source).stat())
    return _ROOT | _this_user()


def _this_user() -> frozenset[Writer]:
    """This user, and the private group of the same name that many systems give to each user."""
    user: Writer = "user", os.geteuid()
    with contextlib.suppress(KeyError):  # in a container, a user may have no name
        entry = pwd.getpwuid(os.geteuid())
        group = grp.getgrgid(entry.pw_gid)
        if group.gr_name == entry.pw_name and set(group.gr_mem) <= {entry.pw_name}:
            return frozenset({user, ("group", group.gr_gid)})
    return frozenset({user})


def _open_new(path: str, flags: int) -> int:
    return os.open(path, flags, _NEW_FILE)


def _opener_in(folder: int | None) -> Any:
    """An opener for files of an open folder."""
    if folder is None:
        return None
    return lambda path, flags: os.open(Path(path).name, flags, dir_fd=folder)


def _digest(value: Any) -> str:
    return hashlib.sha256(repr(value).encode()).hexdigest()[:16]


def keep_on_disk(function: Any) -> Any:
    """Give a jitted function, which is not compiled yet, a cache on the disk; return the function."""
    try:
        set_cache(function, CheckedCache(function.py_func))
    except NoFolderError as error:
        _warn("keep", "any folder", error)
    return function


def check_cache(function: Any) -> None:
    """Give a jitted function of a user, and those that it calls, a `CheckedCache` in place of Numba's cache."""
    for each, _ in helpers_first(function):
        if has_numbas_cache(each):
            keep_on_disk(each)


def folder_of(function: Any) -> Path:
    """Return the folder for the compiled code of a function, and of all others in files of the same folder.

    Raises
    ------
    NoFolderError
        If no folder can be written.
    """
    return CheckedCache(function).files.folder


def clear(folder: Path) -> int:
    """Delete compiled code in a folder, and return the number of files. Of a link there, only the link is deleted.

    Raises
    ------
    OSError
        If the folder itself is a link, or if a file cannot be deleted. The other files are deleted.
    """
    if folder.is_symlink():
        raise OSError(
            f"{folder} is a link to {folder.resolve()}: nothing is deleted there; delete the link or its files"
        )
    deleted, failures = 0, []
    for path in (path for pattern in ("*.nbi", "*.nbc", "*.nbc.*") for path in folder.glob(pattern)):
        try:
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)
        except OSError as error:
            failures.append(f"{path.name} ({error.strerror or error})")
        else:
            deleted += 1
    if failures:
        raise OSError(f"{folder}: {deleted} files deleted, but not {', '.join(failures)}")
    return deleted


def _warn(what: str, folder: Any, error: Exception) -> None:
    """Warn once in a process: all functions of a folder usually have the same problem."""
    if _warned:
        return
    _warned.add(what)
    reason = str(error) or type(error).__name__
    remedy = "delete the .nbc files there (`eig3 cache --clear` does this in the folders of eig3)"
    if isinstance(error, _UntrustedError):
        remedy = "make the folder and these files your own (chown, chmod go-w)"
    warnings.warn(
        f"eig3 cannot {what} compiled code in {folder} ({reason}), so it is compiled in this process: {remedy}, or "
        "choose another folder with the environment variable NUMBA_CACHE_DIR.",
        RuntimeWarning,
        stacklevel=2,
    )
