# ruff: noqa: F821
"""The kernel for steps of variable length, which follow from tolerances.

`variable` is a template: the names in capitals stand for values that depend on the method and on the form of the
right-hand side. A state has rows of n values also for one degree of freedom: they are registers then.
"""

from __future__ import annotations

import functools
import importlib
import math
from typing import Any

from numba.types import Tuple, UniTuple, int64

from .controller import exponent, growth, shrinkage
from .dense import COEFFICIENTS, evaluate, write_up_to
from .events import EPSILON, NOT_A_NUMBER, PASSED, RESET, RESTING, TERMINAL, functions, write_time
from .jit import bound, compile_kernel, element, outlined
from .pair import A_END, U_END, V_END, A, U, V
from .protocol import (
    ERROR,
    EVALUATIONS,
    GAP,
    LOGGED,
    NEXT,
    REJECTED,
    SPAN,
    STEP,
    STEP_BEFORE,
    TIME,
    U_SIZE,
    V_SIZE,
    WATCH,
    Form,
    copy_rows,
    function_at,
    matrix_type,
    rows,
    stack_rows,
    vector_type,
)

#: How the kernel ended, besides the outcomes of events: the steps are taken, the end is reached, the next step would
#: have to be shortened to reach it, the step is below the resolution of t, or there is no room for rows or occurrences.
GOING, AT_END, BEFORE_END, TOO_SMALL, FULL = range(10, 15)

#: The rows of `Watch.work`: u and v within a step, and the dense output.
WORK = 2 + COEFFICIENTS

TINY = 1e-300  # keeps a tolerance of zero from giving 0/0

_RESOLUTION = 8 * EPSILON  # least step, relative to the time
_FIRST = 1e-6  # the part of the span, or of a unit of time, that counts as short where nothing moves yet
_LEAST_ERROR = -13.0  # the logarithm of the last error counts as at least this in the next step
LATER = 4.0  # the step after a reset is at most this multiple of the time since the reset before


