"""EIG-3(1, 1/2) for a force without velocity, in terms of the velocity w at the middle of the steps.

    w_n = v_n - h/2 a_{n-1}
    w_{n+1} = w_n + h a_n        u_{n+1} = u_n + h w_{n+1}        v_{n+1} = w_{n+1} + h/2 a_n

Substituting w gives the formulas of EIG-3(1, 1/2); u is the same as in central difference. If f does not read v, no
step needs v. With n degrees of freedom, a step then reads and writes fewer arrays.
"""

from ..compile.jit import element
from .cd import EVALUATIONS, PAST, ROWS, complete, move, start

__all__ = ["EVALUATIONS", "PAST", "ROWS", "complete", "start", "step"]


@element
def step(f, at, y, c, n):
    u, v, w, a = y
    f(at.t, u, v, at.p, a)
    for j in range(n):
        u[j], w[j] = move(u[j], w[j], a[j], at.h)
    return y, True
