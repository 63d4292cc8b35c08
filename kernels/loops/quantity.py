# ruff: noqa: F821
"""The kernel that evaluates a quantity, an invariant or an output, at rows of states, and widens its extremes."""

import functools
from typing import Any

import numpy as np
from numba.types import int64, none

from ..compile.jit import compile_kernel, element
from ..protocol import Form, function_at, matrix_type, vector_type
from .follow import widen


def extent(address, p, t, u_rows, v_rows, out, values, extremes):
    function = FUNCTION(address)
    for i in range(len(t)):
        EVALUATE(function, t[i], u_rows[i], v_rows[i], p, out, values, i)
        for j in range(out.size):
            widen(extremes, j, values[i, j], t[i])


@element
def returned(function, t, u, v, p, out, values, i):
    values[i, 0] = function(t, u, v, p)


@element
def written(function, t, u, v, p, out, values, i):
    for j in range(out.size):
        out[j] = np.nan  # a value that the function does not write stays NaN
    function(t, u, v, p, out)
    for j in range(out.size):
        values[i, j] = out[j]


@functools.cache
def extent_kernel(form: Form, writes: bool) -> Any:
    """Compile the kernel, or load it from the disk.

    It is called as ``kernel(address, p, t, u_rows, v_rows, out, values, extremes)``. It evaluates the function at this
    address in each row, into the array `out` of k values, copies them to the rows of `values`, and widens `extremes`.
    If a value is NaN, both of its extremes become NaN, and their times the time of the first NaN.

    Parameters
    ----------
    form : Form
    writes : bool
        Whether the function writes its values. If not, it returns its only value.
    """
    arguments = int64, vector_type, vector_type, form.state, form.state, vector_type, matrix_type, matrix_type
    names = {
        "FUNCTION": function_at(form.output if writes else form.invariant),
        "EVALUATE": written if writes else returned,
    }
    return compile_kernel(extent, names, none(*arguments), f"{form.name}_{'written' if writes else 'returned'}")
