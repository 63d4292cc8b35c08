"""BM6, the symplectic Runge-Kutta-Nystroem method of order 6 with eleven evaluations, for f(t, u).

Eleven times

    v += h b_i a        u += h a_i v        a = f(t + h (a_1 + ... + a_i), u)

and then v += h b_12 a. The last a is the first of the next step. The coefficients are SRKN 11b in table 3 of
S. Blanes and P. C. Moan, Practical symplectic partitioned Runge-Kutta and Runge-Kutta-Nystroem methods, Journal of
Computational and Applied Mathematics 142 (2002), 313-330; the method is symmetric.
"""

from itertools import accumulate

from ..compile.jit import element

ROWS, PAST, EVALUATIONS = 3, 1, 11

_B = (0.0414649985182624, 0.198128671918067, -0.0400061921041533, 0.0752539843015807, -0.0115113874206879)
_A = (0.123229775946271, 0.290553797799558, -0.127049212625417, -0.246331761062075, 0.357208872795928)
KICKS = (*_B, 0.5 - sum(_B), 0.5 - sum(_B), *_B[::-1])
DRIFTS = (*_A, 1 - 2 * sum(_A), *_A[::-1])
TIMES = (*tuple(accumulate(DRIFTS))[:-1], 1.0)


def start(u, v, a, h):
    return (a,)


@element
def step(f, at, y, c, n):
    u, v, a = y
    for i in range(11):
        kick, drift = KICKS[i] * at.h, DRIFTS[i] * at.h
        for j in range(n):
            # In this form, u has to wait for only one operation after a.
            u[j], v[j] = (u[j] + drift * v[j]) + drift * kick * a[j], v[j] + kick * a[j]
        f(at.t + TIMES[i] * at.h, u, v, at.p, a)
    for j in range(n):
        v[j] += KICKS[11] * at.h * a[j]
    return y, True
