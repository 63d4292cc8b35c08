"""AB3, the third-order Adams-Bashforth method on (u, v); its first two steps are Kutta's, of the same order.

u_{n+1} = u_n + h/12 (23 v_n - 16 v_{n-1} + 5 v_{n-2})
v_{n+1} = v_n + h/12 (23 a_n - 16 a_{n-1} + 5 a_{n-2})
"""

from . import rk3
from .jit import element
from .march import march_scalar, march_vector

START_STEPS = 2


@element
def update(u, v, a, v1, a1, v2, a2, h):
    c = h / 12
    return u + c * (23 * v - 16 * v1 + 5 * v2), v + c * (5 * a2 - 16 * a1) + c * 23 * a


@element
def start_scalar(f, t, y, c, h, p):
    u, v, v1, a1, _, _ = y
    u_next, v_next, a = rk3.kutta(f, t, u, v, h, p)
    return (u_next, v_next, v, a, v1, a1), True


@element
def step_scalar(f, t, y, c, h, p):
    u, v, v1, a1, v2, a2 = y
    a = f(t, u, v, p)
    u_next, v_next = update(u, v, a, v1, a1, v2, a2, h)
    return (u_next, v_next, v, a, v1, a1), True


@element
def start_vector(f, t, y, c, h, p, n):
    u, v, v1, a1, v2, a2, _, u_stage, v_stage, b2, b3 = y
    for j in range(n):
        v2[j], a2[j], v1[j] = v1[j], a1[j], v[j]
    rk3.step_vector(f, t, (u, v, u_stage, v_stage, a1, b2, b3), c, h, p, n)
    return True


@element
def step_vector(f, t, y, c, h, p, n):
    u, v, v1, a1, v2, a2, a = y[:7]
    f(t, u, v, p, a)
    for j in range(n):
        v_now = v[j]
        u[j], v[j] = update(u[j], v_now, a[j], v1[j], a1[j], v2[j], a2[j], h)
        v2[j], a2[j], v1[j], a1[j] = v1[j], a1[j], v_now, a[j]
    return True


@element
def split(first, count, every):
    """Of `count` steps from `first`: how many start the history, and how many states those write."""
    begin = max(0, min(count, START_STEPS - first))
    return begin, (first + begin) // every - first // every


def scratch(n):
    return 5


def start(u, v, a, h):
    return v, a, v, a  # overwritten by the first two steps


def scalar(f, state, settings, tally, run):
    y = state[0], state[1], state[2], state[3], state[4], state[5]
    h, t0, p, first, count, every, u_rows, v_rows = run
    begin, written = split(first, count, every)
    y, _ = march_scalar(start_scalar, f, y, (), (h, t0, p, first, begin, every, u_rows, v_rows))
    rest = (h, t0, p, first + begin, count - begin, every, u_rows[written:], v_rows[written:])
    y, _ = march_scalar(step_scalar, f, y, (), rest)
    state[0], state[1], state[2], state[3], state[4], state[5] = y
    tally[0] += 2 * begin + count
    return count


def vector(f, state, settings, tally, run):
    y = (
        state[0], state[1], state[2], state[3], state[4], state[5],
        state[6], state[7], state[8], state[9], state[10],
    )  # fmt: skip
    h, t0, p, first, count, every, u_rows, v_rows = run
    begin, written = split(first, count, every)
    march_vector(start_vector, f, y, (), (h, t0, p, first, begin, every, u_rows, v_rows))
    rest = (h, t0, p, first + begin, count - begin, every, u_rows[written:], v_rows[written:])
    march_vector(step_vector, f, y, (), rest)
    tally[0] += 2 * begin + count
    return count
