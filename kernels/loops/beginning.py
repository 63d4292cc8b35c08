# ruff: noqa: F821
"""The sizes of a motion, which scale its tolerances, and the first step of a run with tolerances.

These functions are called once in a run, or while nothing has moved. They do not depend on the method: all kernels of
one form of right-hand side share them.
"""

from __future__ import annotations

import functools
import math
from typing import Any

from numba.types import UniTuple, float64, int64, none

from ..compile.jit import called_by_symbol, element
from ..protocol import (
    BY_SPAN,
    EVALUATIONS,
    STEP,
    STEP_BEFORE,
    TIME,
    U_SIZE,
    V_SIZE,
    Form,
    matrix_type,
    rows,
    span_at,
    vector_type,
)
from .pair import A_END, U_MOST, V_MOST, A, U, V
from .zeros import EPSILON

TINY = 1e-300  # keeps a tolerance of zero from giving 0/0
RESOLUTION = 8 * EPSILON  # least step, relative to the time

_ROWS = V_MOST + 1  # those that all methods have
_FIRST = 1e-6  # the part of the span, or of a unit of time, that counts as short where nothing moves yet
_BLUR = 4.0  # times the resolution of t: at what time a motion begins is not known better
_LEAST_SIZE = 1e-3  # of a degree of freedom, relative to the largest size of all
_ROUND_OFF = 1e5 * EPSILON  # least tolerance, relative to the largest size: forces are differences of large values


def begin(address, place, counters, order, state):
    """Write the sizes at the start of a run, and choose its first step if there is none.

    The right-hand side is at the address `address`, and the span at `place`.
    """
    span, n, y = span_at(place), state.shape[1], rows(state, _ROWS)
    if span.first == 0 and span.is_relative == 1:
        set_sizes(counters, y, n, span.atol)
    if counters[STEP] == 0:
        h = first_step(RHS(address), counters[TIME], n, y, counters, order, span)
        counters[STEP] = counters[STEP_BEFORE] = h


def sizes_at_rest(place, counters, t, state):
    """Call `at_rest` for the span at the address `place`, and the rows of a state."""
    return at_rest(counters, t, state.shape[1], rows(state, _ROWS), span_at(place))


@element
def least_size(rtol):
    """Return the least size of a degree of freedom, relative to the largest size of all."""
    return min(1.0, max(_LEAST_SIZE, _ROUND_OFF / rtol))


@element
def set_sizes(counters, y, n, atol):
    """Write the sizes of u and v at the start. Velocities that are all zero get the size sqrt(u a) of vibrations.

    What only events change, such as whether a string is broken, sets no size of the others.
    """
    a_size, fastest = 0.0, 0.0
    for j in range(n):
        if atol[0, j] < math.inf:  # not a first-order unknown
            fastest = max(fastest, abs(y[V][j]), abs(y[A][j]))
    for j in range(n):
        y[U_MOST][j], y[V_MOST][j] = abs(y[U][j]), abs(y[V][j])
        moves = fastest == 0 or y[V][j] != 0 or y[A][j] != 0
        if moves and atol[0, j] < math.inf:
            counters[U_SIZE], counters[V_SIZE] = (
                max(counters[U_SIZE], abs(y[U][j])),
                max(counters[V_SIZE], abs(y[V][j])),
            )
            a_size = max(a_size, abs(y[A][j]))
    if counters[V_SIZE] == 0:
        counters[V_SIZE] = math.sqrt(counters[U_SIZE] * a_size)
        for j in range(n):
            if atol[0, j] < math.inf:
                y[V_MOST][j] = math.sqrt(abs(y[U][j]) * abs(y[A][j]))


@element
def at_rest(counters, t, n, y, span):
    """Return what `least_sizes` returns for a step to t."""
    a_size = 0.0
    for j in range(n):
        if span.atol[0, j] < math.inf:
            a_size = max(a_size, abs(y[A][j]), abs(y[A_END][j]))
    length = span.t_end - span.t0
    if length < 1.0:
        counters[BY_SPAN] = 1.0
    return least_sizes(counters[U_SIZE], counters[V_SIZE], a_size, t, length, span.rtol)


@element
def least_sizes(u_size, v_size, a_size, t, length, rtol):
    """Return the least sizes of u and v in a step to t before which nothing has moved, and the least one to keep of v.

    They are those after a short time. Because t is rounded, so is the time since the motion began, and the force with
    it: the short time is at least so long that these errors are within rtol, and v has no separate size before.
    `a_size` is the largest acceleration in the step, and `length` the length of the span.
    """
    blur = _BLUR * RESOLUTION * abs(t) / rtol
    least, v_blur = max(_FIRST * min(length, 1.0), blur), 0.0
    if v_size == 0:
        v_size, v_blur = least * a_size, blur * a_size
    return u_size if u_size > 0 else least * v_size, v_size, v_blur


@element
def first_step(f, t, n, y, counters, order, span):
    """Return a first step: E. Hairer, S. P. Norsett and G. Wanner, Solving Ordinary Differential Equations I, II.4.

    The unit of time does not matter, except for a motion that starts at rest at zero, in a span of more than a unit:
    the first step must not depend on the end of the span, from which a run may be extended. Where it does, the run says
    so.
    """
    u, v, a, u_end, v_end, a_end = y[:6]
    length = span.t_end - t
    least = _FIRST * min(length, 1.0)
    u_size, v_size = counters[U_SIZE], counters[V_SIZE]
    if span.is_relative == 1 and (u_size == 0 or v_size == 0):
        u_size, v_size, _ = at_rest(counters, t, n, y, span)
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
        counters[BY_SPAN] = 1.0
    h = min(h, length)
    for j in range(n):
        u_end[j], v_end[j] = u[j] + h * v[j], v[j] + h * a[j]
    f(t + h, u_end, v_end, span.p, a_end)
    counters[EVALUATIONS] += 1
    bend = 0.0
    for j in range(n):
        u_scale = span.atol[0, j] + span.rtol * max(abs(u[j]), u_size) + TINY
        v_scale = span.atol[1, j] + span.rtol * max(abs(v[j]), v_size) + TINY
        bend += ((v_end[j] - v[j]) / u_scale) ** 2 + ((a_end[j] - a[j]) / v_scale) ** 2
    change = h * max(slope, math.sqrt(bend / (2 * n)))
    better = h * (0.01 / change) ** (1 / order) if change > 1e-15 else max(least, h * 1e-3)
    h = min(100 * h, better if better > 0 else h, span.h_max)
    if h >= length:
        counters[BY_SPAN] = 1.0
    return min(h, length)


@functools.cache  # so that kernels share the compiled functions
def beginning(form: Form) -> tuple[Any, Any]:
    """Return the elements `begin` and `sizes_at_rest` for one form of right-hand side."""
    of_begin = none(int64, int64, vector_type, int64, matrix_type)
    of_sizes = UniTuple(float64, 3)(int64, vector_type, float64, matrix_type)
    return (
        called_by_symbol(begin, {"RHS": form.at("rhs")}, of_begin, form.name),
        called_by_symbol(sizes_at_rest, {}, of_sizes, form.name),
    )
