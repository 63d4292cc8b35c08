# ruff: noqa: F821
"""Kernels that look for a start at which an event of an effect has been missed, or constraints do not hold."""

from __future__ import annotations

import functools
import math
from typing import Any

from numba.types import Array, UniTuple, float64, int64

from ..compile.jit import bound, compile_kernel, element
from ..protocol import VECTOR, vector_type
from .zeros import event_of

_OFF = 1e-3  # least distance from the constraints, relative to u or v; an interpolated state is nearer
_SLIGHTLY_OFF = 1e-9  # the same, of an error that is more than round-off
_G, _APPLY, _DIRECTION, _TURNS, _IS_REFUSED = range(5)  # the columns of `rules`


def first_refused(rules, t0, soon, n, count, sets, params, u, v, scratch):
    """Return the first of `count` starts that is refused, and the first rule that it breaks; -1 if there is none.

    A row of `rules` has the addresses of the functions of an event, its direction, whether it is the turn of a link
    that yields, and whether a start that breaks the rule is refused: otherwise, the link turns there. `soon` is a short
    time, and n the number of velocities without first-order unknowns. u and v have the values of all starts, and
    `params` a set for each start, or one for all. `scratch` has room for the u of one start.
    """
    size, width = len(scratch), len(params) // sets
    for i in range(count):
        begin, own = i * size, min(i, sets - 1) * width
        p, u_start, v_start = params[own : own + width], u[begin : begin + size], v[begin : begin + size]
        for k in range(len(rules)):
            if IS_MISSED(rules[k], t0, soon, n, p, u_start, v_start, scratch):
                if rules[k, _IS_REFUSED]:
                    return i, k
                APPLY_AT(rules[k, _APPLY])(t0, u_start, v_start, p)
    return -1, -1


def is_missed(rule, t0, soon, n, p, u, v, other):
    """Return whether a start breaks a rule: it lies at the event or behind it.

    A run may begin where another one has bounced: the motion then leaves the event at once. At the turn of a link that
    yields, only a start beyond yield with a velocity back breaks the rule.
    """
    g, direction = rule[_G], rule[_DIRECTION]
    if not direction * EVENT(g, t0, u, v, p) >= 0:
        return False
    for j in range(len(u)):
        other[j] = u[j] + soon * v[j]
    if direction * EVENT(g, t0 + soon, other, v, p) < 0:
        return False
    for j in range(len(v)):  # within yield, the sign does not depend on the velocity
        other[j] = -v[j] if j < n else v[j]
    return not rule[_TURNS] or direction * EVENT(g, t0, u, other, p) < 0


@functools.cache
def starts_kernel() -> Any:
    """Compile the kernel of the vector form, or load it from the disk: see `first_refused`."""
    names = {"IS_MISSED": element(bound(is_missed, {"EVENT": event_of(VECTOR)})), "APPLY_AT": VECTOR.at("apply")}
    signature = UniTuple(int64, 2)(Array(int64, 2, "C"), float64, float64, *[int64] * 3, *[vector_type] * 4)
    return compile_kernel(first_refused, names, signature, "starts")


def first_off(project, t0, count, sets, params, u, v, x, w):
    """Return the first of `count` starts whose u does not keep the constraints, or -1, and the number of such v.

    A u or v that is off, also slightly, becomes the nearest one that keeps them. `project` is the address of the
    projection, which writes to `params`; u, v and `params` are as in `first_refused`, and x and w have room for one
    start.
    """
    size, width, changed = len(x), len(params) // sets, 0
    for i in range(count):
        own = min(i, sets - 1) * width
        u_start, v_start = u[i * size : (i + 1) * size], v[i * size : (i + 1) * size]
        for j in range(size):
            x[j], w[j] = u_start[j], v_start[j]
        INVARIANT_AT(project)(t0, x, w, params[own : own + width])
        if IS_FAR(x, u_start, OFF):
            return i, changed
        changed += IS_FAR(w, v_start, OFF)
        if IS_FAR(x, u_start, SLIGHTLY_OFF) or IS_FAR(w, v_start, SLIGHTLY_OFF):
            for j in range(size):
                u_start[j], v_start[j] = x[j], w[j]
    return -1, changed


def is_far(x, u, least):
    """Return whether a projection x is far from u, by a distance relative to u, or NaN."""
    way, size = 0.0, 0.0
    for j in range(len(u)):
        way = max(way, abs(x[j] - u[j])) if x[j] == x[j] else math.inf
        size = max(size, abs(u[j]))
    return way > least * size


@functools.cache
def held_kernel() -> Any:
    """Compile the kernel of constraints, or load it from the disk: see `first_off`."""
    names = {"IS_FAR": element(is_far), "INVARIANT_AT": VECTOR.at("invariant")}
    names |= {"OFF": _OFF, "SLIGHTLY_OFF": _SLIGHTLY_OFF}
    signature = UniTuple(int64, 2)(int64, float64, int64, int64, *[vector_type] * 5)
    return compile_kernel(first_off, names, signature, "held")
