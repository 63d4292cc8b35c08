# ruff: noqa: F821
"""The kernel that evaluates the right-hand side at rows of states."""

import functools
from typing import Any

from numba.types import int64, none

from ..compile.jit import compile_kernel
from ..protocol import SCALAR, Form, function_at, vector_type


def scalar(address, p, t, u_rows, v_rows, a_rows):
    f = RHS(address)
    for i in range(len(t)):
        a_rows[i] = f(t[i], u_rows[i], v_rows[i], p)


def vector(address, p, t, u_rows, v_rows, a_rows):
    f = RHS(address)
    for i in range(len(t)):
        f(t[i], u_rows[i], v_rows[i], p, a_rows[i])


@functools.cache
def acceleration_kernel(form: Form) -> Any:
    """Compile the kernel, or load it from the disk.

    It is called as ``kernel(address, p, t, u_rows, v_rows, a_rows)``, where `address` is the address of the compiled
    right-hand side, and writes a_rows.
    """
    template = scalar if form is SCALAR else vector
    signature = none(int64, vector_type, vector_type, form.state, form.state, form.state)
    return compile_kernel(template, {"RHS": function_at(form.rhs)}, signature, f"accelerations_{form.name}")
