# ruff: noqa: F821
"""The kernel of a fixed-step method, made from the formulas in the method's file.

`fixed` is a template: the names in capitals stand for values that depend on the method and on the mode, and `jit.bound`
inserts them. A kernel that looks for events, and for times at which the state is wanted, is `searching`. Steps in which
nothing is found run in the loop of `march.py`; the step after which it stops is searched, see `search.py`. One that
follows quantities is `following`. One that looks for nothing is a single march: they have no code for events.

A state has rows of n values also for one degree of freedom, where they are registers.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from numba.extending import intrinsic
from numba.types import Tuple, UniTuple, int64, none

from ..compile.jit import bound, compile_kernel, element
from ..compile.numba_internals import has_wide_vectors, wide_vectors
from ..lanes import evaluate_lanes, nothing_to_widen
from ..protocol import (
    ANEW,
    FAILED,
    FULL,
    GOING,
    LOGGED,
    LOOK,
    PASSED,
    RESET,
    SCALAR,
    SEARCHES,
    SEARCHES_LANES,
    STEPS,
    VECTOR,
    WITHIN,
    Form,
    Work,
    copy_rows,
    matrix_type,
    pointer_to,
    rows,
    stack_floats,
    stack_rows,
    vector_type,
)
from .follow import end_part, functions, inline_functions, no_history, no_projection, widen_all
from .formulas import Formulas
from .lane_search import LOOK_IN_LANES, is_full, search_lanes, searching_in_lanes
from .march import FOUND, THROUGH, copy_two, march, settle
from .pair import U_END, V_END, A
from .search import search_names, work_rows
from .zeros import quiet

__all__ = ["STACKED_DEGREES", "inline_kernel", "kernel", "wide_kernel", "work_rows"]

#: Largest number of degrees of freedom for which the inline mode keeps all rows on the stack. With more, rows on the
#: heap are as fast, and the kernel compiles in a third of the time.
STACKED_DEGREES = 6


def fixed(callbacks, state, settings, counters, steps, look):
    """Take steps, and return their number, the next row to write and how it ended.

    If STACKED is 1, the rows are on the stack. If IS_CHECKED is 1, scratch begins as NaN: a method that hands more
    values to the next step than it declares is seen.
    """
    n = int64(N) if N > 0 else state.shape[1]  # not a constant: functions are compiled for each type
    f = RHS(callbacks)
    c = CONSTANTS(settings, steps.h, Work(counters, state[ROWS:], SECOND(callbacks)))
    kept = ROWS_OF(state, OWN_ROWS)
    if IS_CHECKED > 0:
        for row in range(CARRIED, OWN_ROWS):
            for j in range(n):
                state[row, j] = math.nan
    y = kept
    if STACKED > 0:
        y = STACK_ROWS(N, OWN_ROWS)
        copy_rows(y, kept, N)
    scratch = state[OWN_ROWS:]
    if LOOKS == 0:
        end = steps.first + steps.count
        started = int64(counters[ANEW]) + START_STEPS
        y, i, row, ended = MARCH(f, y, c, n, scratch, steps, look, counters, None, steps.first, end, started, steps.row)
        ended = FAILED if ended == FAILED else GOING
    else:
        y, i, row, ended = ADVANCE(callbacks, f, c, y, n, scratch, counters, steps, look)
    if STACKED > 0:
        copy_rows(kept, y, N)
    else:
        settle(y, state, n)
    return i - steps.first, row, ended


def following(callbacks, f, c, y, n, scratch, counters, steps, look):
    """Take the steps, and follow quantities."""
    i, row, last, found = steps.first, steps.row, steps.first + steps.count, THROUGH
    pair = rows(look.watch.before, 2) if LOOKS == SEARCHES_LANES else None
    while i < last and found == THROUGH:
        started = int64(counters[ANEW]) + START_STEPS
        there, i, row, found = MARCH(f, y, c, n, scratch, steps, look, counters, pair, i, last, started, row)
        if STACKED == 0:  # see `march`
            y = there
        end_part(look.follow, counters, i, n, y[1])
    return y, i, row, FAILED if found == FAILED else GOING


def searching(callbacks, f, c, y, n, scratch, counters, steps, look):
    """Take the steps, and search those in which something is found."""
    i, row, last, ended = steps.first, steps.row, steps.first + steps.count, GOING
    watch, follow, pair = look.watch, look.follow, rows(look.watch.work[WORK:], PAIR_ROWS)
    place, of_steps = pointer_to(look), pointer_to(steps)
    while i < last and ended == GOING:
        if 2 * int64(counters[LOGGED]) > len(watch.log):
            ended = FULL
            break
        if counters[WITHIN] == 1:
            i, found = i + 1, FOUND
        else:
            started = int64(counters[ANEW]) + START_STEPS
            there, i, row, found = MARCH(f, y, c, n, scratch, steps, look, counters, pair, i, last, started, row)
            if STACKED == 0:
                y = there
        if found == FAILED:
            ended = FAILED
        elif found == FOUND:
            if counters[WITHIN] == 0:
                copy_two(pair[U_END], pair[V_END], y[0], y[1], n)
            before, t = steps.t0 + (i - 1) * steps.h, steps.t0 + i * steps.h
            outcome = SEARCH(ADDRESS(callbacks), place, counters, steps.t0, before, t, n, steps.p)
            end = pair[U_END], pair[V_END], pair[A]
            row = GO_ON(ADDRESS(callbacks), place, of_steps, counters, outcome, i, row, *end)
            if outcome != PASSED:
                copy_two(y[0], y[1], pair[U_END], pair[V_END], n)
                START_ANEW(y, steps.h, n, pair[A])
            if outcome > RESET:
                ended = outcome
                i -= 1
        end_part(follow, counters, i, n, y[1])
    return y, i, row, ended


def stack_step(f, at, y, c, n):
    """A step that moves values and not rows, so that rows on the stack can be registers."""
    y_next, success = STEP(f, at, y, c, N)
    if success:
        copy_rows(y, y_next, N)
    return y, success


def kernel(method: Formulas, order: int, form: Form, n: int, *, looks: int, second: str = "") -> Any:
    """Compile the kernel of a method for callbacks given as addresses, or load it from the disk.

    The scalar form has a kernel with its rows in registers. Without a look, two degrees of freedom have a kernel of
    their own: the compiler then removes the loops over them, and a pendulum takes up to a quarter less time. One kernel
    serves all other numbers.

    The kernel of a method outside this package is found on the disk by its content: its formulas may use other files.

    The kernel is called as ``kernel((rhs, second or None), state, settings, counters, steps, look)``, and returns the
    number of steps that it took, the next row to write, and how it ended: GOING after all steps, FAILED if a solve
    failed, FULL, or an outcome of an event.

    `order` is the order of the method. `looks` is 0 if the argument `look` is None, or one of `FOLLOWS` and `SEARCHES`,
    which say for what the kernel uses it. `second` is the kind of the second callback, such as "jacobian"; empty for
    none.
    """
    has_own = form is SCALAR or (n == 2 and not looks)
    return _kernel(method, order if looks == SEARCHES else 0, form, n if has_own else 0, looks, second)


@functools.cache
def _kernel(method: Formulas, order: int, form: Form, n: int, looks: int, second: str) -> Any:
    parts = (method.label, form.name, str(n), f"look{looks}", *[second] * bool(second))
    callbacks, shared = pointer_callbacks(form, second)
    seen = functions(form)
    names = {**shared, "N": n, "STACKED": int(form is SCALAR)}
    names |= {"EVALUATE": seen.evaluate, "WIDEN": widen_all, "QUANTITY": seen.first, "MAY_BE_ONLY": 1}
    names["ADVANCE_HISTORY"], names["PROJECT"] = seen.advance, seen.project
    return _compile(method, order, form, callbacks, names, looks, "_".join(parts) if method.is_own else "")


def inline_kernel(
    method: Formulas,
    order: int,
    form: Form,
    n: int,
    rhs: Any,
    jacobian: Any,
    *,
    looks: int,
    quantities: tuple = (),
) -> Any:
    """Compile the kernel of a method with its callbacks inlined. It is called as ``kernel((rhs, None), state, ...)``.

    With few degrees of freedom, it is valid for this number only, and keeps its rows on the stack. At events, and at
    times at which the state is wanted, the quantities are called at their addresses. `quantities` are pairs of a jitted
    function and its number of values, or 0, in the order of `Follow.table`. The other arguments are as for `kernel`.
    """
    callbacks, names = inline_callbacks(form, rhs, jacobian)
    is_stacked = n <= STACKED_DEGREES
    names |= {"N": n if is_stacked else 0, "STACKED": int(is_stacked)}
    names["EVALUATE"], names["WIDEN"] = inline_functions(form, quantities)
    # a right-hand side with a history, or with constraints, is called at its address
    names["ADVANCE_HISTORY"], names["PROJECT"] = no_history, no_projection
    names["MAY_BE_ONLY"] = int([width for _, width in quantities] == [0])
    if names["MAY_BE_ONLY"]:
        only = form.with_rows("invariant", quantities[0][0])
        names["QUANTITY"] = element(lambda follow: only)
    return _compile(method, order, form, callbacks, names, looks, "")


@functools.cache
def wide_kernel(method: Formulas, looks: int, second: str = "", order: int = 0, form: Form = VECTOR) -> Any:
    """Return the kernel of the vector form for a block of trajectories, see `eig3.kernels.lanes`.

    It is `kernel`, with `looks` 0 or `FOLLOWS`, but with the widest vectors that the processor has. The loops are in
    the elements of the method: these are compiled anew. With `SEARCHES_LANES`, it needs the order of the method and the
    form of a single run.
    """
    if looks == 0 and not has_wide_vectors():
        return kernel(method, 0, VECTOR, 0, looks=0, second=second)
    callbacks, shared = pointer_callbacks(VECTOR, second)
    formulas = method.names(VECTOR)
    names = {**shared, **{name: element(formulas[name].py_func) for name in ("STEP", "COMPLETE")}, "N": 0, "STACKED": 0}
    names |= {"EVALUATE": evaluate_lanes, "WIDEN": nothing_to_widen, "MAY_BE_ONLY": 0}
    names |= {"ADVANCE_HISTORY": no_history, "PROJECT": functions(VECTOR).project}
    label = f"{method.label}_wide_{looks}{second}" if method.is_own else ""
    if looks == SEARCHES_LANES:
        label += f"_{form.name}" * method.is_own
        names["IS_FULL"] = is_full
        named = {**searching_in_lanes(method, order, form), "EVALUATE_LANES": evaluate_lanes}
        names["SEARCH_LANES"] = element(bound(search_lanes, named))
    with wide_vectors():
        return _compile(method, 0, VECTOR, callbacks, names, looks, label)


def _compile(
    method: Formulas, order: int, form: Form, callbacks: Any, names: dict[str, Any], looks: int, label: str
) -> Any:
    names["STACK_ROWS"] = stack_floats if form is SCALAR else stack_rows
    names = {**method.names(form), **names, "LOOKS": looks}
    names["PROJECT_STEP"] = no_projection if method.keeps_constraints else names["PROJECT"]
    if names["STACKED"]:
        for name in {"STEP", "START_STEP"} & names.keys():
            names[name] = element(bound(stack_step, {"STEP": names[name], "N": names["N"]}))
    if looks == SEARCHES:
        names |= {**search_names(method, order, form), "IS_QUIET": quiet(form)}
    names["MARCH"] = element(bound(march, names))
    names["ADVANCE"] = element(bound(searching if looks == SEARCHES else following, names))
    records = STEPS, {0: none, SEARCHES_LANES: LOOK_IN_LANES}.get(looks, LOOK)
    signature = UniTuple(int64, 3)(callbacks, matrix_type, vector_type, vector_type, *records)
    return compile_kernel(fixed, names, signature, label)


@functools.cache
def pointer_callbacks(form: Form, second: str = "") -> tuple[Any, Mapping[str, Any]]:
    """Return the type of the argument `callbacks` of a kernel, and the functions that take the callbacks out of it."""
    rhs_at, second_at = form.at("rhs"), form.at(second or "rhs")
    names = {
        "RHS": element(lambda callbacks: rhs_at(callbacks[0])),
        "ADDRESS": element(lambda callbacks: callbacks[0]),
        "SECOND": element(lambda callbacks: second_at(callbacks[1])) if second else no_second,
    }
    return Tuple((int64, int64 if second else none)), MappingProxyType(names)  # which all kernels share


def inline_callbacks(form: Form, rhs: Any, jacobian: Any) -> tuple[Any, dict[str, Any]]:
    """Return the same for a kernel with its callbacks inlined.

    What is called rarely and shared by all kernels, such as the search of a step, calls the right-hand side at its
    address: otherwise it would be compiled anew, which takes longer than all else. The address is an argument: as a
    constant, which differs in each process, the kernel would not be found on the disk.
    """
    rhs, jacobian = form.with_rows("rhs", rhs), jacobian and form.with_rows("jacobian", jacobian)
    names = {
        "RHS": element(lambda callbacks: rhs),
        "ADDRESS": element(lambda callbacks: callbacks[0]),
        "SECOND": element(lambda callbacks: jacobian) if jacobian else no_second,
    }
    return Tuple((int64, none)), names


@intrinsic
def no_second(typingctx, callbacks):
    """``no_second(callbacks)`` returns None. An element would be one more function to compile."""
    return none(callbacks), lambda context, builder, signature, args: context.get_dummy_value()
