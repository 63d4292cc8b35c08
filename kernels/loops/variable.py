# ruff: noqa: F821
"""The kernel for steps of variable length, which follow from tolerances.

`variable` is a template: the names in capitals stand for values that depend on the method, on the form of the
right-hand side and on the mode. LOOKS says for what the kernel looks, see `FOLLOWS`: the compiler leaves out the rest.
A state has rows of n values also for one degree of freedom: they are registers then.
"""

from __future__ import annotations

import functools
import importlib
import math
from typing import Any

from numba.types import Tuple, UniTuple, int64, none

from ..compile.jit import bound, compile_kernel, element, outlined
from ..protocol import (
    AT_END,
    BEFORE_END,
    BY_SPAN,
    ERROR,
    EVALUATIONS,
    FULL,
    GAP,
    GOING,
    LOGGED,
    LOOK_WITHIN,
    NEXT,
    NOT_A_NUMBER,
    PART,
    PARTS,
    PASSED,
    REJECTED,
    RESET,
    RESTING,
    SEARCHES,
    SILENT_END,
    SILENT_STEP,
    SPAN,
    STEP,
    STEP_BEFORE,
    TERMINAL,
    TIME,
    TOO_SMALL,
    U_SIZE,
    V_SIZE,
    ZENO,
    Form,
    address_of,
    copy_rows,
    matrix_type,
    rows,
    stack_rows,
    vector_type,
)
from .controller import exponent, growth, shrinkage
from .dense import evaluate
from .events import EPSILON, LATER, WORK, quiet, searching
from .fixed import STACKED_DEGREES
from .follow import end_part, inline_functions, save, widen_all
from .follow import functions as following
from .formulas import METHODS
from .pair import A_END, U_END, U_MOST, V_END, V_MOST, A, U, V
from .within import within_functions

__all__ = ["WORK", "inline_kernel", "kernel", "least_size"]

TINY = 1e-300  # keeps a tolerance of zero from giving 0/0

_RESOLUTION = 8 * EPSILON  # least step, relative to the time
_FIRST = 1e-6  # the part of the span, or of a unit of time, that counts as short where nothing moves yet
_BLUR = 4.0  # times the resolution of t: at what time a motion begins is not known better
_SILENCE = 0.02  # longest step while nothing acts, as a part of the time since the start
_LEAST_SIZE = 1e-3  # of a degree of freedom, relative to the largest size of all
_ROUND_OFF = 1e5 * EPSILON  # least tolerance, relative to the largest size: forces are differences of large values
_LEAST_ERROR = -13.0  # the logarithm of the last error counts as at least this in the next step


