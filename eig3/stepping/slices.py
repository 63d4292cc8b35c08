"""Slices: how many steps a kernel takes before it is asked whether to stop.

A kernel cannot be stopped, and Python calls the handler of Ctrl-C only after it has returned. So a run calls it for one
slice of steps after the other.
"""

from __future__ import annotations

import copy
import math
import sys
import time

if sys.platform == "linux":
    import resource

_SECONDS = 5e-4  # duration of a slice; steps may become much slower at any time
_GROWTH = 16  # largest factor from the steps of one slice to the steps of the next
_FIRST_SECONDS = 3e-5  # the time per step may be known from a run with other parameters
_WAITING = 10  # least duration of a slice as a multiple of the time for which it waits for the interpreter,
_LONGEST = 0.05  # up to this duration, because longer slices are interrupted more often by other processes
_LAST = 9  # slices whose median wait counts: the threads of an ensemble wait for each other now and then
_SLOW_STEP = 0.01  # seconds of a step from which on a slice does not last for a whole turn


def _number_of_waits() -> float:
    """Return how often this thread has waited for something, such as the interpreter, and not for a processor."""
    if sys.platform == "linux":
        return resource.getrusage(resource.RUSAGE_THREAD).ru_nvcsw
    return math.nan  # unknown: it differs from each number, also from itself


class Slices:
    """The number of steps of a slice, which follows from the time of the last one.

    Parameters
    ----------
    pace : float or None
        Seconds per step of an earlier run; None if there was none.
    turn : int
        Slices of so many steps, or a multiple of them, take less time than others.

    Attributes
    ----------
    steps : int
        Number of steps of the next slice.
    """

    def __init__(self, pace: float | None, turn: int = 1) -> None:
        self.steps = max(1, int(_FIRST_SECONDS / pace)) if pace else 1
        self._turn, self._waits = turn, math.nan
        self._waited = _LAST * (0.0,)  # for how long each of the last slices has waited

    def begin(self, left: int) -> tuple[int, float, float]:
        """Begin the next slice of a call that has `left` steps left; return its steps and two times for `end`."""
        if left <= self.steps:
            return left, time.perf_counter(), 0.0
        if math.isnan(self._waits):
            self._waits = _number_of_waits()
        return self.steps, time.perf_counter(), time.thread_time()

    def end(self, done: int, begin: float, busy_at_begin: float) -> float:
        """End a slice in which `done` steps were taken, and return its duration in seconds.

        The steps of the next slice follow from the time in which this one was computed.
        """
        seconds = time.perf_counter() - begin
        if busy_at_begin:  # the last slice of a call is followed by other work
            busy = time.thread_time() - busy_at_begin
            self._waited = *self._waited[1:], self._wait_in(seconds - busy)
            wanted = max(_SECONDS, min(_LONGEST, _WAITING * sorted(self._waited)[_LAST // 2]))
            self.steps = self._whole_turns(max(1, done) * min(_GROWTH, wanted / (busy + 1e-9)))
        return seconds

    def copy(self) -> Slices:
        return copy.copy(self)

    def _wait_in(self, idle: float) -> float:
        """Return for how long a slice that was idle for some time waited for the interpreter.

        Another thread may have kept the interpreter, and slices must be long in comparison. They need not be long where
        another process had the processor.
        """
        if idle < _SECONDS / _WAITING:
            return idle
        before, self._waits = self._waits, _number_of_waits()
        return idle if self._waits != before else 0.0

    def _whole_turns(self, steps: float) -> int:
        if steps < _SECONDS / _SLOW_STEP:
            return 1
        return self._turn * max(1, int(steps / self._turn))
