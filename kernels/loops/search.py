# ruff: noqa: F821
"""The search of a fixed step for events, and for times at which the state is wanted, with its dense output.

From a reset, steps of a Runge-Kutta pair lead to the end of the step, where the method starts anew. The search needs
nothing from the method's file but its past values at the start: the names in capitals depend on the form of the
right-hand side and on the order of the method.
"""

from __future__ import annotations

import functools
from typing import Any

from numba.types import float64, int64

from ..compile.jit import bound, called, called_by_symbol, element, outlined
from ..protocol import (
    ANEW,
    EVALUATIONS,
    FULL,
    GAP,
    LOGGED,
    NEXT,
    NOT_A_NUMBER,
    PART,
    PARTS,
    PASSED,
    RESET,
    RESTING,
    TIME,
    WITHIN,
    Form,
    look_at,
    row_type,
    rows,
    steps_at,
    vector_type,
)
from .dense import quintic
from .follow import first_due, functions, save, widen_all
from .formulas import Formulas, nothing, variable_formulas
from .march import copy_two, write
from .pair import A_END, U_END, V_END, A, U, V
from .zeros import LATER, search_of_step, writing_of_times


def go_on(address, place, of_steps, counters, outcome, i, row, u, v, a):
    """Continue from the step to step index i, whose search had an outcome. Return the next row to write.

    u and v are the state at the end of the step. If the outcome is not PASSED, a becomes the acceleration there. If the
    run continues, the quantities are evaluated in this state, and it is written if it is due.
    """
    steps, follow = steps_at(of_steps), look_at(place).follow
    p, t = steps.p, steps.t0 + i * steps.h
    if outcome != PASSED:
        t = counters[TIME] if outcome > RESET else t
        PROJECT(follow, t, u, v, p)
        RHS(address)(t, u, v, p, a)
        counters[EVALUATIONS] += 1
        counters[ANEW] = i
    first = 0 if outcome != PASSED else first_due(follow, counters, i)
    if outcome <= RESTING:
        EVALUATE(follow, first, t, u, v, p)
        ADVANCE_HISTORY(follow, t, u, v, p)
    if outcome <= RESET:
        widen_all(follow, first, int64(counters[PART]) % PARTS, t, v)
        if i % steps.every == 0:
            write(u, v, steps.u_rows.shape[1], steps, row)
            save(follow, row)
            row += 1
    return row


def search(address, place, counters, t0, t, t_grid, n, p):
    """Search the step from t to `t_grid`, whose two states are in rows of `watch.work`, and return the outcome.

    After a reset, the state at the end of the step is the state at `t_grid`, or at the event that ends the run. If the
    log is full after some resets, FULL is returned, and the next call continues from the last reset.
    The right-hand side is at the address `address`, the look at `place`, and the run began at t0.
    """
    f, watch = RHS(address), look_at(place).watch
    y = rows(watch.work[WORK:], PAIR_ROWS)
    u, v, a, u_end, v_end = y[U], y[V], y[A], y[U_END], y[V_END]
    (u_there, v_there), coefficients = rows(watch.work, 2), watch.work[2:WORK]
    t_end, reach, result = t_grid, 0.0, PASSED
    if counters[WITHIN] == 0:
        f(t, u, v, p, a)
        STEP_DENSE(f, t, t_grid - t, p, n, y, u_there, v_there, coefficients)
        counters[EVALUATIONS] += 1 + STEP_DENSE_COST
    else:
        t, reach, result = counters[TIME], LATER * counters[GAP], RESET
        t_end = min(t_grid, t + reach)
        TRIAL(f, t, t_end - t, t_end - t, p, n, y)
        DENSE(f, t, t_end - t, p, n, y, coefficients)
        counters[WITHIN] = 0
    while True:
        h = t_end - t
        if int64(counters[LOGGED]) + len(watch.events) > len(watch.log):
            copy_two(u_end, v_end, u, v, n)
            counters[TIME], counters[WITHIN] = t, 1
            return FULL
        outcome, _, stop = LOOK_WITHIN(
            place, counters, t0, t, h, t_end, n, coefficients, u_end, v_end, u_there, v_there, p
        )
        if outcome in (NOT_A_NUMBER, RESTING):
            copy_two(u_end, v_end, u, v, n)
            counters[TIME] = t
            return outcome
        while int64(counters[NEXT]) < len(watch.times) and watch.times[int64(counters[NEXT])] <= stop:
            WRITE_TIME(place, counters, t, h, t_end, n, coefficients, u_end, v_end, p)
        if outcome > RESET or (outcome == RESET and stop >= t_grid):
            copy_two(u_end, v_end, u_there, v_there, n)
            counters[TIME] = stop
            return outcome
        if outcome == RESET:
            copy_two(u, v, u_there, v_there, n)
            result, reach = RESET, counters[GAP]
        elif t_end == t_grid:
            return result
        else:
            copy_two(u, v, u_end, v_end, n)
        f(stop, u, v, p, a)
        t, reach = stop, LATER * reach
        t_end = min(t_grid, t + reach)
        TRIAL(f, t, t_end - t, t_end - t, p, n, y)
        DENSE(f, t, t_end - t, p, n, y, coefficients)
        counters[EVALUATIONS] += PAIR_COST