def variable(callbacks, state, settings, tally, span, look):
    """Take steps, and return their number, the next row to write, and how it ended."""
    n = N if N > 0 else state.shape[1]
    f, p = RHS(callbacks), span.p
    kept = rows(state, ROWS)
    y = kept
    if N > 0:
        y = stack_rows(N, ROWS)
        copy_rows(y, kept, N)
    u, v, u_end, v_end = y[U], y[V], y[U_END], y[V_END]
    has_rows = len(span.t_rows) > 0
    if LOOKS > 0:
        place, watch, follow = address_of(look), look.watch, look.follow
        u_there, v_there, coefficients = watch.work[0], watch.work[1], watch.work[2:]
        has_events, has_times, follows = len(watch.events) > 0, len(watch.times) > 0, len(follow.table) > 0
    share = least_size(span.rtol)
    t, h, was_rejected = tally[TIME], tally[STEP], False
    taken, row, ended = 0, span.row, GOING
    if span.first == 0:
        RESTART(y, n)
        if span.is_relative == 1:
            set_sizes(tally, y, n, span.atol)
    if h == 0:
        h = FIRST_STEP(f, t, n, y, tally, span)
        tally[STEP_BEFORE] = h
    while taken < span.count:
        remaining = span.t_end - t
        if remaining <= 0:
            ended = AT_END
            break
        if has_rows and row + 2 > len(span.t_rows):
            ended = FULL
            break
        if LOOKS == SEARCHES and int(tally[LOGGED]) + len(watch.events) > len(watch.log):
            ended = FULL
            break
        is_last = h >= remaining
        if is_last and span.may_shorten == 0:
            ended = BEFORE_END
            break
        step = remaining if is_last else h
        if not (is_last or (step > 0 and step >= _RESOLUTION * abs(t + step))):  # also for NaN
            ended = TOO_SMALL
            break
        TRIAL(f, t, step, tally[STEP_BEFORE], p, n, y)
        tally[EVALUATIONS] += COST
        u_least, v_least, v_blur = share * tally[U_SIZE], share * tally[V_SIZE], 0.0
        if span.is_relative == 1 and (u_least == 0 or v_least == 0):
            u_least, v_least, v_blur = sizes_at_rest(tally, t + step, n, y, span)
        square = SQUARE(step, tally[STEP_BEFORE], n, y, span.rtol, span.atol, u_least, v_least)
        if not square <= 1.0:
            tally[REJECTED] += 1
            h = step * shrinkage(square, ORDER)
            was_rejected = True
            continue
        taken += 1
        t_end, error = span.t_end if is_last else t + step, exponent(square)
        grown = growth(error, tally[ERROR], ORDER)
        h = min(step * (min(grown, 1.0) if was_rejected else grown), span.h_max)
        if square == 0 and span.reads_time == 1 and is_silent(n, y):
            h = min(h, max(step, _SILENCE * (t_end - span.t0)))
            if step > tally[SILENT_STEP]:
                tally[SILENT_STEP], tally[SILENT_END] = step, t_end
        was_rejected = False
        outcome, s, t_stop, is_known = PASSED, 1.0, t_end, False
        if LOOKS == SEARCHES and has_events and not IS_QUIET(watch, tally, t_end, u_end, v_end, p):
            DENSE(f, t, step, p, n, y, coefficients)
            is_known = True
            outcome, s, t_stop = SEARCH(
                place, tally, span.t0, t, step, t_end, n, coefficients, u_end, v_end, u_there, v_there, p
            )
            if outcome in (NOT_A_NUMBER, RESTING):
                taken, ended = taken - 1, outcome
                break
        tally[ERROR], tally[STEP_BEFORE] = max(error, _LEAST_ERROR), step
        if LOOKS > 0:
            if LOOKS == SEARCHES and has_times:
                while int(tally[NEXT]) < len(watch.times) and watch.times[int(tally[NEXT])] <= t_stop:
                    if not is_known:
                        DENSE(f, t, step, p, n, y, coefficients)
                        is_known = True
                    WRITE_TIME(place, tally, t, step, t_end, n, coefficients, u_end, v_end, p)
            if follows and not is_known:
                DENSE(f, t, step, p, n, y, coefficients)
                is_known = True
            if is_known:
                tally[EVALUATIONS] += DENSE_COST
            if outcome != PASSED and s < 1.0:
                evaluate(coefficients, s, n, u_end, v_end)
            if follows:
                part = int(tally[PART]) % PARTS
                EVALUATE(follow, t_stop, u_end, v_end, p)
                if t_stop > t:
                    FOLLOW_WITHIN(place, t_stop, s * step, s, n, p)
        if LOOKS == SEARCHES and outcome != PASSED:
            if has_rows and span.every == 1 and s > 0:  # the state at the start is a row already
                write_row(span, row, t_stop, s * step, n, u_end, v_end)
                save(follow, row)
                row += 1
            for j in range(n):
                u[j], v[j] = u_there[j], v_there[j]
            f(t_stop, u, v, p, y[A])
            RESTART(y, n)
            tally[EVALUATIONS] += 1
            tally[STEP_BEFORE], tally[ERROR] = s * step, 0.0
            if outcome == RESET:
                h = min(h, LATER * tally[GAP])
            if follows and outcome <= ZENO:
                EVALUATE(follow, t_stop, u, v, p)
                WIDEN(follow, part, t_stop, v)
                FOLLOW_END(follow, look.within)
        else:
            if LOOKS > 0 and follows:
                WIDEN(follow, part, t_end, v_end)
            ADVANCE(y, n)
        if outcome != TERMINAL and has_rows and (span.first + taken) % span.every == 0:
            write_row(span, row, t_stop, s * step, n, u, v)
            if LOOKS > 0:
                save(follow, row)
            row += 1
        if LOOKS > 0:
            end_part(follow, tally, span.first + taken, n, v)
        t = t_stop
        if span.is_relative == 1:
            u_size, v_size = tally[U_SIZE], tally[V_SIZE]
            for j in range(n):
                if span.atol[0, j] < math.inf:
                    y[U_MOST][j], y[V_MOST][j] = max(y[U_MOST][j], abs(u[j])), max(y[V_MOST][j], abs(v[j]))
                    u_size, v_size = max(u_size, y[U_MOST][j]), max(v_size, y[V_MOST][j])
            if v_size > v_blur:
                tally[U_SIZE], tally[V_SIZE] = u_size, v_size
        if outcome > RESET:
            ended = outcome
            break
    tally[TIME], tally[STEP] = t, h
    if N > 0:
        copy_rows(kept, y, N)
    return taken, row, ended


