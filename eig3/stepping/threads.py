"""Runs on several threads: whether they pay, and how they stop."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from operator import methodcaller
from threading import Event
from typing import Any

from ..kernels.compile.numba_internals import Jitted, options_of
from .march import Cancel
from .system import System

_WORTH = 2e-3  # seconds; a second thread saves no time in shorter runs


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def starts_threads(rhs: Any) -> bool:
    """Return whether a function starts threads: with some threading layers of Numba, two of them end the process."""
    inner = getattr(getattr(rhs, "py_func", None), "inner", rhs)
    return isinstance(inner, Jitted) and bool(options_of(inner).get("parallel"))


class Stop:
    """Whether threads should stop: because one of several events is set, or because one of them raised an error."""

    def __init__(self, *events: Cancel | None) -> None:
        self._own = Event()
        self._events: list[Cancel] = [event for event in (self._own, *events) if event is not None]

    def set(self) -> None:
        self._own.set()

    def is_set(self) -> bool:
        return any(map(methodcaller("is_set"), self._events))  # it is called often: a generator takes more calls


def side_by_side(
    first: Callable[[Any], Any], second: Callable[[Any], Any], system: System, seconds: float, cancel: Cancel | None
) -> tuple[Any, Any]:
    """Return first(cancel) and second(cancel), which run a system.

    They run on two threads if there are two cores, and if `seconds`, about the duration of a run, is worth it.
    """
    if seconds < _WORTH or cores() == 1 or system.shares or starts_threads(system.rhs):
        return first(cancel), second(cancel)
    stop = Stop(cancel)
    with ThreadPoolExecutor(1) as pool:
        other = pool.submit(second, stop)
        try:
            return first(stop), other.result()
        finally:
            stop.set()
