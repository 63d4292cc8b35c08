"""Slices: the number of steps in a call of a kernel.

A kernel cannot be interrupted, and Python calls the handler of Ctrl-C only after it has returned. So a run calls it for
slices of steps.
"""

from __future__ import annotations

import math
import sys
import time

if sys.platform == "linux":
    import resource

_SECONDS = 5e-4  # duration of a slice; steps may become much slower at any time
_GROWTH = 16  # largest factor from the steps of one slice to the steps of the next
_FIRST_SECONDS = 3e-5  # the time per step may be known from a run with other parameters
_WAITING = 10  # least ratio of the duration of a slice to the time for which it waits for the interpreter,
_LONGEST = 0.05  # up to this duration, because longer slices are interrupted more often by other processes
_LAST = 9  # slices for the median wait, because the threads of an ensemble sometimes wait for each other
_SLOW_STEP = 0.01  # with longer steps, s, a slice need not last for a whole turn


def _number_of_waits() -> float:
    """Return the number of times that this thread has waited, such as for the interpreter, but not for a processor."""
    if sys.platform == "linux":
        return resource.getrusage(resource.RUSAGE_THREAD).ru_nvcsw
    return math.nan  # unknown: NaN differs from each number, including itself


class Slices:
    """The number of steps of a slice, from the time of the last slice.

    `pace` is the number of seconds for each step in an earlier run, if there was one. Slices of a multiple of `turn`
    steps take less time than others.
    """

    def __init__(self, pace: float | None, turn: int = 1) -> None:
        self.steps = max(1, int(_FIRST_SECONDS / pace)) if pace else 1
        self._turn, self._waits = turn, math.nan
        self._waited = _LAST * (0.0,)  # the wait of each of the last slices

    def begin(self, left: int) -> tuple[int, float, float]:
        """Begin the next slice of a call that has `left` steps left; return its steps and two times for `end`."""
        if left <= self.steps:
            return left, time.perf_counter(), 0.0
        if math.isnan(self._waits):
            self._waits = _number_of_waits()
        return self.steps, time.perf_counter(), time.thread_time()

    def end(self, done: int, begin: float, busy_at_begin: float) -> float:
        """End a slice in which `done` steps were taken, and return its duration in seconds.

        The number of steps of the next slice depends on the computing time of this slice.
        """
        seconds = time.perf_counter() - begin
        if busy_at_begin:  # other work follows the last slice of a call
            busy = time.thread_time() - busy_at_begin
            self._waited = *self._waited[1:], self._wait_in(seconds - busy)
            wanted = max(_SECONDS, min(_LONGEST, _WAITING * sorted(self._waited)[_LAST // 2]))
            self.steps = self._whole_turns(max(1, done) * min(_GROWTH, wanted / (busy + 1e-9)))
        return seconds

    def _wait_in(self, idle: float) -> float:
        """Return the part of the idle time of a slice for which it waited for the interpreter.

        If another thread holds the interpreter, slices must be long compared with the wait. If another process has the
        processor, they need not be long.
        """
        if idle < _SECONDS / _WAITING:
            return idle
        before, self._waits = self._waits, _number_of_waits()
        return idle if self._waits != before else 0.0

    def _whole_turns(self, steps: float) -> int:
        if steps < _SECONDS / _SLOW_STEP:
            return 1
        return self._turn * max(1, int(steps / self._turn))
