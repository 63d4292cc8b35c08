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

from ..functions.guard import CELLS
from ..kernels.loops.evaluation import guarded_kernel
from ..kernels.protocol import AT_END, GOING, NEXT, REJECTED, SCALAR, STEP_BEFORE, TERMINAL, TIME, Steps
from ..result.solution import Solution
from ..stepping.stepper import Stepper
from ..stepping.variable_stepper import VariableStepper
from .fixed_run import grid
from .growth import STRANGE, natural_sizes
from .run import Run, Stop, ended_by_event, solution_of

# Duration of a short run, by the time per step of an earlier one. Ctrl-C waits for it, and what is found later takes it
# again. Slices would take a fifth longer for runs of 1 ms.
MOST_SECONDS = 5e-3
TRIED_SECONDS = 4e-4  # duration for which a run with tolerances is tried as a short one, whatever the last one took
MOST_VALUES = 2**17  # in its rows


def fixed(stepper: Stepper, n_steps: int, t_end: float, every: int, again: Callable[[], Run]) -> Solution | None:
    """Take the steps of a run with a fixed step; return None if its end needs a closer look.

    Parameters
    ----------
    stepper : Stepper
        It stands at the start.
    n_steps, t_end, every
        As for `FixedRun`.
    again : callable
        It returns the same run at its start, as a `Run`.
    """
    start, state = stepper.start, stepper.state
    count = n_steps // every + 1 + (n_steps % every > 0)
    u, v = np.empty((count, stepper.n)), np.empty((count, stepper.n))
    u[0], v[0] = start
    outputs = _rows_of_outputs(stepper, count) if stepper.look else {}
    steps = Steps(stepper.h, stepper.t0, stepper.params, 0, n_steps, every, 1, u, v)
    row = _last_row(stepper, steps, GOING, n_steps * stepper.h)
    if row is None:
        return None
    index, ended = stepper.index, _ended(stepper) if stepper.ended == TERMINAL else {}
    if ended:  # the last row is the state after the event
        t_end, count = stepper.t, row + (index % every > 0 or stepper.is_within_step)
        row, u, v = count - 1, u[:count], v[:count]
        outputs = {name: values[:count] for name, values in outputs.items()}
    if row < count:
        u[row], v[row] = state[0], state[1]
        _write_outputs(stepper, outputs, row)
    later: dict[str, Any] = {
        "t": partial(grid, stepper.t0, stepper.h, every, count, index, t_end),
        "notes": partial(_notes, again),
    }
    u, v = (u[:, 0], v[:, 0]) if stepper.form is SCALAR else (u, v)
    fields: dict[str, Any] = {"u": u, "v": v, "h": stepper.h, "outputs": outputs, **ended}
    fields |= {"_extend": partial(_taken, again), "_resume": partial(_state, again)}
    return solution_of(stepper, fields, later)


def variable(stepper: VariableStepper, most: int, every: int, rows: int, again: Callable[[], Run]) -> Solution | None:
    """Do the same for a run with tolerances; return None too if it needs more than `most` steps, or more rows."""
    n = stepper.n
    t, h, u, v = np.empty(rows), np.empty(rows), np.empty((rows, n)), np.empty((rows, n))
    t[0], h[0], (u[0], v[0]) = stepper.t0, 0.0, stepper.start
    outputs = _rows_of_outputs(stepper, rows) if stepper.look else {}
    stepper.may_shorten = True
    steps, tally = stepper.steps(min(stepper.tolerances.max_steps, most), every, 1, (t, h, u, v)), stepper.tally
    row = _last_row(stepper, steps, AT_END, math.inf)
    if row is None:
        return None
    t_last, h_last = float(tally[TIME]), float(tally[STEP_BEFORE])
    ended = _ended(stepper) if stepper.ended == TERMINAL else {}
    if t[row - 1] != t_last or (ended and (stepper.state[:2] != (u[row - 1], v[row - 1])).any()):
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
    fields |= {"h": (t_last - stepper.t0) / max(1, stepper.index), "n_rejected": int(tally[REJECTED])}
    fields |= {"outputs": outputs, **ended}
    fields |= {"_extend": partial(_taken, again), "_resume": partial(_state, again)}
    return solution_of(stepper, fields, {"notes": partial(_notes, again)})


