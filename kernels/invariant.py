"""Follow an invariant along rows of states: max |e(t_i, u_i, v_i, p) - e0|, a NaN kept once met."""

from .jit import element


@element
def farther(worst, e, e0):
    distance = abs(e - e0)
    # a NaN compares false with everything, so it needs a test of its own to get in, and none to stay
    return distance if distance > worst or distance != distance else worst


def drift(invariant, e0, t0, h, p, first, u_rows, v_rows):
    worst = 0.0
    for i in range(len(u_rows)):
        worst = farther(worst, invariant(t0 + (first + i) * h, u_rows[i], v_rows[i], p), e0)
    return worst
