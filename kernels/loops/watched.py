# ruff: noqa: F821
"""The kernel of a fixed-step method that looks for events, and for times at which the state is wanted, in each step.

`scalar` and `vector` are templates, like those of `eig3.kernels.loops.fixed`. Steps in which nothing is found run in
the loops `march_scalar` and `march_vector`. The step after which they stop is searched with its dense output. From a
reset, steps of a Runge-Kutta pair lead to the end of the step, where the method starts anew.
"""

from __future__ import annotations

import functools
import importlib
import math
from typing import Any

from numba.types import UniTuple, int64

from ..compile.jit import bound, compile_kernel, element, outlined
from ..protocol import (
    ANEW,
    EVALUATIONS,
    GAP,
    LOGGED,
    NEXT,
    SCALAR,
    TIME,
    WATCH,
    WITHIN,
    At,
    Form,
    Work,
    floats,
    rows,
    vector_type,
)
from .dense import quintic
from .events import NOT_A_NUMBER, PASSED, RESET, RESTING, functions, write_time
from .fixed import METHODS, Formulas, inline_callbacks, nothing, pointer_callbacks
from .march import settle
from .pair import A_END, U_END, V_END, A, U, V
from .variable import FULL, GOING, LATER, WORK

#: The solve of a step failed.
FAILED = 20

_THROUGH, _FOUND = range(2)  # how a march ended, besides FAILED


def scalar(callbacks, state, settings, tally, run, watch):
    """Take steps, and return their number and how it ended."""
    f = RHS(callbacks)
    c = CONSTANTS(settings, run.h, Work(tally, None, JACOBIAN(callbacks)))
    pair = rows(watch.work[WORK:], PAIR_ROWS)
    y, i, row, last, ended = floats(state, VALUES), run.first, 0, run.first + run.count, GOING
    while i < last and ended == GOING:
        if 2 * int(tally[LOGGED]) > len(watch.log):
            ended = FULL
            break
        first, begun = i, int(tally[ANEW]) + START_STEPS
        if tally[WITHIN] == 1:
            i, found = i + 1, _FOUND
        elif START_STEPS > 0 and i < begun:
            u, v, y, i, row, found = march_scalar(
                START_STEP, IS_QUIET, f, y, c, run, watch, tally, i, min(last, begun), row
            )
            tally[EVALUATIONS] += START_COST * (i - first)
        else:
            u, v, y, i, row, found = march_scalar(STEP, IS_QUIET, f, y, c, run, watch, tally, i, last, row)
            tally[EVALUATIONS] += COST * (i - first)
        if found == FAILED:
            ended = FAILED
        elif found == _FOUND:
            t = run.t0 + i * run.h
            if tally[WITHIN] == 0:
                pair[U][0], pair[V][0], pair[U_END][0], pair[V_END][0] = u, v, y[0], y[1]
            outcome = SEARCH(f, watch, tally, run.t0 + (i - 1) * run.h, t, 1, run.p)
            if outcome != PASSED:
                u, v = pair[U_END][0], pair[V_END][0]
                y = STARTED(f, tally[TIME] if outcome > RESET else t, u, v, run.h, run.p)
                tally[EVALUATIONS] += 1
                tally[ANEW] = i
            if outcome > RESET:
                ended = outcome
                i -= 1
            elif i % run.every == 0:
                run.u_rows[row], run.v_rows[row] = y[0], y[1]
                row += 1
    for k in range(VALUES):
        state[k] = y[k]
    return i - run.first, ended


@element
def march_scalar(step, is_quiet, f, y, c, run, watch, tally, first, last, row):
    """Advance the tuple `y` until a step is found that must be searched.

    Return u and v before the last step, `y`, the step index that was reached, the next row to write, and how it ended.
    The state after a step that was found is not written.
    """
    left, k = run.every - first % run.every, int(tally[NEXT])
    wanted = watch.times[k] if k < len(watch.times) else math.inf
    for i in range(first, last):
        y_next, success = step(f, At(i, run.t0 + i * run.h, run.h, run.p), y, c)
        if not success:
            return y[0], y[1], y, i, row, FAILED
        t = run.t0 + (i + 1) * run.h
        if wanted <= t or not is_quiet(watch, tally, t, y_next[0], y_next[1], run.p):
            return y[0], y[1], y_next, i + 1, row, _FOUND
        y = y_next
        left -= 1
        if left == 0:
            run.u_rows[row] = y[0]
            run.v_rows[row] = y[1]
            row += 1
            left = run.every
    return y[0], y[1], y, last, row, _THROUGH


