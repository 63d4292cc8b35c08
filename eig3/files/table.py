"""Rows of numbers as text, for formats with one line for each point."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np

_REAL = "%.10g"


def lines(columns: list[np.ndarray]) -> str:
    """Return a line for each row of some columns, of shape (rows,) or (rows, k), with ten digits of real numbers."""
    flat = [column for given in columns for column in (given.T if given.ndim == 2 else [given])]
    form = " ".join({"f": _REAL, "U": "%s"}.get(column.dtype.kind, "%d") for column in flat) + "\n"
    values: Any = zip(*(column.tolist() for column in flat), strict=True)
    return "".join([form % row for row in values])


@contextmanager
def complete(path: Path) -> Iterator[Path]:
    """Yield a path to write to. The file gets its name when it is complete, and is removed after an error."""
    part = path.with_name(f"{path.name}.part")
    try:
        yield part
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


@contextmanager
def text_file(path: Path) -> Iterator[IO[str]]:
    """Open a text file that gets its name when it is complete."""
    with complete(path) as part, part.open("w", encoding="utf-8", newline="\n") as file:
        yield file
