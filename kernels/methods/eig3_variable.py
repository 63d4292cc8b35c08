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

from ..compile.jit import bound, element
from ..loops.pair import Steps, Text, moved


class _Formulas(Steps):
    order, norm = 3, "(h * h / 6) ** 2 * {most}"
    row_names = "u", "v", "a0", "u_end", "v_end", "a_end", "u_most", "v_most", "a_before"

    def functions(self) -> dict[str, Any]:
        return {**super().functions(), "advance": element(advance), "restart": element(restart)}

    def of_lanes(self, n: int, lanes: int) -> dict[str, Any]:
        names = {"N": n, "LANES": lanes, "MOVE_STATE": moved({"N": n, "LANES": lanes})}
        return {**super().of_lanes(n, lanes), "MOVE": element(bound(move_of_lanes, names))}

    def _trial(self, out: Text) -> None:
        with out.entries():
            out.line(f"rise = {out.before} / h * (a0[j] - a_before[j])")
            out.line("u_end[j] = u[j] + h * (v[j] + h / 2 * (a0[j] + rise))")
            out.line("v_end[j] = v[j] + h * (a0[j] + rise / 2)")
        out.force(1.0, "u_end", "v_end", "a_end")

    def _errors(self, out: Text, total: str, most: str, more: str) -> None:
        size = f"max(abs(u[j]), abs(u_end[j]), u_most[j], u_least{out.own})"
        out.line(f"part = (a_end[j] - a0[j]) / (atol[0, {out.d}] + rtol * {size} + 1e-300)")
        out.line(f"{most} = max({most}, part * part)", f"{total} += part")


def advance(y, n):
    u, v, a, u_end, v_end, a_end, _, _, a_before = y
    for j in range(n):
        a_before[j] = a[j]
        u[j], v[j], a[j] = u_end[j], v_end[j], a_end[j]


def restart(y, n):
    """At the start and after a reset, there is no acceleration before."""
    for j in range(n):
        y[8][j] = y[2][j]


def move_of_lanes(ok, y):
    a, a_before = y[2], y[8]
    for d in range(N):
        for lane in range(LANES):
            j = d * LANES + lane
            a_before[j] = a[j] if ok[lane] > 0 else a_before[j]
    MOVE_STATE(ok, y)


variable = _Formulas()
