"""The loops over the steps of a fixed-step method, which also write the states to save.

`step` returns the next state and whether it succeeded. For a method whose steps cannot fail, LLVM removes this test.
The time is computed as t0 + i h from the step index i. A sum of steps would accumulate round-off, and would depend on
the division of the run into chunks.
"""

import numba

from ..compile.jit import element
from ..protocol import At, row_index

#: Whether to check that a step returns each of its rows once.
CHECKED = bool(numba.config.BOUNDSCHECK)


@element
def march_scalar(step, f, y, c, run, first, last, row):
    """Advance the tuple `y` = (u, v, past ...) from step `first` to `last`.

    Return the last `y`, the step index that was reached, and the next row of `run.u_rows` to write.
    """
    left = run.every - first % run.every
    for i in range(first, last):
        y_next, success = step(f, At(i, run.t0 + i * run.h, run.h, run.p), y, c)
        if not success:
            return y, i, row
        y = y_next
        left -= 1
        if left == 0:
            run.u_rows[row] = y[0]
            run.v_rows[row] = y[1]
            row += 1
            left = run.every
    return y, last, row


@element
def march_vector(step, complete, f, y, c, n, run, first, last, row):
    """Do the same as `march_scalar` for a tuple of rows of n values, which a step may return in another order."""
    left = run.every - first % run.every
    for i in range(first, last):
        y_next, success = step(f, At(i, run.t0 + i * run.h, run.h, run.p), y, c, n)
        if not success:
            return y, i, row
        y = y_next
        left -= 1
        if left == 0:
            write(complete, y, c, n, run, row)
            row += 1
            left = run.every
    if last > first:  # otherwise the last step may be one of the starter, which has no need of it
        complete(y, c, run.h, n)
    return y, last, row


@element
def write(complete, y, c, n, run, row):
    complete(y, c, run.h, n)
    for values, rows in ((y[0], run.u_rows), (y[1], run.v_rows)):  # LLVM does not vectorise one loop for both
        for j in range(n):
            rows[row, j] = values[j]


@element
def settle(y, state, n):
    """Move the contents of the rows so that row k of the state contains y[k] again."""
    if CHECKED:
        for k in range(len(y)):
            for other in range(k):
                if row_index(y[k], state) == row_index(y[other], state):
                    raise IndexError("a step must return each of its rows once.")
    for k in range(len(y)):
        place = row_index(y[k], state)
        while place < k:  # an earlier exchange moved this content to another row
            place = row_index(y[place], state)
        if place != k:
            for j in range(n):
                state[k, j], state[place, j] = state[place, j], state[k, j]