def vector(callbacks, state, settings, tally, run, watch):
    """Do the same as `scalar` for n degrees of freedom."""
    n = N if N > 0 else state.shape[1]
    f = RHS(callbacks)
    c = CONSTANTS(settings, run.h, Work(tally, state[ROWS:], JACOBIAN(callbacks)))
    pair = rows(watch.work[WORK:], PAIR_ROWS)
    y, i, row, last, ended = rows(state, OWN_ROWS), run.first, 0, run.first + run.count, GOING
    while i < last and ended == GOING:
        if 2 * int(tally[LOGGED]) > len(watch.log):
            ended = FULL
            break
        first, begun = i, int(tally[ANEW]) + START_STEPS
        if tally[WITHIN] == 1:
            i, found = i + 1, _FOUND
        elif START_STEPS > 0 and i < begun:
            with_scratch = c, state[OWN_ROWS:]
            y, i, row, found = march_vector(
                START_STEP, nothing, IS_QUIET, f, y, with_scratch, n, run, watch, tally, pair, i, min(last, begun), row
            )
            tally[EVALUATIONS] += START_COST * (i - first)
        else:
            y, i, row, found = march_vector(STEP, COMPLETE, IS_QUIET, f, y, c, n, run, watch, tally, pair, i, last, row)
            tally[EVALUATIONS] += COST * (i - first)
        if found == FAILED:
            ended = FAILED
        elif found == _FOUND:
            t = run.t0 + i * run.h
            if tally[WITHIN] == 0:
                copy_two(pair[U_END], pair[V_END], y[0], y[1], n)
            outcome = SEARCH(f, watch, tally, run.t0 + (i - 1) * run.h, t, n, run.p)
            if outcome != PASSED:
                copy_two(y[0], y[1], pair[U_END], pair[V_END], n)
                START_ANEW(f, tally[TIME] if outcome > RESET else t, y, run.h, run.p, n, pair[A])
                tally[EVALUATIONS] += 1
                tally[ANEW] = i
            if outcome > RESET:
                ended = outcome
                i -= 1
            elif i % run.every == 0:
                copy_two(run.u_rows[row], run.v_rows[row], y[0], y[1], n)
                row += 1
    settle(y, state, n)
    return i - run.first, ended


@element
def march_vector(step, complete, is_quiet, f, y, c, n, run, watch, tally, pair, first, last, row):
    """Do the same as `march_scalar` for a tuple of rows. u and v before the last step are in `pair`."""
    left, k = run.every - first % run.every, int(tally[NEXT])
    wanted = watch.times[k] if k < len(watch.times) else math.inf
    for i in range(first, last):
        copy_two(pair[U], pair[V], y[0], y[1], n)
        y_next, success = step(f, At(i, run.t0 + i * run.h, run.h, run.p), y, c, n)
        if not success:
            return y, i, row, FAILED
        y = y_next
        complete(y, c, run.h, n)
        t = run.t0 + (i + 1) * run.h
        if wanted <= t or not is_quiet(watch, tally, t, y[0], y[1], run.p):
            return y, i + 1, row, _FOUND
        left -= 1
        if left == 0:
            copy_two(run.u_rows[row], run.v_rows[row], y[0], y[1], n)
            row += 1
            left = run.every
    return y, last, row, _THROUGH


@element
def copy_two(u, v, u_from, v_from, n):
    for j in range(n):
        u[j], v[j] = u_from[j], v_from[j]


def search(f, watch, tally, t, t_grid, n, p):
    """Search the step from t to `t_grid`, whose two states are in rows of `watch.work`, and return the outcome.

    After a reset, the state at the end of the step is that at `t_grid`, or that of the event which ends the run. If the
    log is full after some resets, FULL is returned, and the next call goes on from the last of them.
    """
    y = rows(watch.work[WORK:], PAIR_ROWS)
    u, v, a, u_end, v_end = y[U], y[V], y[A], y[U_END], y[V_END]
    u_there, v_there, coefficients = watch.work[0], watch.work[1], watch.work[2:]
    t_end, reach, result = t_grid, 0.0, PASSED
    if tally[WITHIN] == 0:
        ACCELERATE(f, t, u, v, p, a)
        STEP_DENSE(f, t, t_grid - t, p, n, y, u_there, v_there, coefficients)
        tally[EVALUATIONS] += 1 + STEP_DENSE_COST
    else:
        t, reach, result = tally[TIME], LATER * tally[GAP], RESET
        t_end = min(t_grid, t + reach)
        TRIAL(f, t, t_end - t, t_end - t, p, n, y)
        DENSE(f, t, t_end - t, p, n, y, coefficients)
        tally[WITHIN] = 0
    while True:
        h = t_end - t
        if int(tally[LOGGED]) + len(watch.events) > len(watch.log):
            copy_two(u_end, v_end, u, v, n)
            tally[TIME], tally[WITHIN] = t, 1
            return FULL
        outcome, _, stop = LOOK_WITHIN(watch, tally, t, h, t_end, n, coefficients, u_end, v_end, u_there, v_there, p)
        if outcome in (NOT_A_NUMBER, RESTING):
            copy_two(u_end, v_end, u, v, n)
            tally[TIME] = t
            return outcome
        while int(tally[NEXT]) < len(watch.times) and watch.times[int(tally[NEXT])] <= stop:
            write_time(watch, tally, t, h, t_end, n, coefficients, u_end, v_end)
        if outcome > RESET or (outcome == RESET and stop >= t_grid):
            copy_two(u_end, v_end, u_there, v_there, n)
            tally[TIME] = stop
            return outcome
        if outcome == RESET:
            copy_two(u, v, u_there, v_there, n)
            result, reach = RESET, tally[GAP]
        elif t_end == t_grid:
            return result
        else:
            copy_two(u, v, u_end, v_end, n)
        ACCELERATE(f, stop, u, v, p, a)
        t, reach = stop, LATER * reach
        t_end = min(t_grid, t + reach)
        TRIAL(f, t, t_end - t, t_end - t, p, n, y)
        DENSE(f, t, t_end - t, p, n, y, coefficients)
        tally[EVALUATIONS] += PAIR_COST


