# ruff: noqa: F821
"""Right-hand sides, invariants and outputs of many trajectories at once, in the lanes of SIMD registers.

A block is a system of n times `lanes` degrees of freedom: value j of the trajectory in a lane is at index
j * lanes + lane. So the kernel of a method computes a block as it computes any system. Only the right-hand side is
another one: the functions below call the user's function for each lane, with views of the values of this lane.

LLVM vectorises the loop over lanes if the user's function has become straight code in it. Two things are needed for
this. The length and the stride of the views are constants. And the user's function is inlined before LLVM has seen it:
otherwise its loops are already prepared for any n.
"""

from __future__ import annotations

import dis
import inspect
import math
import re
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numba
from numba.extending import intrinsic
from numba.types import float64, int64, none

from .compile.cache import keep_on_disk
from .compile.jit import KERNEL_OPTIONS, bound, compiled, element, function_at
from .compile.numba_internals import (
    Jitted,
    address_of,
    array_over,
    assume_no_overlap,
    cache_of,
    call_without_checks,
    has_wide_vectors,
    is_linked,
    optimised_code,
    parts_of,
    wide_vectors,
)
from .compile.source import is_beside
from .protocol import (
    ADDRESS,
    COLUMN,
    HIGH,
    LOW,
    OUT,
    SCALAR,
    T_HIGH,
    T_LOW,
    VECTOR,
    WIDTH,
    Form,
    part_of_row,
    vector_type,
)

#: Functions of the C library that have no vector instruction.
_NAMES = (
    r"(acosh?|asinh?|atan[2h]?|cbrt|cosh?|erfc?|exp(?:2|10|m1)?|fmod|hypot|ldexp|l?gamma|log(?:2|10|1p)?|powi?"
    r"|remainder|sinh?|tanh?|tgamma)"
)
_OF_LIBM = re.compile(rf"call [^\n]*@(?:llvm\.)?{_NAMES}[.(]")
# A call for one value in vectorised code is outside the loop over lanes. LLVM widens the calls in this loop, and calls
# the C library as often as there are lanes.
_OF_LIBM_IN_LANES = re.compile(rf"@llvm\.{_NAMES}\.v\d+f64")

_GUARD_VALUES, _GUARD_ROWS = 64, 4  # of NaN after the parameters: shared ones, and those in lanes

#: The signature of a quantity that is compiled for a block, and the function that takes it from its address.
_QUANTITY = none(float64, *[vector_type] * 8)
quantity_at = function_at(_QUANTITY)

#: Rows of parameters that follow the parameters of rhs if each trajectory has its own step: h and t0.
OWN_STEP_ROWS = 2


def scalar(t, u, v, p, a):
    for lane in range(a.size):
        a[lane] = FUNCTION(TIME(t, p, lane), u[lane], v[lane], PARAMS(p, lane))


