# ruff: noqa: F821
"""The kernels that evaluate a function at rows of states, and the right-hand side at one state between guard values."""

import functools
import math
from typing import Any

from numba.types import Tuple, boolean, float64, int64, none

from ..compile.jit import compile_kernel, element
from ..protocol import VECTOR, Form, function_at, matrix_type, part_of_row, vector_type


def in_rows(address, p, t, u_rows, v_rows, values):
    f = FUNCTION(address)
    for i in range(len(t)):
        EVALUATE(f, t[i], u_rows[i], v_rows[i], p, values[i])


@element
def written(f, t, u, v, p, values):
    f(t, u, v, p, values)


@element
def returned(f, t, u, v, p, values):
    values[0] = f(t, u, v, p)


def guarded(address, t, u, v, p, guards):
    n, width = len(u), guards.shape[1]
    begin = (width - n) // 2
    for row in range(3):
        for j in range(width):
            guards[row, j] = math.nan
    a, u_inside = part_of_row(guards, 0, begin, n), part_of_row(guards, 1, begin, n)
    v_inside = part_of_row(guards, 2, begin, n)
    for j in range(n):
        u_inside[j], v_inside[j] = u[j], v[j]
    RHS(address)(t, u_inside, v_inside, p, a)
    is_within = True
    for j in range(begin):
        is_within &= guards[0, j] != guards[0, j] and guards[0, width - 1 - j] != guards[0, width - 1 - j]
    return largest(u), largest(v), largest(a), is_within


@element
def largest(x):
    size = 0.0
    for j in range(len(x)):
        if not abs(x[j]) <= size:
            size = abs(x[j]) if x[j] == x[j] else math.inf
    return size


@functools.cache
def rows_kernel(form: Form, kind: str) -> Any:
    """Compile the kernel, or load it from the disk.

    It is called as ``kernel(address, p, t, u_rows, v_rows, values)``, where `address` is the address of a function of
    the kind "rhs" or "invariant". It writes a row of `values` for each of the times t; all rows are rows of matrices.
    """
    names = {"FUNCTION": form.at(kind), "EVALUATE": written if kind == "rhs" else returned}
    signature = none(int64, vector_type, vector_type, *[matrix_type] * 3)
    return compile_kernel(in_rows, names, signature, f"{form.name}_{kind}")


@functools.cache
def guarded_kernel() -> Any:
    """Compile the kernel of the vector form that evaluates the right-hand side once, or load it from the disk.

    It is called as ``kernel(address, t, u, v, p, guards)`` with a matrix of three rows, which it fills with NaN. In the
    middle of the rows, the right-hand side gets room for a, and copies of u and v. The kernel returns the largest |u|,
    |v| and |a|, which are infinite if a value is not finite, and whether the guard values around a are still NaN.
    """
    signature = Tuple((*[float64] * 3, boolean))(int64, float64, *[vector_type] * 3, matrix_type)
    return compile_kernel(guarded, {"RHS": function_at(VECTOR.rhs)}, signature, "guarded")
