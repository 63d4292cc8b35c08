# ruff: noqa: F821
"""Follow an invariant along rows of states: the least and the largest e(t_i, u_i, v_i, p), a NaN kept once met."""

import functools
from typing import Any

from numba.types import UniTuple, float64, int64

from .jit import compile_kernel
from .protocol import Form, function_at, vector_type


def extent(address, t0, h, p, first, u_rows, v_rows):
    invariant = INVARIANT(address)
    low = high = invariant(t0 + first * h, u_rows[0], v_rows[0], p)
    for i in range(1, len(u_rows)):
        e = invariant(t0 + (first + i) * h, u_rows[i], v_rows[i], p)
        # A NaN compares false with everything: it needs a test of its own to get in, and none to stay.
        if e < low or e != e:
            low = e
        if e > high or e != e:
            high = e
    return low, high


@functools.cache
def invariant_kernel(form: Form) -> Any:
    """Compile the loop, or load it from the disk: ``kernel(address, t0, h, p, first, u_rows, v_rows)``."""
    arguments = int64, float64, float64, vector_type, int64, form.state, form.state
    signature = UniTuple(float64, 2)(*arguments)
    kernel = compile_kernel(extent, {"INVARIANT": function_at(form.invariant)}, signature, form.name)
    return kernel.overloads[signature.args].entry_point
