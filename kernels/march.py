"""The two loops every method runs in: from step `first`, take `count` steps and write every `every`-th state.

`step` returns whether it succeeded; LLVM drops the test for the methods that cannot fail. Time is t0 + i h from the
step index i: a sum of steps would drift, and a chunk could not start in the middle.
"""

from .jit import element


@element
def march_scalar(step, f, y, c, run):
    """March the tuple `y` (u, v, history ...); return it and the number of steps taken."""
    h, t0, p, first, count, every, u_rows, v_rows = run
    row = 0
    left = every - first % every
    for i in range(first, first + count):
        y_next, success = step(f, t0 + i * h, y, c, h, p)
        if not success:
            return y, i - first
        y = y_next
        left -= 1
        if left == 0:
            u_rows[row] = y[0]
            v_rows[row] = y[1]
            row += 1
            left = every
    return y, count


@element
def march_one_step(step, evaluations, f, state, tally, run):
    """`march_scalar` for a method that carries nothing beside u and v, from the state array and back."""
    y, taken = march_scalar(step, f, (state[0], state[1]), (), run)
    state[0], state[1] = y
    tally[0] += evaluations * taken
    return taken


@element
def march_vector(step, f, y, c, run):
    """March the tuple `y` of arrays (u, v, history ..., scratch ...) in place; return the number of steps taken."""
    return march_vector_lazily(step, nothing, f, y, c, run)


@element
def nothing(y, c, h, n):
    pass


@element
def march_vector_lazily(step, complete, f, y, c, run):
    """`march_vector` for a step that leaves v to ``complete(y, c, h, n)``, called where a state is seen."""
    n = y[0].size
    if n == 2:  # a number the compiler knows: it drops the loops over two components, a tenth of a pendulum's time
        return march_components(step, complete, f, y, c, 2, run)
    return march_components(step, complete, f, y, c, n, run)


@element
def march_components(step, complete, f, y, c, n, run):
    h, t0, p, first, count, every, u_rows, v_rows = run
    u, v = y[0], y[1]
    row = 0
    left = every - first % every
    for i in range(first, first + count):
        if not step(f, t0 + i * h, y, c, h, p, n):
            return i - first
        left -= 1
        if left == 0:
            complete(y, c, h, n)
            for j in range(n):
                u_rows[row, j] = u[j]
                v_rows[row, j] = v[j]
            row += 1
            left = every
    complete(y, c, h, n)
    return count
