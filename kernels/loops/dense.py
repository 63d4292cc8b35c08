"""Dense output: u and v within a step, as polynomials in the fraction s of the step.

A row k of the coefficients belongs to u for k < TERMS, and to v from there on.
"""

from ..compile.jit import outlined

TERMS = 8  # degree 7, that of RK8's continuous extension
COEFFICIENTS = 2 * TERMS


@outlined
def quintic(h, n, u, v, a, u_b, v_b, a_b, coefficients):
    """Write the polynomial of degree 5 through u, v and a at both ends of a step; v is its derivative.

    Its error is of sixth order in u, and of fifth order in v.
    """
    for j in range(n):
        rise = u_b[j] - u[j]
        c2 = h * h / 2 * a[j]
        c3 = 10 * rise - h * (6 * v[j] + 4 * v_b[j]) - h * h / 2 * (3 * a[j] - a_b[j])
        c4 = h * (8 * v[j] + 7 * v_b[j]) - 15 * rise + h * h / 2 * (3 * a[j] - 2 * a_b[j])
        c5 = 6 * rise - 3 * h * (v[j] + v_b[j]) - h * h / 2 * (a[j] - a_b[j])
        for k, c in enumerate((u[j], h * v[j], c2, c3, c4, c5, 0.0, 0.0)):
            coefficients[k, j] = c
        for k, c in enumerate((v[j], h * a[j], 3 * c3 / h, 4 * c4 / h, 5 * c5 / h, 0.0, 0.0, 0.0)):
            coefficients[TERMS + k, j] = c


@outlined
def evaluate(coefficients, s, n, u, v):
    """Write u and v after the fraction s of the step."""
    for j in range(n):
        u[j], v[j] = coefficients[TERMS - 1, j], coefficients[COEFFICIENTS - 1, j]
    for k in range(TERMS - 2, -1, -1):  # this order of the loops can be vectorised
        for j in range(n):
            u[j] = u[j] * s + coefficients[k, j]
        for j in range(n):
            v[j] = v[j] * s + coefficients[TERMS + k, j]


@outlined
def write_up_to(shorter, coefficients, s, n):
    """Write the polynomials of the part of the step before its fraction s."""
    for j in range(n):
        power = 1.0
        for k in range(TERMS):
            shorter[k, j] = coefficients[k, j] * power
            shorter[TERMS + k, j] = coefficients[TERMS + k, j] * power
            power *= s