def at_times(stepper: Any, most: int, t_end: float, times: np.ndarray, again: Callable[[], Run]) -> Solution | None:
    """Do the same for a run with a fixed step or with tolerances whose states are saved at some times.

    It takes `most` steps; one with tolerances may take fewer.
    """
    n, count, look, tally = stepper.n, len(times), stepper.look, stepper.tally
    rows = {"u": np.empty((count, n)), "v": np.empty((count, n)), "steps": np.empty(count)}
    look.save_wanted(rows, n)
    is_at_start = times[0] == stepper.t0
    outputs = _rows_of_outputs(stepper, count, has_first=is_at_start)
    if is_at_start:
        rows["u"][0], rows["v"][0] = stepper.start
        rows["steps"][0], tally[NEXT] = 0.0, 1
    none, no_rows = np.empty(0), np.empty((0, n))
    fields: dict[str, Any] = {}
    if isinstance(stepper, VariableStepper):
        stepper.may_shorten = True
        steps: Any = stepper.steps(min(stepper.tolerances.max_steps, most), 1, 0, (none, none, no_rows, no_rows))
        row = _last_row(stepper, steps, AT_END, math.inf)
        fields |= {"_between": None, "n_rejected": int(tally[REJECTED])}
        fields["h"] = (float(tally[TIME]) - stepper.t0) / max(1, stepper.index)
    else:
        steps = Steps(stepper.h, stepper.t0, stepper.params, 0, most, most + 1, 0, no_rows, no_rows)
        row = _last_row(stepper, steps, GOING, most * stepper.h)
        fields["h"] = stepper.h
        del rows["steps"]
    if row is None:
        return None
    ended, written = _ended(stepper) if stepper.ended == TERMINAL else {}, stepper.n_wanted
    look.watching.finish(tally, stepper.t0, stepper.t if ended else t_end, stepper.h, stepper.u, stepper.v)
    count = stepper.n_wanted
    if outputs and written < count:  # `finish` has written states without outputs
        return None
    fields |= {"t": times[:count].copy(), "outputs": {name: values[:count] for name, values in outputs.items()}}
    for name, values in rows.items():
        fields[name] = values[:count, 0] if values.ndim == 2 and stepper.form is SCALAR else values[:count]
    fields |= ended
    fields |= {"_extend": partial(_taken, again), "_resume": partial(_state, again)}
    return solution_of(stepper, fields, {"notes": partial(_notes, again)})


def _ended(stepper: Any) -> dict[str, Any]:
    """Return what a solution says of a run that a terminal event has ended."""
    status, message = ended_by_event(stepper.ended, stepper.ended_by, stepper.t)
    return {"status": status, "message": message}


def _last_row(stepper: Any, steps: Any, wanted: int, span: float) -> int | None:
    """Call the kernel, and return the next row to write; None if the run needs a closer look.

    It does if it has ended neither as `wanted` nor by a terminal event, if the motion is not finite or has grown much
    over a span with a fixed step, or if rhs leaves out an entry of a.
    """
    kernel, state, tally = stepper.kernel, stepper.state, stepper.tally
    arguments = stepper.look.arguments if stepper.look else None
    begin = time.perf_counter()
    taken, row, ended = kernel.call(kernel.callbacks, state, kernel.settings, tally, steps, arguments)
    stepper.seconds, stepper.index, stepper.ended = time.perf_counter() - begin, taken, ended
    if ended not in (wanted, TERMINAL):
        return None
    if taken:
        stepper.system.pace[kernel.pace_key] = stepper.seconds / taken
    if stepper.look:
        stepper.look.follower.check()
        stepper.look.watching.collect(tally)
    if stepper.form is SCALAR:
        u, v = abs(state.item(0)), abs(state.item(1))
    else:
        t = stepper.t0 + (taken - 1) * stepper.h if wanted == GOING else float(tally[TIME] - tally[STEP_BEFORE])
        # As `evaluation` does, without its Python call: a run makes few of them.
        room = np.empty((3, stepper.n + 2 * CELLS))
        u, v, a, _ = guarded_kernel()(stepper.system.callback.address, t, state[0], state[1], stepper.params, room)
        if a == math.inf:
            return None
    if wanted != GOING:
        return row if u < math.inf and v < math.inf else None
    u_natural, v_natural = natural_sizes(stepper.first_sizes, span)
    return row if u < STRANGE * u_natural and v < STRANGE * v_natural else None


def _rows_of_outputs(stepper: Any, count: int, has_first: bool = True) -> dict[str, np.ndarray]:
    """Return arrays for the values of outputs in each row, into which the kernel will write from the second one on.

    Without `has_first`, it writes into the first one too.
    """
    outputs = {}
    for name, shape in stepper.system.functions.shapes.items():
        outputs[name] = np.empty((count, *shape))
    if outputs:
        stepper.look.follower.save_in(outputs)
        if has_first:
            _write_outputs(stepper, outputs, 0)
    return outputs


def _write_outputs(stepper: Any, outputs: dict[str, np.ndarray], row: int) -> None:
    if outputs:
        for name, value in stepper.look.follower.present_outputs().items():
            outputs[name][row] = value


def _taken(again: Callable[[], Run]) -> Run:
    """Take the steps again, as a `Run`."""
    run = again()
    run.march(Stop(None, None))
    run.close()
    return run


def _notes(again: Callable[[], Run]) -> tuple[str, ...]:
    return _taken(again).all_notes()


def _state(again: Callable[[], Run]) -> dict[str, Any]:
    return _taken(again).state()