def vector(t, u, v, p, a):
    for lane in range(a.size // N):
        FUNCTION(TIME(t, p, lane), GIVEN(u, lane), GIVEN(v, lane), PARAMS(p, lane), WRITTEN(a, lane))


# With its own step h, each trajectory is integrated in the time (t - t0) / h with the step 1. Its velocity is then h v,
# and its acceleration h^2 a.


def scalar_own_step(t, u, v, p, a):
    h, t0 = STEPS(p, 0), BEGINS(p, 0)
    for lane in range(a.size):
        a[lane] = h[lane] * h[lane] * FUNCTION(t0[lane] + t * h[lane], u[lane], v[lane] / h[lane], PARAMS(p, lane))


def vector_own_step(t, u, v, p, a):
    h, t0, velocities, lanes = STEPS(p, 0), BEGINS(p, 0), VELOCITIES(p, 0), a.size // N
    rescale(v, h, velocities)
    for lane in range(lanes):
        time = t0[lane] + t * h[lane]
        FUNCTION(time, GIVEN(u, lane), GIVEN(velocities, lane), PARAMS(p, lane), WRITTEN(a, lane))
    for j in range(N):
        for lane in range(lanes):
            a[j * lanes + lane] *= h[lane] * h[lane]


def returned(t, u, v, p, out, low, high, t_low, t_high):
    """Evaluate a function that returns its only value, and widen its extremes, or count its changes of sign."""
    velocities = v
    if HAS_OWN_STEP > 0:
        velocities = VELOCITIES(p, 0)
        rescale(v, STEPS(p, 0), velocities)
    for lane in range(LANES):
        out[lane] = FUNCTION(TIME(t, p, lane), STATE(u, lane), STATE(velocities, lane), PARAMS(p, lane))
    WIDEN(out, t, low, high, t_low, t_high)


def written(t, u, v, p, out, low, high, t_low, t_high):
    """As `returned`, for a function that writes its values."""
    velocities = v
    if HAS_OWN_STEP > 0:
        velocities = VELOCITIES(p, 0)
        rescale(v, STEPS(p, 0), velocities)
    for j in range(out.size):
        out[j] = math.nan  # a value that the function does not write stays NaN
    for lane in range(LANES):
        FUNCTION(TIME(t, p, lane), STATE(u, lane), STATE(velocities, lane), PARAMS(p, lane), VALUES(out, lane))
    WIDEN(out, t, low, high, t_low, t_high)


def time_of_own_step(t, p, lane):
    return BEGINS(p, 0)[lane] + t * STEPS(p, 0)[lane]


def both(p, lane):
    return SHARED(p, lane), OWN(p, lane)


@element
def time_of_shared_step(t, p, lane):
    return t


@element
def time_of_lane(t, p, lane):
    return t[lane]


@element
def rescale(v, h, velocities):
    """Write v / h. LLVM does not vectorise a loop that also writes to the array in which it reads p."""
    for first in range(0, v.size, h.size):
        for lane in range(h.size):
            velocities[first + lane] = v[first + lane] / h[lane]


@element
def widen(values, t, low, high, t_low, t_high):
    """Widen extremes, and note the times at which they occur. In most steps, there is nothing to note for one of them.

    Every comparison with NaN is false. So a NaN, once it is stored, stays, with its time.
    """
    is_low, is_high = False, False
    for j in range(values.size):
        is_low |= not values[j] >= low[j]
        is_high |= not values[j] <= high[j]
    if is_low:
        for j in range(values.size):
            e, least, at = values[j], low[j], t_low[j]  # loads under a condition would be slow
            is_new = (e < least) | ((e != e) & (least == least))
            low[j], t_low[j] = e if is_new else least, t if is_new else at
    if is_high:
        for j in range(values.size):
            e, most, at = values[j], high[j], t_high[j]
            is_new = (e > most) | ((e != e) & (most == most))
            high[j], t_high[j] = e if is_new else most, t if is_new else at


@element
def count_changes(values, t, low, high, t_low, t_high):
    """Count in `high[0]` how many values have not the sign of `low`: all signs differ from NaN, and none from 0."""
    changed = 0
    for j in range(values.size):
        changed += not values[j] * low[j] >= 0
    high[0] = changed


@element
def evaluate_lanes(follow, first, t, u, v, p):
    """Evaluate the quantities from `first` on in the lanes of a block, and widen their extremes."""
    for k in range(first, len(follow.table)):
        place, column, width = follow.table[k, OUT], follow.table[k, COLUMN], follow.table[k, WIDTH]
        quantity_at(follow.table[k, ADDRESS])(
            t,
            u,
            v,
            p,
            follow.out[place : place + width],
            part_of_row(follow.extremes, LOW, column, width),
            part_of_row(follow.extremes, HIGH, column, width),
            part_of_row(follow.extremes, T_LOW, column, width),
            part_of_row(follow.extremes, T_HIGH, column, width),
        )


@element
def nothing_to_widen(follow, first, part, t, v):
    """The `widen_all` of blocks: their quantities widen the extremes themselves."""


@dataclass(frozen=True)
class BlockLayout:
    """The arrays of a block.

    Attributes
    ----------
    form : Form
    n : int
        Number of degrees of freedom of a trajectory.
    lanes : int
        Number of trajectories in a block.
    shared : int
        Number of parameters of all trajectories, with which the array p begins.
    own : int
        Number of parameters of each trajectory, which are rows of lanes. With both, the functions get p as a pair.
    has_own_step : bool
        Whether p continues with the rows h and t0, and n rows of scratch.
    has_own_times : bool
        Whether the right-hand side gets an array with a time for each lane.
    """

    form: Form
    n: int
    lanes: int
    shared: int
    own: int
    has_own_step: bool
    has_own_times: bool = False

    @property
    def rhs(self) -> Any:
        """The signature of the right-hand side of a block. It has the vector form."""
        return none(*[vector_type] * 5) if self.has_own_times else VECTOR.rhs

    @property
    def params_size(self) -> int:
        """Number of values of the parameters of rhs in p."""
        return self.shared + self.own * self.lanes

    @property
    def begin_of_steps(self) -> int:
        """Index of the rows h and t0 in p. Before them are guard values, which rhs must not read."""
        return self.params_size + (_GUARD_ROWS * self.lanes if self.own else _GUARD_VALUES)

    @property
    def size(self) -> int:
        """Number of values of p."""
        return self.begin_of_steps + self.has_own_step * (OWN_STEP_ROWS + self.n) * self.lanes

    @property
    def _params(self) -> Any:
        """A compiled function of p and the lane for the parameters of a trajectory."""
        shared, own = _shared(self.shared), view(self.own, self.lanes, self.shared, readonly=True)
        if self.shared and self.own:
            return element(bound(both, {"SHARED": shared, "OWN": own}))
        return own if self.own else shared

    def names(self) -> dict[str, Any]:
        """Return the values of the names in capitals in the templates, except FUNCTION."""
        n, lanes, own = self.n, self.lanes, self.begin_of_steps
        given = view(n, lanes, readonly=True)
        names: dict[str, Any] = {
            "N": n,
            "LANES": lanes,
            "GIVEN": given,
            "WRITTEN": view(n, lanes),
            "STATE": _value if self.form is SCALAR else given,
            "PARAMS": self._params,
            "STEPS": _shared(lanes, own),
            "BEGINS": _shared(lanes, own + lanes),
            "VELOCITIES": _shared(n * lanes, own + OWN_STEP_ROWS * lanes, readonly=False),
            "TIME": time_of_lane if self.has_own_times else time_of_shared_step,
            "HAS_OWN_STEP": int(self.has_own_step),
        }
        if self.has_own_step:
            names["TIME"] = element(bound(time_of_own_step, names))
        return names


@dataclass(frozen=True, eq=False)
class Lanes:
    """A function of the user, compiled for a block. `compiled` keeps its machine code alive.

    `call` calls it from Python, without checks of the arguments. `obstacle` says why LLVM did not vectorise it, and
    what to do; it is empty if LLVM did.
    """

    call: Callable
    address: int
    obstacle: str
    compiled: Any


def compile_rhs(function: Callable, layout: BlockLayout, is_checked: bool = False) -> Lanes:
    """Compile the right-hand side of a block, from the plain Python function of the user.

    With `is_checked`, it raises an IndexError for an index beyond an array, and is not vectorised.
    """
    templates = (scalar_own_step, vector_own_step) if layout.has_own_step else (scalar, vector)
    return compile_template(templates[layout.form is not SCALAR], function, layout, layout.rhs.args, is_checked)


def compile_quantity(
    function: Callable, layout: BlockLayout, shape: tuple[int, ...], is_event: bool = False, is_checked: bool = False
) -> Lanes:
    """Compile the evaluation of an invariant or an output, whose value has the shape () or (k,).

    It is called as ``f(t, u, v, p, out, low, high, t_low, t_high)``, with the values of a kernel. The last five arrays
    have k rows of lanes: they take the values, the extremes so far, and the times at which these occurred. For events,
    see `count_changes`.
    """
    names = {"VALUES": view(shape[0], layout.lanes)} if shape else {}
    names["WIDEN"] = count_changes if is_event else widen
    return compile_template(written if shape else returned, function, layout, _QUANTITY.args, is_checked, names)


def compile_template(
    template: Callable,
    function: Callable,
    layout: BlockLayout,
    arguments: tuple,
    is_checked: bool,
    names: Mapping[str, Any] = MappingProxyType({}),
) -> Lanes:
    """Compile a template for a block, with the user's function inlined in it."""
    options = options_for(is_checked)

    def block(helpers: Callable) -> Lanes:
        given = {**layout.names(), **names, "FUNCTION": inlined(function, options, helpers)}
        return compile_block(bound(template, given), arguments, options)

    try:
        return block(_with_loops)
    except numba.NumbaError:  # Numba can compile a helper, but cannot inline it
        return block(_beside)


def options_for(is_checked: bool) -> dict[str, Any]:
    """Return the options of the compiler."""
    return {**KERNEL_OPTIONS, "boundscheck": True} if is_checked else KERNEL_OPTIONS


def compile_block(function: Callable, arguments: tuple, options: dict[str, Any], is_kept: bool = True) -> Lanes:
    """Compile a function of a block, whose globals are complete, or load it from the disk."""
    # If arrays might overlap, the code would have to check each pair of rows before its loop over lanes. A loop with
    # many such checks is not vectorised.
    jitted = assume_no_overlap(numba.njit(**options)(function))
    if is_kept:
        keep_on_disk(jitted, variant=f"lanes {has_wide_vectors()}", describe=_obstacle)
    with warnings.catch_warnings(), wide_vectors():
        warnings.simplefilter("ignore", numba.NumbaPerformanceWarning)  # the strides of lanes are here to stay
        result = compiled(jitted, arguments)
    obstacle = getattr(cache_of(jitted), "description", None)
    obstacle = _obstacle(result) if obstacle is None else obstacle
    return Lanes(call_without_checks(result), address_of(result), obstacle, result)


def inlined(function: Callable, options: dict[str, Any], helpers: Callable, above: tuple = ()) -> Any:
    """Compile a function for lanes: it is inlined before LLVM sees it, and so is what ``helpers(function)`` returns.

    A function that calls itself, in a function `above` or here, is not inlined there.
    """
    above = *above, function
    calls = {
        name: inlined(helper.py_func, options, helpers, above)
        for name, helper in helpers(function)
        if helper.py_func not in above
    }
    return numba.njit(inline="always", **options)(bound(function, calls) if calls else function)


def _helpers(function: Callable) -> list[tuple[str, Jitted]]:
    """Return the names and the jitted functions that a function calls, without the elements of this library."""
    named = inspect.getclosurevars(function)
    called = {**named.globals, **named.nonlocals}.items()
    return [(name, helper) for name, helper in called if isinstance(helper, Jitted) and not is_linked(helper)]


def _beside(function: Callable) -> list[tuple[str, Jitted]]:
    """Return those in the same written source."""
    return [(name, helper) for name, helper in _helpers(function) if is_beside(function.__code__, helper.py_func)]


def _with_loops(function: Callable) -> list[tuple[str, Jitted]]:
    """Return those, and those that have a loop: LLVM would prepare it for any n before it is inlined."""
    code = function.__code__
    return [each for each in _helpers(function) if is_beside(code, each[1].py_func) or _has_loop(each[1].py_func)]


def _has_loop(function: Callable, above: tuple = ()) -> bool:
    """Return whether a function, or one that it calls, has a loop."""
    if any(instruction.opname == "FOR_ITER" for instruction in dis.get_instructions(function)):
        return True
    above = *above, function
    return any(_has_loop(helper.py_func, above) for _, helper in _helpers(function) if helper.py_func not in above)


def _obstacle(result: Any) -> str:
    """Say why LLVM did not vectorise a loop over lanes, from a compile result; empty if it did."""
    code = optimised_code(result)
    # Neighbouring lanes are stored together. A loop over the degrees of freedom would store to distant places.
    is_vectorised = re.search(r"store <\d+ x double>", code)
    called = set((_OF_LIBM_IN_LANES if is_vectorised else _OF_LIBM).findall(code))
    if called:
        names = ", ".join(sorted(called))
        return f"it calls {names} of the C library for each member separately; use the functions of eig3.math"
    body = code[code.index("define") :].partition("\n}")[0]  # the body of the function; its wrappers follow
    if not is_vectorised and " = phi " in body:  # a constant force needs no loop, and zero is set by memset
        return (
            "it has branches or loops that do not work for several members at once; choose between simple values, "
            "split a loop that calls functions in many rounds, and read tables at the same place in all members, or as "
            "a sum of terms such as slope * max(v - v0, 0.0)"
        )
    return ""


def view(count: int, stride: int, first: int = 0, readonly: bool = False) -> Any:
    """Return a compiled ``view(array, lane)``: the values at first + lane + j stride for j < count."""
    return array_view(numba.types.Array(float64, 1, "A", readonly=readonly), count, stride, first, 1)


def _shared(count: int, first: int = 0, readonly: bool = True) -> Any:
    """Return a compiled ``view(array, lane)``: `count` neighbouring values of the array, for every lane."""
    return array_view(numba.types.Array(float64, 1, "C", readonly=readonly), count, 1, first, 0)


def array_view(kind: Any, count: int, stride: int, first: int, of_lane: int) -> Any:
    """Return a compiled ``view(array, lane)`` of `count` values from index ``first + of_lane * lane`` on."""

    def view(typingctx, array, lane):  # type: ignore[no-untyped-def]
        def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
            def constant(value: int) -> Any:
                return context.get_constant(numba.types.intp, value)

            source = parts_of(context, builder, signature.args[0], args[0])
            index = builder.add(builder.mul(args[1], constant(of_lane)), constant(first))
            data = builder.gep(source.data, [index])
            return array_over(context, builder, kind, data, constant(count), constant(8 * stride))

        return kind(array, int64), codegen

    view.content = f"view {kind} {count} {stride} {first} {of_lane}"  # type: ignore[attr-defined]
    return intrinsic(view)


@element
def _value(array, lane):
    return array[lane]
