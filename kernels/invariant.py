# ruff: noqa: F821
"""The kernel that evaluates an invariant e(t_i, u_i, v_i, p) at rows of states and returns its extremes.

If one value is NaN, both extremes are NaN.
"""

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
        # Every comparison with NaN is false. So `e != e` stores a NaN, and no later e replaces it.
        if e < low or e != e:
            low = e
        if e > high or e != e:
            high = e
    return low, high


@functools.cache
def invariant_kernel(form: Form) -> Any:
    """Compile the kernel, or load it from the disk.

    It is called as ``kernel(address, t0, h, p, first, u_rows, v_rows)``, where `address` is the address of the compiled
    invariant and `first` is the step index of the first row. It returns the smallest and the largest value.
    """
    arguments = int64, float64, float64, vector_type, int64, form.state, form.state
    signature = UniTuple(float64, 2)(*arguments)
    return compile_kernel(extent, {"INVARIANT": function_at(form.invariant)}, signature, form.name)