@element
def least_size(rtol):
    """Return the least size of a degree of freedom, as a part of the largest size of all."""
    return min(1.0, max(_LEAST_SIZE, _ROUND_OFF / rtol))


@element
def write_row(span, row, t, h, n, u, v):
    span.t_rows[row], span.h_rows[row] = t, h
    for j in range(n):
        span.u_rows[row, j], span.v_rows[row, j] = u[j], v[j]


@element
def set_sizes(tally, y, n, atol):
    """Write the sizes of u and v at the start. Velocities that are all zero get the size sqrt(u a) of vibrations."""
    a_size = 0.0
    for j in range(n):
        if atol[0, j] < math.inf:
            y[U_MOST][j], y[V_MOST][j] = abs(y[U][j]), abs(y[V][j])
            tally[U_SIZE], tally[V_SIZE] = max(tally[U_SIZE], abs(y[U][j])), max(tally[V_SIZE], abs(y[V][j]))
            a_size = max(a_size, abs(y[A][j]))
    if tally[V_SIZE] == 0:
        tally[V_SIZE] = math.sqrt(tally[U_SIZE] * a_size)
        for j in range(n):
            if atol[0, j] < math.inf:
                y[V_MOST][j] = math.sqrt(abs(y[U][j]) * abs(y[A][j]))


@element
def sizes_at_rest(tally, t, n, y, span):
    """Return the least sizes of u and v in a step to t before which nothing has moved, and the least one to keep of v.

    They are those after a short time. Because t is rounded, so is the time since the motion began, and the force with
    it: the short time is at least so long that these errors are within rtol, and v has no size of its own before.
    """
    u_size, v_size, a_size = tally[U_SIZE], tally[V_SIZE], 0.0
    for j in range(n):
        if span.atol[0, j] < math.inf:
            a_size = max(a_size, abs(y[A][j]), abs(y[A_END][j]))
    length = span.t_end - span.t0
    if length < 1.0:
        tally[BY_SPAN] = 1.0
    blur = _BLUR * _RESOLUTION * abs(t) / span.rtol
    least, v_blur = max(_FIRST * min(length, 1.0), blur), 0.0
    if v_size == 0:
        v_size, v_blur = least * a_size, blur * a_size
    return u_size if u_size > 0 else least * v_size, v_size, v_blur


@element
def is_silent(n, y):
    """Return whether no force acts at either end of a step."""
    a_size = 0.0
    for j in range(n):
        a_size = max(a_size, abs(y[A][j]), abs(y[A_END][j]))
    return a_size == 0


def first_step(f, t, n, y, tally, span):
    """Return a first step: E. Hairer, S. P. Norsett and G. Wanner, Solving Ordinary Differential Equations I, II.4.

    The unit of time does not matter, except for a motion that starts at rest at zero, in a span of more than a unit:
    the first step must not depend on the end of the span, from which a run may go on. Where it does, the run says so.
    """
    u, v, a, u_end, v_end, a_end = y[:6]
    length = span.t_end - t
    least = _FIRST * min(length, 1.0)
    u_size, v_size = tally[U_SIZE], tally[V_SIZE]
    if span.is_relative == 1 and (u_size == 0 or v_size == 0):
        u_size, v_size, _ = sizes_at_rest(tally, t, n, y, span)
    size, slope = 0.0, 0.0
    for j in range(n):
        u_scale = span.atol[0, j] + span.rtol * max(abs(u[j]), u_size) + TINY
        v_scale = span.atol[1, j] + span.rtol * max(abs(v[j]), v_size) + TINY
        size += (u[j] / u_scale) ** 2 + (v[j] / v_scale) ** 2
        slope += (v[j] / u_scale) ** 2 + (a[j] / v_scale) ** 2
    size, slope = math.sqrt(size / (2 * n)), math.sqrt(slope / (2 * n))
    is_short = size < 1e-5 or slope * length < 1e-5
    h = least if is_short else 0.01 * size / slope
    if h >= length or (is_short and (length < 1.0 or size >= 1e-5)):
        tally[BY_SPAN] = 1.0
    h = min(h, length)
    for j in range(n):
        u_end[j], v_end[j] = u[j] + h * v[j], v[j] + h * a[j]
    f(t + h, u_end, v_end, span.p, a_end)
    tally[EVALUATIONS] += 1
    bend = 0.0
    for j in range(n):
        u_scale = span.atol[0, j] + span.rtol * max(abs(u[j]), u_size) + TINY
        v_scale = span.atol[1, j] + span.rtol * max(abs(v[j]), v_size) + TINY
        bend += ((v_end[j] - v[j]) / u_scale) ** 2 + ((a_end[j] - a[j]) / v_scale) ** 2
    change = h * max(slope, math.sqrt(bend / (2 * n)))
    better = h * (0.01 / change) ** (1 / ORDER) if change > 1e-15 else max(least, h * 1e-3)
    h = min(100 * h, better if better > 0 else h, span.h_max)
    if h >= length:
        tally[BY_SPAN] = 1.0
    return min(h, length)


