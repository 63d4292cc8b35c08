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

import re
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numba
import numpy as np
from numba.extending import intrinsic
from numba.types import float64, int64

from .compile.jit import KERNEL_OPTIONS, bound, compiled, element
from .compile.numba_internals import (
    address_of,
    addresses_of_arrays,
    array_over,
    assume_no_overlap,
    call_without_checks,
    optimised_code,
    parts_of,
    wide_vectors,
)
from .protocol import SCALAR, VECTOR, Form, matrix_type, vector_type

#: Functions of the C library that have no vector instruction.
_NAMES = (
    r"(acosh?|asinh?|atan[2h]?|cbrt|cosh?|erfc?|exp(?:2|10|m1)?|fmod|hypot|ldexp|l?gamma|log(?:2|10|1p)?|powi?"
    r"|remainder|sinh?|tanh?|tgamma)"
)
_OF_LIBM = re.compile(rf"call [^\n]*@(?:llvm\.)?{_NAMES}[.(]")
# A call for one value in vectorised code is outside the loop over lanes. LLVM widens the calls in this loop, and calls
# the C library as often as there are lanes.
_OF_LIBM_IN_LANES = re.compile(rf"@llvm\.{_NAMES}\.v\d+f64")

_CELLS, _GUARD_ROWS = 64, 4  # of NaN after the parameters: shared ones, and those in lanes

#: Rows of the parameters that follow those of rhs if each trajectory has its own step: h and t0.
OWN_STEP_ROWS = 2


def scalar(t, u, v, p, a):
    for lane in range(a.size):
        a[lane] = FUNCTION(t, u[lane], v[lane], PARAMS(p, lane))