def variable(callbacks, state, tally, span, watch):
    """Take steps, and return their number, the number of rows written, and how it ended."""
    n = N if N > 0 else state.shape[1]
    f, p = RHS(callbacks), span.p
    kept = rows(state, ROWS)
    y = kept
    if N > 0:
        y = stack_rows(N, ROWS)
        copy_rows(y, kept, N)
    u, v, u_end, v_end = y[U], y[V], y[U_END], y[V_END]
    u_there, v_there, coefficients = watch.work[0], watch.work[1], watch.work[2:]
    has_events, has_times, has_rows = len(watch.events) > 0, len(watch.times) > 0, len(span.t_rows) > 0
    is_followed = len(span.dense) > 0
    t, h, was_rejected = tally[TIME], tally[STEP], False
    taken, row, ended = 0, 0, GOING
    if span.first == 0:
        RESTART(y, n)
    if span.is_relative == 1 and tally[U_SIZE] == 0 and tally[V_SIZE] == 0:
        set_sizes(tally, y, n, span.atol)
    if h == 0:
        h = FIRST_STEP(f, t, n, y, tally, span)
        tally[STEP_BEFORE] = h
    while taken < span.count:
        remaining = span.t_end - t
        if remaining <= 0:
            ended = AT_END
            break
        if int(tally[LOGGED]) + len(watch.events) > len(watch.log) or (has_rows and row + 2 > len(span.t_rows)):
            ended = FULL
            break
        is_last = h >= remaining
        if is_last and h > remaining and span.may_shorten == 0:
            ended = BEFORE_END
            break
        step = remaining if is_last else h
        if not (is_last or (step > 0 and step >= _RESOLUTION * abs(t + step))):  # also for NaN
            ended = TOO_SMALL
            break
        TRIAL(f, t, step, tally[STEP_BEFORE], p, n, y)
        tally[EVALUATIONS] += COST
        u_size, v_size = 0.0, 0.0
        if span.is_relative == 1:
            u_size, v_size = sizes(tally, y, n, _FIRST * min(span.t_end - span.t0, 1.0))
        square = SQUARE(step, tally[STEP_BEFORE], n, y, span.rtol, span.atol, u_size, v_size)
        if not square <= 1.0:
            tally[REJECTED] += 1
            h = step * shrinkage(square, ORDER)
            was_rejected = True
            continue
        taken += 1
        t_end, error = span.t_end if is_last else t + step, exponent(square)
        grown = growth(error, tally[ERROR], ORDER)
        h = min(step * (min(grown, 1.0) if was_rejected else grown), span.h_max)
        was_rejected = False
        outcome, s, t_stop, is_known = PASSED, 1.0, t_end, False
        if has_events and not IS_QUIET(watch, tally, t_end, u_end, v_end, p):
            DENSE(f, t, step, p, n, y, coefficients)
            is_known = True
            outcome, s, t_stop = LOOK_WITHIN(
                watch, tally, t, step, t_end, n, coefficients, u_end, v_end, u_there, v_there, p
            )
            if outcome in (NOT_A_NUMBER, RESTING):
                taken, ended = taken - 1, outcome
                break
        tally[ERROR], tally[STEP_BEFORE] = max(error, _LEAST_ERROR), step
        if has_times:
            while int(tally[NEXT]) < len(watch.times) and watch.times[int(tally[NEXT])] <= t_stop:
                if not is_known:
                    DENSE(f, t, step, p, n, y, coefficients)
                    is_known = True
                write_time(watch, tally, t, step, t_end, n, coefficients, u_end, v_end)
        if is_followed:
            if is_known:
                write_up_to(span.dense[row], coefficients, s, n)
            else:
                DENSE(f, t, step, p, n, y, span.dense[row])
                is_known = True
        if is_known:
            tally[EVALUATIONS] += DENSE_COST
        if outcome == PASSED:
            ADVANCE(y, n)
            if has_rows and (span.first + taken) % span.every == 0:
                row = write_row(span, row, t_end, step, n, u, v)
        else:
            if s < 1.0:
                evaluate(coefficients, s, n, u_end, v_end)
            if has_rows and span.every == 1 and s > 0:  # the state at the start is a row already
                row = write_row(span, row, t_stop, s * step, n, u_end, v_end)
            for j in range(n):
                u[j], v[j] = u_there[j], v_there[j]
            ACCELERATE(f, t_stop, u, v, p, y[A])
            RESTART(y, n)
            tally[EVALUATIONS] += 1
            tally[STEP_BEFORE], tally[ERROR] = s * step, 0.0
            if outcome == RESET:
                h = min(h, LATER * tally[GAP])
            if outcome != TERMINAL and has_rows and (span.first + taken) % span.every == 0:
                row = write_row(span, row, t_stop, s * step, n, u, v)
        t = t_stop
        if span.is_relative == 1:
            for j in range(n):
                if span.atol[0, j] < math.inf:
                    tally[U_SIZE], tally[V_SIZE] = max(tally[U_SIZE], abs(u[j])), max(tally[V_SIZE], abs(v[j]))
        if outcome > RESET:
            ended = outcome
            break
    tally[TIME], tally[STEP] = t, h
    if N > 0:
        copy_rows(kept, y, N)
    return taken, row, ended


@element
def write_row(span, row, t, h, n, u, v):
    span.t_rows[row], span.h_rows[row] = t, h
    for j in range(n):
        span.u_rows[row, j], span.v_rows[row, j] = u[j], v[j]
    return row + 1


@element
def set_sizes(tally, y, n, atol):
    """Write the sizes of u and v at the start. A velocity that is zero gets the size sqrt(u a) of an oscillation."""
    a_size = 0.0
    for j in range(n):
        if atol[0, j] < math.inf:
            tally[U_SIZE], tally[V_SIZE] = max(tally[U_SIZE], abs(y[U][j])), max(tally[V_SIZE], abs(y[V][j]))
            a_size = max(a_size, abs(y[A][j]))
    if tally[V_SIZE] == 0:
        tally[V_SIZE] = math.sqrt(tally[U_SIZE] * a_size)


@element
def sizes(tally, y, n, least):
    """Return the sizes of u and v in a step. Where nothing has moved yet, they are those after the time `least`."""
    u_size, v_size, a_size = tally[U_SIZE], tally[V_SIZE], 0.0
    if u_size == 0 or v_size == 0:
        for j in range(n):
            a_size = max(a_size, abs(y[A][j]), abs(y[A_END][j]))
    v_size = v_size if v_size > 0 else least * a_size
    return u_size if u_size > 0 else least * v_size, v_size


