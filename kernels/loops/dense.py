"""Dense output: u and v within a step, as polynomials in the fraction s of the step.

The first half of the rows of the coefficients belongs to u, and the second half to v. Their number depends on the pair.
"""

from ..compile.jit import element, outlined

QUINTIC_TERMS = 6
_FEW = 4  # degrees of freedom whose sums are kept in registers


@element
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
        for k, c in enumerate((u[j], h * v[j], c2, c3, c4, c5)):
            coefficients[k, j] = c
        for k, c in enumerate((v[j], h * a[j], 3 * c3 / h, 4 * c4 / h, 5 * c5 / h, 0.0)):
            coefficients[QUINTIC_TERMS + k, j] = c


@outlined
def evaluate(coefficients, s, n, u, v):
    """Write u and v after the fraction s of the step."""
    terms = coefficients.shape[0] // 2
    if n <= _FEW:
        for j in range(n):
            u_sum, v_sum = coefficients[terms - 1, j], coefficients[2 * terms - 1, j]
            for k in range(terms - 2, -1, -1):
                u_sum, v_sum = u_sum * s + coefficients[k, j], v_sum * s + coefficients[terms + k, j]
            u[j], v[j] = u_sum, v_sum
        return
    for j in range(n):
        u[j], v[j] = coefficients[terms - 1, j], coefficients[2 * terms - 1, j]
    for k in range(terms - 2, -1, -1):  # this order of the loops can be vectorised
        for j in range(n):
            u[j] = u[j] * s + coefficients[k, j]
        for j in range(n):
            v[j] = v[j] * s + coefficients[terms + k, j]


@outlined
def write_up_to(shorter, coefficients, s, n):
    """Write the polynomials of the part of the step before its fraction s."""
    terms = coefficients.shape[0] // 2
    for j in range(n):
        power = 1.0
        for k in range(terms):
            shorter[k, j] = coefficients[k, j] * power
            shorter[terms + k, j] = coefficients[terms + k, j] * power
            power *= s
