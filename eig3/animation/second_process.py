"""Draw the last frames of a film that takes long in a second process, while this one draws the first."""

from __future__ import annotations

import pickle
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ..stepping.threads import cores

#: Returns the pixels of frame i.
Draw = Callable[[int], np.ndarray]

_LEAST = 4.0  # seconds of drawing that are worth a process
_START = 1.5  # seconds that it takes to start
_PROGRAM = "from eig3.animation.second_process import main; main()"
_NOT_SENT = AttributeError, ImportError, TypeError, pickle.PicklingError  # errors of pickle


@contextmanager
def with_second_process(build: Callable[[], Draw], count: int) -> Iterator[Draw]:
    """Yield the function that returns the pixels of one of `count` frames.

    `build` returns what draws. If it cannot be pickled, or the other process cannot read it, this one draws all frames.
    """
    draw = build()
    begin = time.perf_counter()
    draw(0)
    each = time.perf_counter() - begin
    if each * count < _LEAST or cores() == 1:
        yield draw
        return
    with tempfile.TemporaryDirectory() as folder:
        first = count - int((count - _START / each) / 2)
        process = _start(Path(folder), build, first, count)
        if process is None:
            yield draw
            return
        try:
            yield _Shared(draw, first, process, Path(folder, "frames.npy"))
        finally:
            process.kill()
            process.wait()


class _Shared:
    """Frames of this process up to `first`, and then frames of the other process, for which the next frame waits."""

    def __init__(self, draw: Draw, first: int, process: subprocess.Popen[bytes], path: Path) -> None:
        self.draw, self.first, self.process, self.path = draw, first, process, path
        self.previous = -1

    def __call__(self, i: int) -> np.ndarray:
        is_next, self.previous = i == self.previous + 1, i
        if i >= self.first and is_next:
            self.process.wait()
        if i >= self.first and self.process.poll() == 0:
            return np.load(self.path, mmap_mode="r")[i - self.first]
        return self.draw(i)


def _start(folder: Path, build: Callable[[], Draw], first: int, count: int) -> subprocess.Popen[bytes] | None:
    import matplotlib as mpl

    try:
        (folder / "job").write_bytes(pickle.dumps((dict(mpl.rcParams), build, first, count)))
    except _NOT_SENT:
        return None
    command = [sys.executable, "-c", _PROGRAM]
    return subprocess.Popen(command, cwd=folder, stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def main() -> None:
    """Draw the frames of the file "job", and write them to "frames.npy"."""
    import matplotlib as mpl

    settings: dict[str, Any]
    settings, build, first, count = pickle.loads(Path("job").read_bytes())
    with mpl.rc_context(settings):
        draw = build()
        np.save("frames.npy", np.stack([draw(i).copy() for i in range(first, count)]))
