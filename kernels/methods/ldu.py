"""The factorisation P A Q = L D U with rook pivoting, in place and without allocation, for `cd_newton`.

The absolute value of a rook pivot is the largest in its row and in its column. Rook pivoting is nearly as stable as
complete pivoting, and costs about as much as partial pivoting (Poole & Neal, "The rook's pivoting strategy", J. Comput.
Appl. Math. 123, 2000).
"""

from ..compile.jit import element


@element
def largest_in_column(a, n, column, first):
    row = first
    for i in range(first + 1, n):
        if abs(a[i, column]) > abs(a[row, column]):
            row = i
    return row


@element
def largest_in_row(a, n, row, first):
    column = first
    for j in range(first + 1, n):
        if abs(a[row, j]) > abs(a[row, column]):
            column = j
    return column


@element
def rook_pivot(a, n, k):
    """Find the pivot: go to the largest entry of a column, then of a row, and so on, until neither search moves."""
    column = k
    row = largest_in_column(a, n, column, k)
    while True:
        next_column = largest_in_row(a, n, row, k)
        if not abs(a[row, next_column]) > abs(a[row, column]):  # `not >` instead of `<=` ends the search at a NaN
            return row, column
        column = next_column
        next_row = largest_in_column(a, n, column, k)
        if not abs(a[next_row, column]) > abs(a[row, column]):
            return row, column
        row = next_row


@element
def factorise(a, n, row_swaps, column_swaps):
    """Factorise the n x n matrix `a` in place; return False if it is singular or contains a NaN.

    Below the diagonal, `a` then holds L, and above it U, both without their diagonals of ones. The diagonal holds 1/D.
    The swaps of rows and columns are stored as floats in two arrays of length n.
    """
    for k in range(n):
        row, column = rook_pivot(a, n, k)
        row_swaps[k], column_swaps[k] = row, column
        if row != k:
            for j in range(n):
                a[k, j], a[row, j] = a[row, j], a[k, j]
        if column != k:
            for i in range(n):
                a[i, k], a[i, column] = a[i, column], a[i, k]
        if not abs(a[k, k]) > 0:  # zero, or a NaN
            return False
        inverse = 1 / a[k, k]
        a[k, k] = inverse
        for i in range(k + 1, n):
            a[i, k] *= inverse
            for j in range(k + 1, n):
                a[i, j] -= a[i, k] * a[k, j]
        for j in range(k + 1, n):
            a[k, j] *= inverse
    return True


@element
def solve(a, n, row_swaps, column_swaps, b):
    """Overwrite `b` with the solution x of A x = b, where `a` and the swaps are the result of `factorise`."""
    for k in range(n):
        row = int(row_swaps[k])
        if row != k:
            b[k], b[row] = b[row], b[k]
    for i in range(n):
        for j in range(i):
            b[i] -= a[i, j] * b[j]
    for i in range(n):
        b[i] *= a[i, i]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            b[i] -= a[i, j] * b[j]
    for k in range(n - 1, -1, -1):
        column = int(column_swaps[k])
        if column != k:
            b[k], b[column] = b[column], b[k]
