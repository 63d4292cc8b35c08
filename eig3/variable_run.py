"""A run with tolerances: a Python loop calls the kernel for one chunk of steps after the other."""

from __future__ import annotations

from typing import Any

import numpy as np

from .kernels.events import NOT_A_NUMBER, TERMINAL, ZENO
from .kernels.variable import AT_END, BEFORE_END, TOO_SMALL
from .observers.growing import GrowingHistory, Rows
from .observers.progress import Progress
from .quantities import Functions, Quantity, as_extremes
from .solution import Solution, Status
from .stepper import Cancel
from .storage import Place
from .variable_stepper import VariableStepper
from .watching import ended_by_event, not_a_number

_CHUNK_SECONDS = 0.02  # duration of a call of the kernel, after which the run may stop
_FIRST_STEPS = 64  # steps of the first call, if nothing is known about the time of a step
_GROWTH = 8  # largest factor from the steps of one call to the steps of the next
_CHUNK_VALUES = 2**16  # values in the rows of one call, so that they stay in the cache


class Followed:
    """An invariant or an output along a run with tolerances."""

    def __init__(self, quantity: Quantity, stepper: VariableStepper) -> None:
        self.quantity, self._params = quantity, stepper.params
        self._extremes = quantity.no_extremes()
        self._start = quantity.at_start(stepper.t, stepper.u, stepper.v, self._params, self._extremes)

    def see(self, t: np.ndarray, u: np.ndarray, v: np.ndarray) -> None:
        """Evaluate the function in every state of a chunk."""
        if len(t):
            self.quantity.evaluate(t, u, v, self._params, self._extremes)

    @property
    def extremes(self) -> Any:
        return as_extremes(self._extremes, self.quantity.shape)

    @property
    def drift(self) -> float:
        """The maximum of |e_n - e_0| over the steps so far; NaN if e became NaN."""
        low, high, *_ = self.extremes
        return float(np.maximum(self._start - low, high - self._start))

    def values(self, t: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the values in the saved states."""
        return self.quantity.evaluate(t, u, v, self._params, self.quantity.no_extremes()).copy()

    def copy(self) -> Followed:
        other = object.__new__(Followed)
        vars(other).update(vars(self), _extremes=self._extremes.copy())
        return other


class VariableRun:
    """A run with tolerances, and its history.

    Parameters
    ----------
    stepper : VariableStepper
    every : int
        Every `every`-th state is saved; `NEVER` saves the first and the last.
    functions : Functions
        The invariants and outputs.
    progress : bool
    """

    def __init__(self, stepper: VariableStepper, every: int, functions: Functions, progress: bool) -> None:
        self.stepper, self.every, self._shows_progress = stepper, every, progress
        self.place: Place | None = None
        self.history = GrowingHistory()
        self.history.append(self._present(0.0))
        invariants, outputs = functions.quantities(stepper.form)
        self.invariants = {name: Followed(quantity, stepper) for name, quantity in invariants.items()}
        self.outputs = {name: Followed(quantity, stepper) for name, quantity in outputs.items()}
        self.status = Status.COMPLETED
        self.message = "The run reached the end of its span."
        pace = stepper.pace
        self._count = max(1, int(_CHUNK_SECONDS / pace)) if pace else _FIRST_STEPS
        self._is_done = False

    def march(self, stop: Cancel) -> None:
        """Run to the end, or until the run fails or should stop."""
        stepper = self.stepper
        with Progress(100, "%", self._shows_progress) as bar:
            while not self._is_done:
                if stop.is_final():
                    self._end(Status.INTERRUPTED, f"The run was interrupted after t = {stepper.t:g}.")
                    break
                left = stepper.tolerances.max_steps - stepper.index
                if not left and stepper.t < stepper.t_end:
                    self._end(
                        Status.TOO_MANY_STEPS,
                        f"The run took max_steps = {stepper.index} steps up to t = {stepper.t:g}; take a larger "
                        "max_steps, or larger tolerances.",
                    )
                    break
                before = self._percent
                self._advance(min(self._count, max(1, left)))
                bar.add(self._percent - before)
                self._judge()
        stepper.note_pace()

    def result(self, error: BaseException | None = None) -> Solution:
        """Return the run up to now; `error` is the exception that ended it, if there was one."""
        stepper = self.stepper
        if error and not self._is_done:
            what = f"raised {type(error).__name__}" if isinstance(error, Exception) else "was interrupted"
            self._end(Status.INTERRUPTED, f"The run {what} after t = {stepper.t:g}.")
        t, h, u, v = self._saved()
        steps = max(1, stepper.index)
        return Solution(
            t=t,
            u=u,
            v=v,
            h=(stepper.t - stepper.t0) / steps,
            n_steps=stepper.index,
            n_rhs=stepper.n_rhs,
            n_iterations=0,
            status=self.status,
            message=self.message,
            kernel_seconds=stepper.seconds,
            method=stepper.method,
            drift={name: followed.drift for name, followed in self.invariants.items()},
            extremes={name: followed.extremes for name, followed in {**self.invariants, **self.outputs}.items()},
            events=stepper.watching.occurrences(),
            outputs={name: followed.values(t, u, v) for name, followed in self.outputs.items()},
            n_rejected=stepper.n_rejected,
            steps=h,
            _accelerations=stepper.accelerations,
        )

    def _advance(self, count: int) -> None:
        """Take at most `count` steps. If rhs raises an exception, take the steps before it first."""
        stepper = self.stepper
        every = 1 if self.invariants or self.outputs else self.every
        is_kept = stepper.watching.times is None
        capacity = 0
        if every == 1 or is_kept:
            capacity = min(2 * (count // every + 2), max(4, _CHUNK_VALUES // stepper.n))
        first, before = stepper.index, stepper.seconds
        try:
            rows = stepper.advance(count, every, Rows.empty(capacity, stepper.n))
        except Exception:
            if count == 1:
                raise
            self._count = count // 2
            return
        spent = stepper.seconds - before
        self._count = max(1, int(count * min(_GROWTH, _CHUNK_SECONDS / (spent + 1e-9))))
        for followed in (*self.invariants.values(), *self.outputs.values()):
            followed.see(rows.t, *rows.in_form(stepper.form))
        if is_kept:
            self.history.append(rows if every == self.every else self._chosen(rows, first))

    def _chosen(self, rows: Rows, first: int) -> Rows:
        """Return the rows to save from the rows of all steps after step index `first`.

        A reset gives two rows for one step, with the same time, of which the second is the state after it.
        """
        is_step_end = np.append(rows.t[1:] != rows.t[:-1], True) if len(rows.t) else np.zeros(0, dtype=bool)
        ends = np.flatnonzero(is_step_end)
        index = first + 1 + np.arange(len(ends))
        return rows.at(ends[index % self.every == 0])

    def _saved(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return t, h, u and v of the saved states."""
        stepper = self.stepper
        rows = stepper.wanted_rows()
        if rows is None:
            last = self.history.blocks[-1].at(slice(-1, None))
            present = self._present(stepper.h_before)
            is_saved = all(np.array_equal(last[i], present[i]) for i in (0, 2, 3))
            rows = GrowingHistory.join([*self.history.blocks, *([] if is_saved else [present])])
        if len(rows.h) > 1 and rows.h[0] == 0:
            rows.h[0] = rows.h[1]
        return rows.t, rows.h, *rows.in_form(self.stepper.form)

    def _present(self, h: float) -> Rows:
        """Return the present state as a row."""
        u, v = (np.reshape(x, (1, self.stepper.n)) for x in (self.stepper.u, self.stepper.v))
        return Rows(np.array([self.stepper.t]), np.array([h]), u, v)

    @property
    def _percent(self) -> int:
        stepper = self.stepper
        return round(100 * (stepper.t - stepper.t0) / (stepper.t_end - stepper.t0))

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
        elif ended in (TERMINAL, ZENO):
            self._end(*ended_by_event(stepper))
        elif ended == NOT_A_NUMBER:
            raise not_a_number(stepper.ended_by, t)
        elif ended == TOO_SMALL:
            self._end(
                Status.STEP_TOO_SMALL,
                f"The tolerances need a step below the resolution of t at t = {t:g}: the motion may be singular there, "
                "rhs may jump or be NaN, or rtol and atol may be too small.",
            )