def first_step(f, t, n, y, tally, span):
    """Return a first step: E. Hairer, S. P. Norsett and G. Wanner, Solving Ordinary Differential Equations I, II.4.

    The unit of time does not matter, except for a motion that starts at rest at zero, in a span of more than a unit:
    the first step must not depend on the end of the span, from which a run may go on.
    """
    u, v, a, u_end, v_end, a_end = y[:6]
    length = span.t_end - t
    least = _FIRST * min(length, 1.0)
    u_size, v_size = 0.0, 0.0
    if span.is_relative == 1:
        u_size, v_size = sizes(tally, y, n, least)
    size, slope = 0.0, 0.0
    for j in range(n):
        u_scale = span.atol[0, j] + span.rtol * max(abs(u[j]), u_size) + TINY
        v_scale = span.atol[1, j] + span.rtol * max(abs(v[j]), v_size) + TINY
        size += (u[j] / u_scale) ** 2 + (v[j] / v_scale) ** 2
        slope += (v[j] / u_scale) ** 2 + (a[j] / v_scale) ** 2
    size, slope = math.sqrt(size / (2 * n)), math.sqrt(slope / (2 * n))
    h = min(least if size < 1e-5 or slope * length < 1e-5 else 0.01 * size / slope, length)
    for j in range(n):
        u_end[j], v_end[j] = u[j] + h * v[j], v[j] + h * a[j]
    ACCELERATE(f, t + h, u_end, v_end, span.p, a_end)
    tally[EVALUATIONS] += 1
    bend = 0.0
    for j in range(n):
        u_scale = span.atol[0, j] + span.rtol * max(abs(u[j]), u_size) + TINY
        v_scale = span.atol[1, j] + span.rtol * max(abs(v[j]), v_size) + TINY
        bend += ((v_end[j] - v[j]) / u_scale) ** 2 + ((a_end[j] - a[j]) / v_scale) ** 2
    change = h * max(slope, math.sqrt(bend / (2 * n)))
    better = h * (0.01 / change) ** (1 / ORDER) if change > 1e-15 else max(least, h * 1e-3)
    return min(100 * h, better if better > 0 else h, length, span.h_max)


@functools.cache
def variable_kernel(module: str, form: Form, n: int) -> Any:
    """Compile the kernel of a method for a right-hand side given as an address, or load it from the disk.

    `module` is the name of a file of this folder with the formulas `variable`, see `eig3.kernels.pair`. If `n` is not
    0, the kernel is valid for n degrees of freedom only.

    It is called as ``kernel((rhs,), state, tally, span, watch)``.
    """
    rhs_at = function_at(form.rhs)
    names = _names(module, form, n) | {"RHS": element(lambda callbacks: rhs_at(callbacks[0]))}
    return compile_kernel(variable, names, _signature(Tuple((int64,))), f"{module}_{form.name}_{n}")


def inline_variable_kernel(module: str, form: Form, n: int, rhs: Any) -> Any:
    """Compile the kernel of a method with one right-hand side inlined. It is called as ``kernel((), state, ...)``."""
    names = _names(module, form, n) | {"RHS": element(lambda callbacks: rhs)}
    return compile_kernel(variable, names, _signature(Tuple(())))


def _signature(callbacks: Any) -> Any:
    return UniTuple(int64, 3)(callbacks, matrix_type, vector_type, SPAN, WATCH)


def _names(module: str, form: Form, n: int) -> dict[str, Any]:
    formulas = importlib.import_module(f"{__package__}.{module}").variable
    watching = functions(form)
    theirs = formulas.functions(watching.accelerate)
    names = {
        "N": n,
        "ROWS": formulas.rows,
        "ORDER": formulas.order,
        "COST": formulas.evaluations,
        "DENSE_COST": formulas.dense_evaluations,
        "TRIAL": theirs["trial"],
        "SQUARE": theirs["square"],
        "DENSE": theirs["dense"],
        "ADVANCE": theirs.get("advance", advance),
        "RESTART": theirs.get("restart", nothing_past),
        "ACCELERATE": watching.accelerate,
        "IS_QUIET": watching.is_quiet,
        "LOOK_WITHIN": watching.look_within,
    }
    names["FIRST_STEP"] = outlined(bound(first_step, names))
    return names


@element
def advance(y, n):
    for j in range(n):
        y[U][j], y[V][j], y[A][j] = y[U_END][j], y[V_END][j], y[A_END][j]


@element
def nothing_past(y, n):
    pass