def quintic_of_step(f, t, h, p, n, y, u_there, v_there, coefficients):
    """Write the dense output of a step whose states are known."""
    f(t + h, y[U_END], y[V_END], p, y[A_END])
    quintic(h, n, y[U], y[V], y[A], y[U_END], y[V_END], y[A_END], coefficients)


def extension_of_step(f, t, h, p, n, y, u_there, v_there, coefficients):
    """Write the dense output of a step of the pair from the same state. The state at the end of the step is kept."""
    copy_two(u_there, v_there, y[U_END], y[V_END], n)
    TRIAL(f, t, h, h, p, n, y)
    DENSE(f, t, h, p, n, y, coefficients)
    copy_two(y[U_END], y[V_END], u_there, v_there, n)


def start_anew(y, h, n, a):
    """Write the past values of a method that starts at the state in its rows."""
    for j in range(n):
        past = START(y[0][j], y[1][j], a[j], h)
        for k in range(PAST):
            y[2 + k][j] = past[k]


def work_rows(method: Formulas, order: int) -> int:
    """Return the number of rows of `Watch.work` for a method of this order."""
    pair = variable_formulas(_pair_for(method, order))
    return pair.work_rows + pair.rows


def _pair_for(method: Formulas, order: int) -> str:
    """Return the name of the pair whose steps lead from a reset to the end of a step: the method's own, if any."""
    if method.is_own and hasattr(method.defined, "variable"):
        return method.module.__name__.rpartition(".")[2]
    return "rk5" if order <= 5 else "rk8"


def search_names(method: Formulas, order: int, form: Form) -> dict[str, Any]:
    """Return the values of the names in capitals in the template of a kernel that searches its steps."""
    start = {"START": element(method.start), "PAST": method.past}
    name = _pair_for(method, order)
    pair = variable_formulas(name)
    return {
        "SEARCH": _search(name, form),
        "GO_ON": _go_on(form),
        "WORK": pair.work_rows,
        "PAIR_ROWS": pair.rows,
        "START_ANEW": element(bound(start_anew, start)) if method.past else nothing,
    }


@functools.cache
def _search(pair: str, form: Form) -> Any:
    """Return the search for a right-hand side at an address. The kernels of all methods of one pair share it."""
    arguments = int64, int64, vector_type, float64, float64, float64, int64, vector_type
    names = {**_names(variable_formulas(pair), form), "RHS": form.at("rhs")}
    return called_by_symbol(search, names, int64(*arguments), f"{pair}_{form.name}")


@functools.cache
def _go_on(form: Form) -> Any:
    seen = functions(form)
    names = {"RHS": form.at("rhs"), "EVALUATE": seen.evaluate, "ADVANCE_HISTORY": seen.advance, "PROJECT": seen.project}
    arguments = int64, int64, int64, vector_type, int64, int64, int64, row_type, row_type, row_type
    return called_by_symbol(go_on, names, int64(*arguments), form.name)


def _names(pair: Any, form: Form) -> dict[str, Any]:
    theirs = pair.functions()
    has_extension = pair.dense_evaluations > 0
    names = {
        "WORK": pair.work_rows,
        "PAIR_ROWS": pair.rows,
        "PAIR_COST": 1 + pair.evaluations + pair.dense_evaluations,
        "STEP_DENSE_COST": pair.evaluations + pair.dense_evaluations if has_extension else 1,
        "TRIAL": called(theirs["trial"]),
        "DENSE": theirs["dense_called"],
        "LOOK_WITHIN": search_of_step(form),
        "WRITE_TIME": writing_of_times(form),
    }
    names["STEP_DENSE"] = outlined(bound(extension_of_step if has_extension else quintic_of_step, names))
    return names