def vector(t, u, v, p, a):
    for lane in range(a.size // N):
        FUNCTION(t, GIVEN(u, lane), GIVEN(v, lane), PARAMS(p, lane), WRITTEN(a, lane))


# With its own step h, each trajectory is integrated in the time (t - t0) / h with the step 1. Its velocity is then h v,
# and its acceleration h^2 a.


def scalar_own_step(t, u, v, p, a):
    h, t0 = STEPS(p, 0), BEGINS(p, 0)
    for lane in range(a.size):
        a[lane] = h[lane] * h[lane] * FUNCTION(t0[lane] + t * h[lane], u[lane], v[lane] / h[lane], PARAMS(p, lane))


def vector_own_step(t, u, v, p, a):
    h, t0, velocities, lanes = STEPS(p, 0), BEGINS(p, 0), VELOCITIES(p, 0), a.size // N
    # In a loop of their own: LLVM does not vectorise a loop that writes to the array in which it reads p.
    for j in range(N):
        for lane in range(lanes):
            velocities[j * lanes + lane] = v[j * lanes + lane] / h[lane]
    for lane in range(lanes):
        time = t0[lane] + t * h[lane]
        FUNCTION(time, GIVEN(u, lane), GIVEN(velocities, lane), PARAMS(p, lane), WRITTEN(a, lane))
    for j in range(N):
        for lane in range(lanes):
            a[j * lanes + lane] *= h[lane] * h[lane]


def returned(first, h, t0, p, u_rows, v_rows, every, out, values, low, high, at_low, at_high):
    """Evaluate a function that returns its only value, in the states from step index `first` on."""
    row = 0
    for i in range(len(u_rows)):
        u, v = u_rows[i], v_rows[i]
        for lane in range(h.size):
            out[lane] = FUNCTION(t0 + (first + i) * h[lane], STATE(u, lane), STATE(v, lane), PARAMS(p, lane))
        widen(out, float(first + i), low, high, at_low, at_high)
        row = keep(out, first + i, every, values, row)


def written(first, h, t0, p, u_rows, v_rows, every, out, values, low, high, at_low, at_high):
    """Do the same for a function that writes its values."""
    row = 0
    for i in range(len(u_rows)):
        u, v = u_rows[i], v_rows[i]
        for j in range(out.size):
            out[j] = np.nan  # a value that the function does not write stays NaN
        for lane in range(h.size):
            FUNCTION(t0 + (first + i) * h[lane], STATE(u, lane), STATE(v, lane), PARAMS(p, lane), VALUES(out, lane))
        widen(out, float(first + i), low, high, at_low, at_high)
        row = keep(out, first + i, every, values, row)


@element
def widen(values, index, low, high, at_low, at_high):
    """Widen extremes, and note the step index at which they occur."""
    are_within = True
    for j in range(values.size):
        are_within &= low[j] <= values[j] <= high[j]
    if are_within:  # as in most steps
        return
    for j in range(values.size):
        e = values[j]
        # Every comparison with NaN is false. So a NaN, once it is stored, stays, with its index.
        is_first_nan = e != e and low[j] == low[j]
        is_low, is_high = e < low[j] or is_first_nan, e > high[j] or is_first_nan
        low[j], at_low[j] = e if is_low else low[j], index if is_low else at_low[j]
        high[j], at_high[j] = e if is_high else high[j], index if is_high else at_high[j]


@element
def keep(values, index, every, rows, row):
    """Copy the values of every `every`-th step to the next row, and return the row after it."""
    if index % every != 0 or row == len(rows):
        return row
    for j in range(values.size):
        rows[row, j] = values[j]
    return row + 1


@dataclass(frozen=True)
class Layout:
    """The arrays of a block.

    Attributes
    ----------
    form : Form
    n : int
        Number of degrees of freedom of a trajectory.
    lanes : int
        Number of trajectories in a block.
    k : int
        Number of parameters.
    shares_params : bool
        Whether the array p begins with one set of parameters for all trajectories, and not with k rows of lanes.
    has_own_step : bool
        Whether p goes on with the rows h and t0, and n rows of scratch.
    """

    form: Form
    n: int
    lanes: int
    k: int
    shares_params: bool
    has_own_step: bool

    @property
    def params_size(self) -> int:
        """Number of values of the parameters of rhs in p."""
        return self.k if self.shares_params else self.k * self.lanes

    @property
    def begin_of_steps(self) -> int:
        """Index of the rows h and t0 in p. Before them are cells of NaN, which rhs must not read."""
        return self.params_size + (_CELLS if self.shares_params else _GUARD_ROWS * self.lanes)

    @property
    def size(self) -> int:
        """Number of values of p."""
        return self.begin_of_steps + self.has_own_step * (OWN_STEP_ROWS + self.n) * self.lanes

    def names(self) -> dict[str, Any]:
        """Return the values of the names in capitals in the templates, except FUNCTION."""
        n, lanes, own = self.n, self.lanes, self.begin_of_steps
        given = _view(n, lanes, readonly=True)
        return {
            "N": n,
            "GIVEN": given,
            "WRITTEN": _view(n, lanes),
            "STATE": _value if self.form is SCALAR else given,
            "PARAMS": _shared(self.k) if self.shares_params else _view(self.k, lanes, readonly=True),
            "STEPS": _shared(lanes, own),
            "BEGINS": _shared(lanes, own + lanes),
            "VELOCITIES": _shared(n * lanes, own + OWN_STEP_ROWS * lanes, readonly=False),
        }


@dataclass(frozen=True, eq=False)
class Lanes:
    """A function of the user, compiled for a block.

    Attributes
    ----------
    call : callable
        Calls it from Python, without checks of the arguments.
    address : int
        The address of its machine code.
    obstacle : str
        Why LLVM did not vectorise it, and what to do; empty if it did.
    compiled : Numba's compile result
        Keeps the machine code alive.
    """

    call: Callable
    address: int
    obstacle: str
    compiled: Any


def compile_rhs(function: Callable, layout: Layout, is_checked: bool = False) -> Lanes:
    """Compile the right-hand side of a block, from the plain Python function of the user. It has the vector form.

    With `is_checked`, it raises an IndexError for an index beyond an array, and is not vectorised.
    """
    templates = (scalar_own_step, vector_own_step) if layout.has_own_step else (scalar, vector)
    return _compile(templates[layout.form is not SCALAR], function, layout, VECTOR.rhs.args, is_checked)


def compile_quantity(function: Callable, layout: Layout, shape: tuple[int, ...], is_checked: bool = False) -> Lanes:
    """Compile the evaluation of an invariant or an output, whose value has the shape () or (k,).

    It is called as ``f(first, h, t0, p, u_rows, v_rows, every, out, values, low, high, at_low, at_high)``. The arrays
    `out` and the last four have k rows of lanes. They take the last values, and the extremes so far with the step
    indices at which they occurred. `values` has a row for each state whose step index is a multiple of `every`, or no
    rows if the values are not wanted.
    """
    arguments = int64, vector_type, float64, vector_type, *[matrix_type] * 2, int64, vector_type, matrix_type
    arguments += (vector_type,) * 4
    names = {"VALUES": _view(shape[0], layout.lanes)} if shape else {}
    return _compile(written if shape else returned, function, layout, arguments, is_checked, names)


def _compile(
    template: Callable,
    function: Callable,
    layout: Layout,
    arguments: tuple,
    is_checked: bool,
    names: Mapping[str, Any] = MappingProxyType({}),
) -> Lanes:
    options = {**KERNEL_OPTIONS, "boundscheck": True} if is_checked else KERNEL_OPTIONS
    inlined = numba.njit(inline="always", **options)(function)
    function = bound(template, {**layout.names(), **names, "FUNCTION": inlined})
    with warnings.catch_warnings(), wide_vectors(), addresses_of_arrays():
        warnings.simplefilter("ignore", numba.NumbaPerformanceWarning)  # the strides of lanes are here to stay
        # If arrays might overlap, the code would have to check each pair of rows before its loop over lanes. A loop
        # with many such checks is not vectorised.
        result = compiled(assume_no_overlap(numba.njit(**options)(function)), arguments)
    return Lanes(call_without_checks(result), address_of(result), _obstacle(optimised_code(result)), result)


def _obstacle(code: str) -> str:
    """Say why LLVM did not vectorise a loop over lanes, from its optimised code; empty if it did."""
    # Neighbouring lanes are stored together. A loop over the degrees of freedom would store to distant places.
    is_vectorised = re.search(r"store <\d+ x double>", code)
    called = set((_OF_LIBM_IN_LANES if is_vectorised else _OF_LIBM).findall(code))
    if called:
        names = ", ".join(sorted(called))
        return f"it calls {names} of the C library for each member separately; use the functions of eig3.math"
    if not is_vectorised:
        return "it has branches or loops that do not work for several members at once; choose between simple values"
    return ""


def _view(count: int, stride: int, first: int = 0, readonly: bool = False) -> Any:
    """Return a compiled ``view(array, lane)``: the values at first + lane + j stride for j < count."""
    return _array_view(numba.types.Array(float64, 1, "A", readonly=readonly), count, stride, first, 1)


def _shared(count: int, first: int = 0, readonly: bool = True) -> Any:
    """Return a compiled ``view(array, lane)``: `count` neighbouring values of the array, for every lane."""
    return _array_view(numba.types.Array(float64, 1, "C", readonly=readonly), count, 1, first, 0)


def _array_view(kind: Any, count: int, stride: int, first: int, of_lane: int) -> Any:
    @intrinsic
    def view(typingctx, array, lane):  # type: ignore[no-untyped-def]
        def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
            def constant(value: int) -> Any:
                return context.get_constant(numba.types.intp, value)

            source = parts_of(context, builder, signature.args[0], args[0])
            index = builder.add(builder.mul(args[1], constant(of_lane)), constant(first))
            data = builder.gep(source.data, [index])
            return array_over(context, builder, kind, data, constant(count), constant(8 * stride))

        return kind(array, int64), codegen

    return view


@element
def _value(array, lane):
    return array[lane]
