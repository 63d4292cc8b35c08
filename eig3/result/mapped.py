"""Rows of numbers in memory-mapped .npy files, which may be larger than memory and survive a killed process."""

from __future__ import annotations

import errno
import io
import os
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import BinaryIO

import numpy as np

from ..kernels.checksum import checksum

_MOST_BYTES = 2**26  # the largest space reserved at a time in a growing file
_NO_FALLOCATE = (errno.EOPNOTSUPP, errno.EINVAL, errno.ENOSYS)  # errors of a file system that cannot reserve space


def check_directory(path: Path, besides: Collection[Path] = ()) -> None:
    """Raise a FileExistsError if the files of a run could overwrite something, other than the files `besides`."""
    if path.exists() and (not path.is_dir() or any(each not in besides for each in path.iterdir())):
        raise _taken(path, "holds files" if path.is_dir() else "is a file")


def output_files(names: Iterable[str]) -> dict[str, str]:
    """Return the file names of outputs, whose names may have any character."""
    return {name: f"outputs.{k}" for k, name in enumerate(names)}


def _taken(path: Path, what: str) -> FileExistsError:
    return FileExistsError(f"save_to must name a new or an empty directory, but {path} {what}: name another one.")


class DamagedFileError(ValueError):
    """The content of a file differs from what was written."""

    def __init__(self, path: Path) -> None:
        super().__init__(f"{path} is damaged: take a copy of it, or run again.")


class MappedRows:
    """Arrays whose rows are in the files of a directory, one .npy file for each array.

    Until `close`, the header of a file has the number of reserved rows. The number of complete rows is in the record of
    the run.

    Parameters
    ----------
    directory : Path
        It is created if it does not exist.
    shapes : dict of str to tuple of int
        The shape of a row of each array, by the names of the arrays.
    rows : int
        Number of rows to reserve.

    Attributes
    ----------
    arrays : dict of str to ndarray
        The reserved rows. `grow` and `reserve` replace these arrays by longer arrays, and `close` by shorter arrays.
    count : int
        Number of complete rows.

    Raises
    ------
    FileExistsError
        If the directory is not empty, or another run begins in it at the same time.
    OSError
        If the disk is full. No file is left.
    """

    def __init__(self, directory: Path, shapes: Mapping[str, tuple[int, ...]], rows: int) -> None:
        check_directory(directory)
        directory.mkdir(parents=True, exist_ok=True)
        self.directory, self.count = directory, 0
        self._files: dict[str, _RowFile] = {}
        try:
            for name, shape in shapes.items():
                self._files[name] = _RowFile(directory / f"{name}.npy", shape)
            self.reserve(rows)
        except FileExistsError:  # the system lets only one run create each file
            self.remove()
            raise _taken(directory, "holds the files of another run, which began at the same time") from None
        except BaseException:
            self.remove()
            raise

    def remove(self) -> None:
        """Remove the files."""
        for file in self._files.values():
            file.remove()

    def reserve(self, rows: int) -> None:
        """Reserve the space of this number of rows on the disk.

        Raises
        ------
        OSError
            If the disk is full. The existing rows do not change.
        """
        try:
            for file in self._files.values():
                file.reserve(rows)
        except OSError as error:
            needed = sum(file.row_bytes for file in self._files.values()) * rows
            raise OSError(
                error.errno,
                f"the history in {self.directory} needs {needed:.3g} bytes for {rows} rows, and the disk has no "
                f"space ({error.strerror}); free some, or take a larger save_every or a directory on another disk",
            ) from error
        self._refer()

    def grow(self) -> None:
        """Reserve space for about twice as many rows.

        Raises
        ------
        OSError
            If the disk is full. The existing rows do not change.
        """
        held = min(len(array) for array in self.arrays.values())
        most = _MOST_BYTES // max(file.row_bytes for file in self._files.values())
        self.reserve(held + min(max(held, 4), max(4, most)))

    def checksums(self, rows: int) -> dict[str, int]:
        """Return the checksum of the first `rows` rows of each array, for `read_mapped`."""
        return {name: file.checksum(rows) for name, file in self._files.items()}

    def close(self) -> None:
        """Cut the files after the last row. The arrays are then read-only maps of the files."""
        for file in self._files.values():
            file.close(self.count)
        self._refer()

    def _refer(self) -> None:
        self.arrays = {name: file.array for name, file in self._files.items()}


def read_mapped(directory: Path, checksums: Mapping[str, int], rows: int) -> dict[str, np.ndarray]:
    """Return the first `rows` rows as read-only arrays. They are read once to verify their checksums, by array.

    Raises
    ------
    DamagedFileError
        If a file does not have these rows, or has other values than the run has written.
    """
    arrays = {}
    for name, expected in checksums.items():
        path = directory / f"{name}.npy"
        try:
            array = np.load(path, mmap_mode="r")
            has_rows = array.dtype == np.float64 and array.flags.aligned and len(array) >= rows
            is_sound = has_rows and checksum(array[:rows]) == expected
        except Exception as error:  # many kinds of errors, from the header of a file
            raise DamagedFileError(path) from error
        if not is_sound:
            raise DamagedFileError(path)
        arrays[name] = array[:rows]
    return arrays


class _RowFile:
    """A .npy file of float64 whose number of rows can change."""

    def __init__(self, path: Path, shape: tuple[int, ...]) -> None:
        self.path, self._shape = path, shape
        self.row_bytes = 8 * int(np.prod(shape))
        self._file: BinaryIO = path.open("x+b", buffering=0)
        self._offset = self._write_header(0)
        self.array = np.empty((0, *shape))
        self._summed = 0, 0  # a number of rows and their checksum

    def reserve(self, rows: int) -> None:
        # Writing to a map without space on the disk would end the process with SIGBUS.
        _reserve(self._file, self._offset + rows * self.row_bytes)
        self._write_header(rows)
        self.array = np.asarray(np.memmap(self._file, np.float64, "r+", self._offset, (rows, *self._shape)))

    def checksum(self, rows: int) -> int:
        """Return the checksum of the first rows. The last row may change from one call to the next."""
        rows_before, before = self._summed if self._summed[0] < rows else (0, 0)
        last, width = max(0, rows - 1), self.row_bytes // 8
        self._summed = last, checksum(self.array[rows_before:last], rows_before * width, before)
        return checksum(self.array[last:rows], last * width, self._summed[1])

    def close(self, rows: int) -> None:
        self.checksum(rows)  # while the system has the rows mapped
        self._write_header(rows)
        self.array = np.empty((0, *self._shape))  # a system may refuse to cut a mapped file
        self._file.truncate(self._offset + rows * self.row_bytes)
        self._file.close()
        self.array = np.load(self.path, mmap_mode="r")

    def remove(self) -> None:
        self._file.close()
        self.path.unlink()

    def _write_header(self, rows: int) -> int:
        """Write the header, whose length does not depend on the number of rows, and return its length."""
        header, shape = io.BytesIO(), (rows, *self._shape)
        np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": shape})
        self._file.seek(0)
        return self._file.write(header.getvalue())


def _reserve(file: BinaryIO, size: int) -> None:
    """Extend a file to at least this size, with its space allocated on the disk."""
    held = os.fstat(file.fileno()).st_size
    if size <= held:
        return
    if hasattr(os, "posix_fallocate"):
        try:
            os.posix_fallocate(file.fileno(), held, size - held)
            return
        except OSError as error:
            if error.errno not in _NO_FALLOCATE:
                raise
    zeros = memoryview(bytes(2**20))
    file.seek(held)
    while held < size:
        held += file.write(zeros[: size - held])
