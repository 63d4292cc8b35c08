# ruff: noqa: F821
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

from ..compile.jit import bound, element, outlined
from ..loops.dense import QUINTIC_TERMS, quintic
from ..loops.pair import moved


class _Formulas:
    """The formulas, with the names of `eig3.kernels.loops.pair.Pair`."""

    rows, order, evaluations, dense_evaluations = 9, 3, 1, 0
    terms, work_rows = QUINTIC_TERMS, 2 + 2 * QUINTIC_TERMS
    row_names = ("u", "v", "a", "u_end", "v_end", "a_end", "u_most", "v_most", "a_before")

    def functions(self) -> dict[str, Any]:
        found = {function.__name__: element(function) for function in (trial, square, dense, advance, restart)}
        return {**found, "dense_called": outlined(dense)}

    def of_lanes(self, n: int, lanes: int) -> dict[str, Any]:
        """Return the elements of `eig3.kernels.adaptive_lanes`."""
        names = {"N": n, "LANES": lanes, "MOVE_STATE": moved({"N": n, "LANES": lanes})}
        templates: dict[str, Any] = {"TRIAL": trial_of_lanes, "SQUARE": square_of_lanes, "MOVE": move_of_lanes}
        return {name: element(bound(template, names)) for name, template in templates.items()}


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


def trial_of_lanes(f, time, there, step, before, p, y):
    u, v, a, u_end, v_end, a_end, _, _, a_before = y
    for d in range(N):
        for lane in range(LANES):
            j, h = d * LANES + lane, step[lane]
            rise = before[lane] / h * (a[j] - a_before[j])
            u_end[j], v_end[j] = u[j] + h * (v[j] + h / 2 * (a[j] + rise)), v[j] + h * (a[j] + rise / 2)
    for lane in range(LANES):
        there[lane] = time[lane] + step[lane]
    f(there, u_end, v_end, p, a_end)


def square_of_lanes(step, rtol, atol, u_least, v_least, total, most, more, square, y):
    u, _, a, u_end, _, a_end, u_most, _, _ = y
    for lane in range(LANES):
        total[lane], most[lane] = 0.0, 0.0
    for d in range(N):
        for lane in range(LANES):
            j = d * LANES + lane
            size = max(abs(u[j]), abs(u_end[j]), u_most[j], u_least[lane])
            part = (a_end[j] - a[j]) / (atol[0, d] + rtol * size + 1e-300)
            most[lane] = max(most[lane], part * part)
            total[lane] += part
    for lane in range(LANES):
        blow_up, h = total[lane] - total[lane], step[lane]
        square[lane] = (h * h / 6) ** 2 * most[lane] if blow_up == 0 else blow_up


def move_of_lanes(ok, y):
    a, a_before = y[2], y[8]
    for d in range(N):
        for lane in range(LANES):
            j = d * LANES + lane
            a_before[j] = a[j] if ok[lane] > 0 else a_before[j]
    MOVE_STATE(ok, y)


variable = _Formulas()
