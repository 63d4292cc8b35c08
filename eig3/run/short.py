"""A run that is over within a slice: the kernel is called without a loop, and notes and the like wait for a reader.

The kernel gets the arguments that a `Run` would give it, so that the numbers have the same bits. A `Run` does the runs
that may not end well. It is also made of the stepper of a short run, where this stands at its end: it knows what a
solution can do later, such as to go on, and takes no step again.
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
from ..stepping.march import Rows
from ..stepping.options import NEVER
from ..stepping.stepper import Stepper
from ..stepping.variable_stepper import VariableStepper
from .fixed_run import FixedRun, grid, stride
from .growth import STRANGE, natural_sizes
from .run import Run, ended_by_event, solution_of
from .variable_run import VariableRun

_NONE = np.empty(0)
# Duration of a short run, by the time per step of an earlier one. Ctrl-C waits for it. Slices would take a fifth longer
# for runs of 1 ms.
MOST_SECONDS = 5e-3
TRIED_SECONDS = 4e-4  # duration for which a run with tolerances is tried as a short one, whatever the last one took
MOST_VALUES = 2**17  # in its rows


def fixed(stepper: Stepper, n_steps: int, t_end: float, save_every: int | None) -> Solution | None:
    """Take the steps of a run with a fixed step, from its start; return None if its end needs a closer look."""
    start, state, every = stepper.start, stepper.state, stride(save_every, n_steps)
    count = n_steps // every + 1 + (n_steps % every > 0)
    u, v = np.empty((count, stepper.n)), np.empty((count, stepper.n))
    u[0], v[0] = start
    outputs = _rows_of_outputs(stepper, count) if stepper.look else {}
    steps = Steps(stepper.h, stepper.t0, stepper.params, 0, n_steps, every, 1, u, v)
    row = _call(stepper, steps)
    if not _is_well(stepper, GOING, n_steps * stepper.h):
        return None
    index, end = stepper.index, t_end
    if stepper.ended == TERMINAL:  # the last row is the state after the event
        end, count = stepper.t, row + (index % every > 0 or stepper.is_within_step)
        row, u, v = count - 1, u[:count], v[:count]
        outputs = {name: values[:count] for name, values in outputs.items()}
    if row < count:
        u[row], v[row] = state[0], state[1]
        _write_outputs(stepper, outputs, row)
    u, v = (u[:, 0], v[:, 0]) if stepper.form is SCALAR else (u, v)
    rows = {"u": u, "v": v}
    run = partial(FixedRun.ended, stepper, n_steps, t_end, save_every, None, rows, outputs)
    later = {"t": partial(grid, stepper.t0, stepper.h, every, count, index, end)}
    return _solution(stepper, {**rows, "outputs": outputs}, later, run)


def variable(stepper: VariableStepper, most: int, every: int, count: int) -> Solution | None:
    """Do the same for a run with tolerances; return None too if it needs more than `most` steps or `count` rows."""
    n = stepper.n
    t, h, u, v = rows = np.empty(count), np.empty(count), np.empty((count, n)), np.empty((count, n))
    t[0], h[0], (u[0], v[0]) = stepper.t0, 0.0, stepper.start
    outputs = _rows_of_outputs(stepper, count) if stepper.look else {}
    row = _call(stepper, stepper.steps(min(stepper.tolerances.max_steps, most), every, 1, rows))
    if not _is_well(stepper, AT_END, math.inf):
        return None
    t_last, h_last = float(stepper.tally[TIME]), float(stepper.tally[STEP_BEFORE])
    is_over = stepper.ended == TERMINAL
    if t[row - 1] != t_last or (is_over and (stepper.state[:2] != (u[row - 1], v[row - 1])).any()):
        t[row], h[row], u[row], v[row] = t_last, h_last, stepper.state[0], stepper.state[1]
        _write_outputs(stepper, outputs, row)
        row += 1
    outputs = {name: values[:row] for name, values in outputs.items()} if outputs else {}
    u, v = (u[:row, 0], v[:row, 0]) if stepper.form is SCALAR else (u[:row], v[:row])
    saved = {"t": t[:row], "steps": h[:row], "u": u, "v": v}
    run = partial(VariableRun.ended, stepper, every, None, saved, outputs, stepper.rows_before_end or row)
    between = stepper.states_between if every == 1 else None
    return _solution(stepper, {**saved, "outputs": outputs, "_between": between}, {}, run)


def at_times(stepper: Any, most: int, t_end: float, times: np.ndarray) -> Solution | None:
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
    no_rows = Rows(_NONE, _NONE, *[np.empty((0, n))] * 2)
    if isinstance(stepper, VariableStepper):
        _call(stepper, stepper.steps(min(stepper.tolerances.max_steps, most), 1, 0, no_rows))
        is_well = _is_well(stepper, AT_END, math.inf)
    else:
        del rows["steps"]
        _call(stepper, stepper.steps(most, most + 1, 0, no_rows))
        is_well = _is_well(stepper, GOING, most * stepper.h)
    if not is_well:
        return None
    written, end = stepper.n_wanted, stepper.t if stepper.ended == TERMINAL else t_end
    look.watching.finish(tally, stepper.t0, end, stepper.h, stepper.u, stepper.v)
    count = stepper.n_wanted
    if outputs and written < count:  # `finish` has written states without outputs
        return None
    outputs = {name: values[:count] for name, values in outputs.items()}
    saved = {"t": times[:count].copy()}
    for name, values in rows.items():
        saved[name] = values[:count, 0] if values.ndim == 2 and stepper.form is SCALAR else values[:count]
    if isinstance(stepper, VariableStepper):
        run: Callable[[], Run] = partial(VariableRun.ended, stepper, NEVER, times, saved, outputs, 0)
    else:
        run = partial(FixedRun.ended, stepper, most, t_end, None, times, saved, outputs)
    return _solution(stepper, {**saved, "outputs": outputs, "_between": None}, {}, run)


def _solution(stepper: Any, fields: dict[str, Any], later: dict[str, Any], run: Callable[[], Run]) -> Solution:
    """Return the solution with these fields; `run` returns the run at its end, which has what is found later."""
    if stepper.ended == TERMINAL:
        fields["status"], fields["message"] = ended_by_event(stepper.ended, stepper.ended_by, stepper.t)
    else:
        fields["_resume"] = partial(_state, run)
    if isinstance(stepper, VariableStepper):
        fields["h"] = (float(stepper.tally[TIME]) - stepper.t0) / max(1, stepper.index)
        fields["n_rejected"] = int(stepper.tally[REJECTED])
    else:
        fields["h"] = stepper.h
    fields["_extend"], later["notes"] = run, partial(_notes, run)
    return solution_of(stepper, fields, later)


def _call(stepper: Any, steps: Any) -> int:
    """Call the kernel, and return the next row to write."""
    kernel = stepper.kernel
    arguments = stepper.look.arguments if stepper.look else None
    begin = time.perf_counter()
    taken, row, stepper.ended = kernel.call(
        kernel.callbacks, stepper.state, kernel.settings, stepper.tally, steps, arguments
    )
    stepper.seconds += time.perf_counter() - begin
    stepper.index += taken
    if stepper.look:
        stepper.look.watching.collect(stepper.tally)
    return row


def _is_well(stepper: Any, wanted: int, span: float) -> bool:
    """Return whether the run has ended as `wanted` or by a terminal event, and needs no closer look.

    It needs one if the motion is not finite or has grown much over a span with a fixed step, or if rhs leaves out an
    entry of a.
    """
    state, tally, is_fixed = stepper.state, stepper.tally, wanted == GOING
    if stepper.ended not in (wanted, TERMINAL):
        return False
    if stepper.index:
        stepper.system.pace[stepper.kernel.pace_key] = stepper.seconds / stepper.index
    if stepper.look:
        stepper.look.follower.check()
    if stepper.form is SCALAR:
        u, v = abs(state.item(0)), abs(state.item(1))
    else:
        t = stepper.t0 + (stepper.index - 1) * stepper.h if is_fixed else float(tally[TIME] - tally[STEP_BEFORE])
        # As `evaluation` does, without its Python call: a run makes few of them.
        room = np.empty((3, stepper.n + 2 * CELLS))
        u, v, a, _ = guarded_kernel()(stepper.system.callback.address, t, state[0], state[1], stepper.params, room)
        if a == math.inf:
            return False
    if not is_fixed:
        return bool(u < math.inf and v < math.inf)
    u_natural, v_natural = natural_sizes(stepper.first_sizes, span)
    return bool(u < STRANGE * u_natural and v < STRANGE * v_natural)


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


def _notes(run: Callable[[], Run]) -> tuple[str, ...]:
    return run().all_notes()


def _state(run: Callable[[], Run]) -> dict[str, Any]:
    return run().state()