def quintic_of_step(f, t, h, p, n, y, u_there, v_there, coefficients):
    """Write the dense output of a step whose states are known."""
    ACCELERATE(f, t + h, y[U_END], y[V_END], p, y[A_END])
    quintic(h, n, y[U], y[V], y[A], y[U_END], y[V_END], y[A_END], coefficients)


def extension_of_step(f, t, h, p, n, y, u_there, v_there, coefficients):
    """Write the dense output of a step of RK8 from the same state. The state at the end of the step is kept."""
    copy_two(u_there, v_there, y[U_END], y[V_END], n)
    TRIAL(f, t, h, h, p, n, y)
    DENSE(f, t, h, p, n, y, coefficients)
    copy_two(y[U_END], y[V_END], u_there, v_there, n)


def started_scalar(f, t, u, v, h, p):
    """Return the tuple of a method that starts at a state."""
    start = u, v
    return start + START(u, v, f(t, u, v, p), h)


def started_without_past(f, t, u, v, h, p):
    return u, v


def start_anew(f, t, y, h, p, n, a):
    """Write the past values of a method that starts at the state in its rows."""
    f(t, y[0], y[1], p, a)
    for j in range(n):
        past = START(y[0][j], y[1][j], a[j], h)
        for k in range(PAST):
            y[2 + k][j] = past[k]


def start_without_past(f, t, y, h, p, n, a):
    pass


def work_rows(order: int) -> int:
    """Return the number of rows of `Watch.work` for a method of this order."""
    return WORK + _pair_for(order).rows


def _pair_for(order: int) -> Any:
    """Return the formulas for the steps from a reset to the end of a step."""
    return importlib.import_module(f"{METHODS}.{'rk5' if order <= 5 else 'rk8'}").variable


@functools.cache
def watched_kernel(method: Formulas, order: int, form: Form, takes_jacobian: bool = False) -> Any:
    """Compile the kernel of a method for callbacks given as addresses, or load it from the disk.

    It is called as ``kernel((rhs, jacobian or None), state, settings, tally, run, watch)``, and returns the number of
    steps that it took, and how it ended: GOING after all steps, FULL, FAILED, or an outcome of an event.
    """
    callbacks, names = pointer_callbacks(form, takes_jacobian)
    label = f"{method.label}_watched{'_jacobian' * takes_jacobian}" if method.is_own else ""
    return _compile(method, order, form, callbacks, names, label)


def inline_watched_kernel(method: Formulas, order: int, form: Form, rhs: Any, jacobian: Any) -> Any:
    """Compile the kernel of a method with one right-hand side inlined. It is called as ``kernel((), state, ...)``."""
    callbacks, names = inline_callbacks(rhs, jacobian)
    return _compile(method, order, form, callbacks, names, "")


def _compile(method: Formulas, order: int, form: Form, callbacks: Any, names: dict[str, Any], label: str) -> Any:
    names = {**method.names(form), **names, "N": 0, **_search_names(_pair_for(order), form)}
    start = {"START": element(method.start), "PAST": method.past}
    if form is SCALAR:
        names["STARTED"] = element(bound(started_scalar, start) if method.past else started_without_past)
    else:
        names["START_ANEW"] = element(bound(start_anew, start) if method.past else start_without_past)
    signature = UniTuple(int64, 2)(callbacks, form.state, vector_type, vector_type, form.run, WATCH)
    return compile_kernel(scalar if form is SCALAR else vector, names, signature, label)


@functools.cache  # so that the kernels of all methods share the compiled search
def _search_names(pair: Any, form: Form) -> dict[str, Any]:
    watching = functions(form)
    theirs = pair.functions(watching.accelerate)
    has_extension = pair.dense_evaluations > 0
    names = {
        "PAIR_ROWS": pair.rows,
        "PAIR_COST": 1 + pair.evaluations + pair.dense_evaluations,
        "STEP_DENSE_COST": pair.evaluations + pair.dense_evaluations if has_extension else 1,
        "TRIAL": outlined(theirs["trial"].py_func),
        "DENSE": theirs["dense"],
        "ACCELERATE": watching.accelerate,
        "LOOK_WITHIN": watching.look_within,
        "IS_QUIET": watching.is_quiet_now,
    }
    names["STEP_DENSE"] = outlined(bound(extension_of_step if has_extension else quintic_of_step, names))
    names["SEARCH"] = outlined(bound(search, names))
    return names
