"""EIG-3(alpha, beta), the explicit integration method of grade 3.

    a_n     = f(t_n, u_n, v_n)
    u_{n+1} = u_n + h v_n + h^2/2 [a_n + alpha (a_n - a_{n-1})]
    v_{n+1} = v_n + h [a_n + beta (a_n - a_{n-1})]

There is no a_{-1} at the start. With a_{-1} = a_0, the first step is the Taylor step of the article.
"""

from ..compile.jit import element

PAST, ROWS, EVALUATIONS = 1, 4, 1


@element
def constants(settings, h, work):
    alpha, beta = settings[0], settings[1]
    return h * h / 2 * (1 + alpha), h * h / 2 * alpha, h * (1 + beta), h * beta


@element
def step(f, at, y, c, n):
    u, v, a_past, a = y
    c_now, c_past, b_now, b_past = c
    f(at.t, u, v, at.p, a)
    for j in range(n):
        # The terms are grouped so that only one multiply-add for u has to wait for a.
        u[j], v[j] = (
            u[j] + (at.h * v[j] - c_past * a_past[j]) + c_now * a[j],
            v[j] - b_past * a_past[j] + b_now * a[j],
        )
    return (u, v, a, a_past), True


def start(u, v, a, h):
    return (a,)
