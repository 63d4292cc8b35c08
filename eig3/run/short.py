"""Short runs: one call of the kernel without a loop; notes and similar values are computed when they are read.

The kernel gets the same arguments as from a `Run`, and the results are bitwise the same. A `Run` does the runs that may
not complete. It is also made from the stepper of a short run at its end, without repeating a step, for later requests
such as `extend`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from ..functions.guard import GUARD_VALUES
from ..kernels.loops.evaluation import guarded_kernel
from ..kernels.protocol import AT_END, BEFORE_END, GOING, NEXT, REJECTED, SCALAR, STEP_BEFORE, TERMINAL, TIME
from ..result.solution import Solution
from ..stepping.stepper import Stepper
from .chunks import ended_by_event, solution_of
from .fixed_run import grid
from .growth import STRANGE, natural_sizes

_NONE, _AT_REST = np.empty(0), (0.0, 0.0)
# Duration of a short run, by the time per step of an earlier run. Ctrl-C waits for it. Slices would take a fifth longer
# for runs of 1 ms.
MOST_SECONDS = 5e-3
TRIED_SECONDS = 4e-4  # a run with tolerances is tried as a short run up to this duration, independently of the last run
MOST_VALUES = 2**17  # in its rows


def at_once(
    stepper: Any, most: int, t_end: float, every: int, count: int, times: np.ndarray | None, kind: Any, given: tuple
) -> Solution | None:
    """Take all steps of a run in one call; return None if its end needs further checks.

    The run has `most` steps and `count` rows, or with tolerances fewer. ``kind.ended(stepper, *given, rows, outputs)``
    returns the `Run` at its end.
    """
    is_fixed, look, counters, state = isinstance(stepper, Stepper), stepper.look, stepper.counters, stepper.state
    u, v = np.empty((count, stepper.n)), np.empty((count, stepper.n))
    t, h = (_NONE, _NONE) if is_fixed else (np.empty(count), np.empty(count))
    row = 1 if times is None or times[0] == stepper.t0 else 0
    if row:
        u[0], v[0] = stepper.start
        if not is_fixed:
            t[0], h[0] = stepper.t0, 0.0
    rows, outputs, arguments = (t, h, u, v), {}, None
    if look:
        outputs = _rows_of_outputs(stepper, count, row)
        if times is not None:
            look.save_wanted({"u": u, "v": v} if is_fixed else {"u": u, "v": v, "steps": h}, stepper.n)
            counters[NEXT], rows = row, (t[:0], h[:0], u[:0], v[:0])
        arguments = look.arguments
    kernel, from_rest = stepper.kernel, is_fixed and stepper.first_sizes[1:] == _AT_REST
    steps = stepper.steps(most // 2 if from_rest else most, every, row, rows)
    begin = time.perf_counter()
    taken, row, ended = kernel.call(kernel.callbacks, state, kernel.settings, counters, steps, arguments)
    if ended == BEFORE_END or (from_rest and ended == GOING):
        stepper.index = taken
        if look:
            look.collect(counters)
        if from_rest:
            stepper.middle_sizes = stepper.sizes
        else:
            stepper.shorten(row)
        steps = stepper.steps(most - taken, every, row, rows)
        taken, row, ended = kernel.call(kernel.callbacks, state, kernel.settings, counters, steps, arguments)
    stepper.seconds += time.perf_counter() - begin
    stepper.index, stepper.ended = stepper.index + taken, ended
    if look:
        look.collect(counters)
    if not _is_well(stepper, is_fixed, most):
        return None
    is_over = stepper.ended == TERMINAL
    if times is not None:
        look.finish(stepper, stepper.t if is_over else t_end)
        row = stepper.n_wanted
    else:
        row = _complete(stepper, is_fixed, every, row, rows, outputs)
    outputs = {name: values[:row] for name, values in outputs.items()} if outputs else outputs
    if stepper.form is SCALAR:
        u, v = u[:row, 0], v[:row, 0]
    elif row < count:
        u, v = u[:row], v[:row]
    saved = {"u": u, "v": v} if is_fixed else {"u": u, "v": v, "t": t[:row], "steps": h[:row]}
    if times is not None:
        saved["t"] = times[:row].copy()
    run = partial(kind.ended, stepper, *given, saved, outputs)
    fields = {**saved, "outputs": outputs, "_extend": run}
    later: dict[str, Callable[[], Any]] = {"notes": lambda: run().all_notes()}
    if is_fixed:
        fields["h"] = stepper.h
    else:
        fields["h"] = (counters.item(TIME) - stepper.t0) / max(1, stepper.index)
        fields["n_rejected"] = int(counters[REJECTED])
        fields["_between"] = stepper.states_between if every == 1 else None
    if "t" not in saved:
        later["t"] = partial(grid, stepper.t0, stepper.h, every, row, stepper.index, stepper.t if is_over else t_end)
    if is_over:
        fields["status"], fields["message"] = ended_by_event(stepper.ended, stepper.ended_by, stepper.t)
    else:
        fields["_resume"] = lambda: run().state()
    return solution_of(stepper, fields, later)


def _complete(stepper: Any, is_fixed: bool, every: int, row: int, rows: tuple, outputs: dict[str, np.ndarray]) -> int:
    """Write the last state, unless it is in the last row, and return the number of rows."""
    t, h, u, v = rows
    state, is_over = stepper.state, stepper.ended == TERMINAL
    if is_fixed:
        is_new = stepper.index % every > 0 or (is_over and stepper.is_within_step)
        if is_over and not is_new:  # the resets at the end of a step are in the last row
            row -= 1
        if not (is_new or is_over):
            return row
    else:
        if t[row - 1] == stepper.t and not (is_over and (state[:2] != (u[row - 1], v[row - 1])).any()):
            return row
        t[row], h[row] = stepper.t, stepper.h
    u[row], v[row] = state[0], state[1]
    if outputs:
        _write_outputs(stepper, outputs, row)
    return row + 1


def _is_well(stepper: Any, is_fixed: bool, most: int) -> bool:
    """Return whether the run has reached its end or a terminal event, and needs no further checks.

    Checks are needed if the motion is not finite or has grown much with a fixed step, or if rhs does not write an entry
    of a.
    """
    state, counters = stepper.state, stepper.counters
    if stepper.ended not in (GOING if is_fixed else AT_END, TERMINAL):
        return False
    if stepper.index:
        stepper.system.pace[stepper.kernel.pace_key] = stepper.seconds / stepper.index
    if stepper.look:
        stepper.look.check()
    if stepper.form is SCALAR:
        u, v = abs(state.item(0)), abs(state.item(1))
    else:
        t = stepper.t0 + (stepper.index - 1) * stepper.h if is_fixed else float(counters[TIME] - counters[STEP_BEFORE])
        # As in `evaluation`, without its Python call.
        room = np.empty((3, stepper.n + 2 * GUARD_VALUES))
        u, v, a, _ = guarded_kernel()(stepper.system.callback.address, t, state[0], state[1], stepper.p, room)
        if a == math.inf:
            return False
    if not is_fixed:
        return bool(u < math.inf and v < math.inf)
    u_natural, v_natural = stepper.middle_sizes or natural_sizes(stepper.first_sizes, most * stepper.h)
    return bool(u < STRANGE * u_natural and v < STRANGE * v_natural)


def _rows_of_outputs(stepper: Any, count: int, row: int) -> dict[str, np.ndarray]:
    """Return arrays for the values of outputs in each row, into which the kernel will write from this row on."""
    outputs = {}
    for name, shape in stepper.system.functions.shapes.items():
        outputs[name] = np.empty((count, *shape))
    if outputs:
        stepper.look.save_outputs(outputs)
        if row:
            _write_outputs(stepper, outputs, 0)
    return outputs


def _write_outputs(stepper: Any, outputs: dict[str, np.ndarray], row: int) -> None:
    for name, value in stepper.look.present_outputs().items():
        outputs[name][row] = value
