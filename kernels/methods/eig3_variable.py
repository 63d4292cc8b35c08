"""EIG-3 with steps of variable length.

    r = h_n / h_{n-1}        alpha = 1/r        beta = 1/(2r)
    u_{n+1} = u_n + h v_n + h^2/2 [a_n + alpha (a_n - a_{n-1})]
    v_{n+1} = v_n + h [a_n + beta (a_n - a_{n-1})]

With equal steps, this is EIG-3(1, 1/2). These alpha and beta keep the second order, because
V_n = v_n + h_{n-1}/2 (a_n - a_{n-1}) is the velocity of the velocity Verlet method:

    u_{n+1} = u_n + h V_n + h^2/2 a_n        V_{n+1} = V_n + h/2 (a_n + a_{n+1})

The estimate of the error of u is the next term of its Taylor series, h^2/6 |a_{n+1} - a_n|.
"""

from __future__ import annotations

from typing import Any

from ..compile.jit import element, outlined
from ..loops.dense import QUINTIC_TERMS, quintic


class _Formulas:
    """The formulas, with the names of `eig3.kernels.loops.pair.Pair`."""

    rows, order, evaluations, dense_evaluations = 9, 3, 1, 0
    terms, work_rows = QUINTIC_TERMS, 2 + 2 * QUINTIC_TERMS

    def functions(self) -> dict[str, Any]:
        found = {function.__name__: element(function) for function in (trial, square, dense, advance, restart)}
        return {**found, "dense_called": outlined(dense)}


def trial(f, t, h, h_before, p, n, y):
    u, v, a, u_end, v_end, a_end, _, _, a_before = y
    alpha = h_before / h
    for j in range(n):
        rise = alpha * (a[j] - a_before[j])
        u_end[j], v_end[j] = u[j] + h * (v[j] + h / 2 * (a[j] + rise)), v[j] + h * (a[j] + rise / 2)
    f(t + h, u_end, v_end, p, a_end)


def square(h, h_before, n, y, rtol, atol, u_least, v_least):
    u, _, a, u_end, _, a_end, u_most, _, _ = y
    most, total = 0.0, 0.0
    for j in range(n):
        part = (a_end[j] - a[j]) / (atol[0, j] + rtol * max(abs(u[j]), abs(u_end[j]), u_most[j], u_least) + 1e-300)
        most = max(most, part * part)
        total += part
    return (h * h / 6) ** 2 * most if total - total == 0 else total - total


def advance(y, n):
    u, v, a, u_end, v_end, a_end, _, _, a_before = y
    for j in range(n):
        a_before[j] = a[j]
        u[j], v[j], a[j] = u_end[j], v_end[j], a_end[j]


def restart(y, n):
    """At the start and after a reset, there is no acceleration before."""
    for j in range(n):
        y[8][j] = y[2][j]


def dense(f, t, h, p, n, y, coefficients):
    u, v, a, u_end, v_end, a_end, _, _, _ = y
    quintic(h, n, u, v, a, u_end, v_end, a_end, coefficients)


variable = _Formulas()
