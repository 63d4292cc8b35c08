"""AB3, the third-order Adams-Bashforth method on (u, v). RK3, which has the same order, takes the first two steps.

u_{n+1} = u_n + h/12 (23 v_n - 16 v_{n-1} + 5 v_{n-2})
v_{n+1} = v_n + h/12 (23 a_n - 16 a_{n-1} + 5 a_{n-2})
"""

from ..compile.jit import element

PAST, ROWS, EVALUATIONS = 4, 7, 1
START, START_STEPS = "rk3", 2


@element
def step(f, at, y, c, n):
    u, v, v1, a1, v2, a2, a = y
    c = at.h / 12
    f(at.t, u, v, at.p, a)
    for j in range(n):
        v_now = v[j]
        u[j], v[j] = (
            u[j] + c * (23 * v_now - 16 * v1[j] + 5 * v2[j]),
            v_now + c * (5 * a2[j] - 16 * a1[j]) + c * 23 * a[j],
        )
        v2[j] = v_now
    return (u, v, v2, a, v1, a1, a2), True
