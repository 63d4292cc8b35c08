"""Compiled code on the disk: Numba's cache, made to find functions by their content, and to survive damaged files.

Numba finds a function by its file and its line: not one of a scene, and not one whose helper in another file has
changed. It keeps an index of a function's signatures in one file, and the machine code in others, and loads both as
they are: a damaged file raises an error in every later process, or crashes it. Here all functions have one folder, and
each signature one file, whose name is a digest of all that the machine code depends on. The file begins with a checksum
of what follows, and an error of the cache is a warning: the function is then compiled in this process.

To load machine code is to run it. So a file is loaded only if nobody could write it, or in its folder, but this user,
root, and those who can write the source of this library, who could run code here anyway. Windows has no such owners and
modes: there, keep NUMBA_CACHE_DIR in a folder of your own.
"""

import contextlib
import functools
import hashlib
import itertools
import os
import pickle
import shutil
import stat
import uuid
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba

from .captured import helpers_first
from .content import content, fingerprint
from .numba_internals import PATCHES, VERSIONS, DiskCache, NoFolderError, has_numbas_cache, set_cache

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
_MOST_BYTES = 2**29  # of compiled code
_TIDIED = 100  # files of this number are written between two looks at all files
_saves = itertools.count()
_NEW_FILE = 0o644  # less what the umask takes: no one else may write the file
_ROOT: frozenset[Writer] = frozenset({("user", 0), ("group", 0)})
_warned: set[str] = set()


class _UntrustedError(Exception):
    """Other users could write what would be loaded."""


class CheckedCache(DiskCache):
    """The cache of one function; `describe` is as for `DiskCache`.

    `name` tells the function from all others. Without it, the content of the function does. `variant` tells the code
    from other code of the same function.
    """

    def __init__(
        self, function: Any, name: str = "", variant: str = "", describe: Callable[[Any], str] = lambda result: ""
    ) -> None:
        super().__init__(folder_of_all, describe)
        self._function, self._name, self._variant = function, name, variant

    def open_files(self, folder: Path) -> Any:
        return _Files(folder, fingerprint(), _trusted(__file__))

    def find_key(self) -> str:
        if self._name:
            return self._name
        for each, _ in helpers_first(self._function):
            made = getattr(each.py_func, "made", None)
            # Code that is loaded needs the symbols of what it calls. To ask for its own would compile it, and so on.
            if made and getattr(made, "function", None) is not self._function:
                made()
        found = content(self._function)
        return found and f"{found} {self._variant}"

    def failed(self, what: str, error: Exception) -> None:
        _warn(what, error, self.files.folder)


def folder_of_all() -> None:
    """Stand for all functions: their compiled code is where Numba would keep the code of this function."""


class _Files:
    """The files of a folder: one for each function, signature, processor and version of Numba."""

    def __init__(self, folder: Path, stamp: str, trusted: frozenset[Writer]) -> None:
        self.folder, self._stamp, self._trusted = folder, stamp, trusted
        # Code that checks indices must not be taken for code that does not.
        self._versions = *VERSIONS, numba.config.BOUNDSCHECK, *sorted(PATCHES)

    def _path(self, key: Any) -> Path:
        digest = hashlib.sha256(repr(key).encode()).hexdigest()[:16]
        return self.folder / f"eig3.{self._stamp}.{digest}.nbc"

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
        if found != key:  # two types may have the same text
            return None
        with contextlib.suppress(OSError):
            os.utime(path)  # the files that were not used for the longest time go first
        return result

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
        if next(_saves) % _TIDIED == 0:
            self._tidy()

    def _tidy(self) -> None:
        """Delete the files of another version of the library, and those not used for long if all take much room."""
        found = []
        for path in self.folder.glob("eig3.*.nbc"):
            with contextlib.suppress(OSError):  # another process may delete it first
                found.append((path.stat().st_mtime, path.stat().st_size, path))
        room = _MOST_BYTES
        for _, size, path in sorted(found, reverse=True):
            room -= size
            if room < 0 or not path.name.startswith(f"eig3.{self._stamp}."):
                path.unlink(missing_ok=True)

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
        """Refuse what others can write. The descriptor belongs to the open file: a path may change its meaning."""
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


def keep_on_disk(function: Any, name: str = "", **options: Any) -> Any:
    """Give a jitted function, which is not compiled yet, a `CheckedCache`; return the function."""
    try:
        set_cache(function, CheckedCache(function, name, **options))
    except NoFolderError as error:
        _warn("keep", error)
    return function


def check_cache(function: Any) -> None:
    """Give a jitted function of a user, and those that it calls, a `CheckedCache` in place of Numba's cache."""
    for each, _ in helpers_first(function):
        if has_numbas_cache(each):
            keep_on_disk(each)


def folder() -> Path:
    """Return the folder for compiled code.

    Raises
    ------
    NoFolderError
        If no folder can be written.
    """
    return CheckedCache(None).files.folder


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


def _warn(what: str, error: Exception, folder: Path | None = None) -> None:
    """Warn once in a process: all functions of a folder usually have the same problem."""
    if _warned:
        return
    _warned.add(what)
    where = f" in {folder}" if folder else ""
    remedy = "delete the .nbc files there (`eig3 cache --clear` does this in the folder of eig3), or "
    if isinstance(error, _UntrustedError):
        remedy = "make the folder and these files your own (chown, chmod go-w), or "
    elif isinstance(error, NoFolderError):
        remedy = ""
    warnings.warn(
        f"eig3 cannot {what} compiled code{where} ({str(error) or type(error).__name__}), so it is compiled in this "
        f"process: {remedy}choose another folder with the environment variable NUMBA_CACHE_DIR.",
        RuntimeWarning,
        stacklevel=2,
    )
