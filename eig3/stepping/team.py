"""The threads of a single run, which share the forces of a large scene: see `eig3.kernels.team`."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, NamedTuple

import numpy as np

from ..kernels.compile.jit import compiled
from ..kernels.compile.numba_internals import address_of
from ..kernels.neighbours import MOST_PARTS
from ..kernels.team import BOARD, LEAVE, SELF, SHARE, WANTED, new_board, serve

_WORTH = 100_000  # least points times steps for threads, whose start takes some tenths of a millisecond
_PAUSE = 5e-5  # s between checks of a thread that has waited for long

_others = threading.Lock()  # its holder uses the other cores


class Shares(NamedTuple):
    """The work of a right-hand side that threads share.

    Attributes
    ----------
    function : jitted function
        The function that does a part: see `eig3.kernels.team.SHARE`.
    place : int
        The place of the team in p.
    size : int
        Number of points.
    """

    function: Any
    place: int
    size: int


@contextmanager
def alone() -> Iterator[None]:
    """A block in which runs have one thread each, because the other cores are busy."""
    mine = _others.acquire(blocking=False)
    try:
        yield
    finally:
        if mine:
            _others.release()


@contextmanager
def team(shares: Shares, params: np.ndarray, steps: int) -> Iterator[None]:
    """A block in which threads share the evaluations of a right-hand side with these parameters, if it pays.

    The results are bitwise the same without threads. If another run of this process uses the other cores, this run has
    one thread.
    """
    if steps * shares.size < _WORTH:
        yield
        return
    place = params[shares.place :]
    count = min(int(place[WANTED]), MOST_PARTS)
    if count == 1 or not _others.acquire(blocking=False):
        yield
        return
    board, leave = new_board(count), threading.Event()
    serving = serve(), address_of(compiled(shares.function, SHARE.args))
    threads = [threading.Thread(target=_serve, args=(*serving, board, leave), daemon=True) for _ in range(count - 1)]
    try:
        for thread in threads:
            with suppress(RuntimeError):  # the system has no more threads; the run works without them
                thread.start()
        place[BOARD], place[SELF] = board.ctypes.data, params.ctypes.data
        yield
    finally:
        place[BOARD] = 0
        leave.set()
        board[LEAVE] = 1
        _others.release()
        for thread in threads:
            if thread.ident:
                thread.join()


def _serve(serve: Any, address: int, board: np.ndarray, leave: threading.Event) -> None:
    while not leave.is_set():
        if serve(board, address):
            time.sleep(_PAUSE)
