"""A run with tolerances: a Python loop calls the kernel for one chunk of steps after the other."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from .kernels.events import NOT_A_NUMBER, TERMINAL, ZENO
from .kernels.protocol import SCALAR, VECTOR
from .kernels.variable import AT_END, BEFORE_END, FULL, TOO_SMALL
from .observers.growing import GrowingHistory, Rows
from .observers.progress import Progress
from .observers.written import unwritten_entry
from .solution import Solution, Status
from .stepper import NEVER, Cancel
from .variable_stepper import VariableStepper

_CHUNK_SECONDS = 0.02  # duration of a call of the kernel, after which the run may stop
_FIRST_STEPS = 64  # steps of the first call, if nothing is known about the time of a step
_GROWTH = 8  # largest factor from the steps of one call to the steps of the next
_CHUNK_VALUES = 2**16  # values in the rows of one call, so that they stay in the cache


class VariableRun:
    """A run with tolerances, and its history.

    Parameters
    ----------
    stepper : VariableStepper
    every : int
        Every `every`-th state is saved; `NEVER` saves the first and the last.
    progress : bool
    """

    def __init__(self, stepper: VariableStepper, every: int, progress: bool) -> None:
        self.stepper, self.every = stepper, every
        self.history = GrowingHistory()
        if stepper.watching.times is None:
            first = (np.reshape(x, (1, stepper.n)) for x in (stepper.u, stepper.v))
            self.history.append(Rows(np.array([stepper.t]), np.array([0.0]), *first))
        self.bar = Progress(100, "%", progress)
        self.status = Status.COMPLETED
        self.message = "The run reached the end of its span."
        pace = stepper.pace
        self._count = max(1, int(_CHUNK_SECONDS / pace)) if pace else _FIRST_STEPS
        self._is_done = False

    def march(self, stop: Cancel) -> None:
        """Run to the end, or until the run fails or should stop."""
        stepper = self.stepper
        with self.bar:
            while not self._is_done:
                if stop.is_set():
                    self._end(Status.INTERRUPTED, f"The run was interrupted after t = {stepper.t:g}.")
                    break
                most = stepper.tolerances.max_steps - stepper.index
                if most <= 0:
                    self._end(
                        Status.TOO_MANY_STEPS,
                        f"The run took max_steps = {stepper.index} steps up to t = {stepper.t:g}; take a larger "
                        "max_steps, or larger tolerances.",
                    )
                    break
                self._chunk(min(self._count, most))
        stepper.note_pace()

    def _chunk(self, count: int) -> None:
        stepper = self.stepper
        before, seconds = stepper.t, stepper.seconds
        rows = self._advance(count)
        self.history.append(rows)
        self.bar.add(round(100 * (stepper.t - stepper.t0) / self._span) - round(100 * (before - stepper.t0) / self._span))
        spent = stepper.seconds - seconds
        self._count = max(1, int(count * min(_GROWTH, _CHUNK_SECONDS / (spent + 1e-9))))
        self._judge()

    def _advance(self, count: int) -> Rows:
        """Take at most `count` steps. If rhs raises an exception, take the steps before it first."""
        stepper = self.stepper
        capacity = 0
        if stepper.watching.times is None:
            capacity = min(2 * (count // self.every + 2), max(4, _CHUNK_VALUES // stepper.n))
        rows = Rows.empty(capacity, stepper.n)
        try:
            return stepper.advance(count, self.every, rows)
        except Exception:
            if count == 1:
                raise
        self._count = 1
        return self._advance(max(1, count // 2))

    @property
    def _span(self) -> float:
        return self.stepper.t_end - self.stepper.t0

    def _end(self, status: Status, message: str) -> None:
        self.status, self.message, self._is_done = status, message, True

    def _judge(self) -> None:
        """Find out from the kernel's outcome whether the run goes on."""
        stepper = self.stepper
        ended, t = stepper.ended, stepper.t
        if ended == AT_END:
            self._is_done = True
        elif ended == BEFORE_END:
            stepper.shorten()
        elif ended == TERMINAL:
            self._end(Status.TERMINATED, f"The event {stepper.ended_by!r} ended the run at t = {t:g}.")
        elif ended == ZENO:
            self._end(Status.ZENO, zeno_message(stepper.ended_by, t))
        elif ended == NOT_A_NUMBER:
            raise not_a_number(stepper.ended_by, t)
        elif ended == TOO_SMALL:
            self._end(
                Status.STEP_TOO_SMALL,
                f"The tolerances need a step below the resolution of t at t = {t:g}: the motion may be singular there, "
                "rhs may jump or be NaN, or rtol and atol may be too small.",
            )