def kernel(module: str, form: Form, n: int, *, looks: int) -> Any:
    """Compile the kernel of a method for a right-hand side given as an address, or load it from the disk.

    One and two degrees of freedom have kernels of their own. The kernel is called as ``kernel((rhs,), state, settings,
    tally, span, look)``, where `settings` is not used. It returns the number of steps that it took, the next row to
    write, and how it ended.

    Parameters
    ----------
    module : str
        The name of a file of `eig3.kernels.methods` with the formulas `variable`, which is described in
        `eig3.kernels.loops.pair`.
    form : Form
    n : int
        Number of degrees of freedom.
    looks : int
        0 if the argument `look` is None, or one of `FOLLOWS` and `SEARCHES`, which say for what the kernel uses it.
    """
    return _kernel(module, form, n if n <= 2 else 0, looks)


@functools.cache
def _kernel(module: str, form: Form, n: int, looks: int) -> Any:
    rhs_at = form.at("rhs")
    names = {"RHS": element(lambda callbacks: rhs_at(callbacks[0])), "N": n}
    return _compile(module, form, Tuple((int64,)), names, looks, f"{module}_{form.name}_{n}_look{looks}")


def inline_kernel(module: str, form: Form, n: int, rhs: Any, *, looks: int, quantities: tuple = ()) -> Any:
    """Compile the kernel of a method with one right-hand side inlined. It is called as ``kernel((), state, ...)``.

    The quantities are inlined at the ends of steps; see `eig3.kernels.loops.fixed.inline_kernel`.
    """
    of_rows = form.with_rows("rhs", rhs)
    names = {"RHS": element(lambda callbacks: of_rows), "N": n if n <= STACKED_DEGREES else 0}
    if quantities:
        names["EVALUATE"], names["WIDEN"] = inline_functions(form, quantities)
    return _compile(module, form, Tuple(()), names, looks, "")


def _compile(module: str, form: Form, callbacks: Any, names: dict[str, Any], looks: int, label: str) -> Any:
    formulas = importlib.import_module(f"{METHODS}.{module}").variable
    theirs = formulas.functions()
    names = {
        "LOOKS": looks,
        "ROWS": formulas.rows,
        "ORDER": formulas.order,
        "COST": formulas.evaluations,
        "DENSE_COST": formulas.dense_evaluations,
        "TRIAL": theirs["trial"],
        "SQUARE": theirs["square"],
        "DENSE": theirs["dense"],
        "ADVANCE": theirs.get("advance", advance),
        "RESTART": theirs.get("restart", nothing_past),
        "IS_QUIET": quiet(form),
        "EVALUATE": following(form).evaluate,
        "WIDEN": widen_all,
        **names,
    }
    if looks == SEARCHES:
        names["SEARCH"], names["WRITE_TIME"] = searching(form)
    if looks:
        names["FOLLOW_WITHIN"], names["FOLLOW_END"] = within_functions(form)
    names["FIRST_STEP"] = outlined(bound(first_step, names))
    records = SPAN, LOOK_WITHIN if looks else none
    signature = UniTuple(int64, 3)(callbacks, matrix_type, vector_type, vector_type, *records)
    return compile_kernel(variable, names, signature, label)


@element
def advance(y, n):
    for j in range(n):
        y[U][j], y[V][j], y[A][j] = y[U_END][j], y[V_END][j], y[A_END][j]


@element
def nothing_past(y, n):
    pass
