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

import functools
from typing import Any, ClassVar

from ..compile.jit import element
from ..loops.pair import Steps, Text


class _Formulas(Steps):
    order, norm = 3, "(h * h / 6) ** 2 * {most}"
    row_names = "u", "v", "a0", "u_end", "v_end", "a_end", "u_most", "v_most", "a_before"
    carried: ClassVar = {"a_before": "a0", "u": "u_end", "v": "v_end", "a0": "a_end"}

    @functools.cache  # noqa: B019  they live as long as their module
    def functions(self) -> dict[str, Any]:
        return {**super().functions(), "restart": element(restart)}

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


def restart(y, n):
    """At the start and after a reset, there is no acceleration before."""
    for j in range(n):
        y[8][j] = y[2][j]


variable = _Formulas()
