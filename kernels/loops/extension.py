# ruff: noqa: F821
"""The kernel for states between the ends of the steps of a pair, from its continuous extension.

A run does not keep the stages of its steps: each step that is needed is taken again.
"""

import functools
from typing import Any

from numba.types import Array, int64, none

from ..compile.jit import compile_kernel
from ..protocol import Form, matrix_type, rows, vector_type
from .dense import evaluate
from .formulas import variable_formulas
from .pair import U_END, V_END, A, U, V


def between(address, p, t, u_rows, v_rows, left, times, u, v, work):
    """Write the states at `times`, where times[i] is in the step from row left[i] to the next row."""
    f, n = RHS(address), u_rows.shape[1]
    y, coefficients, known = rows(work, ROWS), work[ROWS:], -1
    for i in range(len(times)):
        k = left[i]
        h = t[k + 1] - t[k]
        if k != known:
            for j in range(n):
                y[U][j], y[V][j] = u_rows[k, j], v_rows[k, j]
            f(t[k], y[U], y[V], p, y[A])
            TRIAL(f, t[k], h, h, p, n, y)
            for j in range(n):
                y[U_END][j], y[V_END][j] = u_rows[k + 1, j], v_rows[k + 1, j]
            DENSE(f, t[k], h, p, n, y, coefficients)
            known = k
        evaluate(coefficients, (times[i] - t[k]) / h, n, u[i], v[i])


@functools.cache
def extension_kernel(pair: str, form: Form) -> Any:
    """Compile the kernel of a pair, or load it from the disk.

    It is called as `between`. All states are rows of n values. `work` has the rows of a step, and of its dense output.
    """
    formulas = variable_formulas(pair)
    theirs = formulas.functions()
    names = {"RHS": form.at("rhs"), "ROWS": formulas.rows, "TRIAL": theirs["trial"], "DENSE": theirs["dense_called"]}
    states = (matrix_type,) * 2
    signature = none(int64, vector_type, vector_type, *states, Array(int64, 1, "C"), vector_type, *states, matrix_type)
    return compile_kernel(between, names, signature, f"extension_{pair}_{form.name}")
