"""A run that is over within a slice: the kernel is called once, and what else a solution has is found when it is read.

The kernel gets the arguments that a `Run` would give it, so that the numbers have the same bits. A `Run` does the rest:
runs that may not end well, and what a solution can do later, such as to go on.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from ..kernels.protocol import AT_END, GOING, SCALAR
from ..result.memory import n_rows
from ..result.solution import Solution
from ..stepping.march import Rows
from ..stepping.stepper import Stepper
from ..stepping.variable_stepper import VariableStepper
from .fixed_run import grid, stride
from .growth import STRANGE, size_of
from .run import Run, Stop, common_fields

_MOST_SECONDS = 4e-4  # duration of a short run, by the time per step of an earlier one
_MOST_VALUES = 2**17  # in its rows
_NONE = np.empty(0)


class Again:
    """The `Run` of a short run, which is made when it is needed: it takes the same steps again.

    Parameters
    ----------
    begin : callable
        It returns a `Run` at its start.
    """

    def __init__(self, begin: Callable[[], Run]) -> None:
        self._begin = begin
        self._run: Run | None = None

    @property
    def run(self) -> Run:
        if self._run is None:
            run = self._begin()
            run.march(Stop(None, None))
            run.close()
            self._run = run
        return self._run

    def notes(self) -> tuple[str, ...]:
        return self.run.all_notes()

    def state(self) -> dict[str, Any]:
        return self.run.state()

    def extend(self, *arguments: Any, **options: Any) -> Solution:
        return self.run.extend(*arguments, **options)


def is_short(stepper: Any, steps: int, rows: int) -> bool:
    """Return whether a run of so many steps and rows is over within a slice, as far as is known."""
    pace = stepper.system.callback.pace.get(stepper.kernel.pace_key)
    return pace is not None and steps * pace < _MOST_SECONDS and rows * stepper.n < _MOST_VALUES


def fixed(stepper: Stepper, n_steps: int, t_end: float, save_every: int | None, again: Again) -> Solution | None:
    """Take the steps of a run with a fixed step; return None if its end needs a closer look.

    Parameters
    ----------
    stepper : Stepper
        It stands at the start.
    n_steps, t_end, save_every
        As for `FixedRun`.
    again : Again
    """
    every, start, state = stride(save_every, n_steps), stepper.start, stepper.state
    count = n_rows(n_steps, every)
    u = np.empty(count) if stepper.form is SCALAR else np.empty((count, stepper.n))
    v = np.empty(u.shape)
    u[0], v[0] = start
    outputs = _rows_of_outputs(stepper, count)
    ended, row = _called(stepper, n_steps, every, Rows(_NONE, _NONE, u, v))
    if ended != GOING or not _is_sound(stepper, n_steps * stepper.h):
        return None
    if row < count:
        u[row], v[row] = state[0], state[1]
        _write_outputs(stepper, outputs, row)
    later = {"t": partial(grid, stepper.t0, stepper.h, every, count, n_steps, t_end)}
    return _solution(stepper, {"u": u, "v": v, "h": stepper.h}, outputs, later, again)


def variable(stepper: VariableStepper, every: int, rows: int, again: Again) -> Solution | None:
    """Do the same for a run with tolerances, which needs at most this number of rows."""
    n = stepper.n
    t, h, u, v = np.empty(rows), np.empty(rows), np.empty((rows, n)), np.empty((rows, n))
    t[0], h[0], (u[0], v[0]) = stepper.t0, 0.0, stepper.start
    outputs = _rows_of_outputs(stepper, rows)
    stepper.shorten()
    ended, row = _called(stepper, stepper.tolerances.max_steps, every, Rows(t, h, u, v))
    t_last, h_last = stepper.t, stepper.h
    if ended != AT_END or not _is_sound(stepper, math.inf):
        return None
    if t[row - 1] != t_last:
        t[row], h[row], u[row], v[row] = t_last, h_last, stepper.state[0], stepper.state[1]
        _write_outputs(stepper, outputs, row)
        row += 1
    outputs = {name: values[:row] for name, values in outputs.items()} if outputs else {}
    u, v = (u[:row, 0], v[:row, 0]) if stepper.form is SCALAR else (u[:row], v[:row])
    fields = {
        "t": t[:row],
        "steps": h[:row],
        "u": u,
        "v": v,
        "_between": stepper.states_between if every == 1 else None,
    }
    fields |= {"h": (t_last - stepper.t0) / stepper.index, "n_rejected": stepper.n_rejected}
    return _solution(stepper, fields, outputs, {}, again)


def _called(stepper: Any, count: int, every: int, rows: Rows) -> tuple[int, int]:
    """Call the kernel; return how it ended, and the next row to write."""
    kernel, steps = stepper.kernel, stepper.steps(count, every, 1, rows)
    arguments = stepper.look.arguments if stepper.look else None
    begin = time.perf_counter()
    taken, row, ended = kernel.call(kernel.callbacks, stepper.state, kernel.settings, stepper.tally, steps, arguments)
    stepper.seconds, stepper.index = time.perf_counter() - begin, taken
    if taken:
        stepper.system.callback.pace[kernel.pace_key] = stepper.seconds / taken
    return ended, row


def _is_sound(stepper: Any, span: float) -> bool:
    """Return whether the motion is finite and has not grown much, and whether rhs writes every entry of a."""
    state, (u, v) = stepper.state, stepper.start
    if stepper.form is SCALAR:
        u_end, v_end = abs(state.item(0)), abs(state.item(1))
    else:
        u_end, v_end = np.maximum.reduce(np.abs(state[:2]), axis=1).tolist()
        if stepper.find_unwritten(stepper.t - stepper.h) is not None:
            return False
    if stepper.look:
        stepper.look.follower.check()
        stepper.look.watching.collect(stepper.tally)
    if span == math.inf:
        return u_end < math.inf and v_end < math.inf
    v_natural = size_of(v) + span * size_of(stepper.first_acceleration)
    return u_end < STRANGE * (size_of(u) + span * v_natural) and v_end < STRANGE * v_natural


def _rows_of_outputs(stepper: Any, count: int) -> dict[str, np.ndarray]:
    """Return arrays for the values of outputs in each row, into which the kernel will write."""
    if not (stepper.look and stepper.look.follower.followed.outputs):
        return {}
    outputs = {}
    for name, shape in stepper.system.functions.shapes.items():
        outputs[name] = np.empty((count, *shape))
    stepper.look.follower.save_in(outputs)
    _write_outputs(stepper, outputs, 0)
    return outputs


def _write_outputs(stepper: Any, outputs: dict[str, np.ndarray], row: int) -> None:
    if outputs:
        for name, value in stepper.look.follower.present_outputs().items():
            outputs[name][row] = value


def _solution(stepper: Any, fields: dict[str, Any], outputs: Any, later: dict[str, Any], again: Again) -> Solution:
    later["notes"] = again.notes
    if stepper.look:
        later |= stepper.look.found()
    fields |= {"outputs": outputs, "_extend": again.extend, "_resume": again.state}
    return Solution._of(common_fields(stepper) | fields, later)
