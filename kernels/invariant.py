"""Follow an invariant along rows of states: the least and the largest e(t_i, u_i, v_i, p), a NaN kept once met."""


def extent(invariant, t0, h, p, first, u_rows, v_rows):
    low = high = invariant(t0 + first * h, u_rows[0], v_rows[0], p)
    for i in range(1, len(u_rows)):
        e = invariant(t0 + (first + i) * h, u_rows[i], v_rows[i], p)
        # a NaN compares false with everything, so it needs a test of its own to get in, and none to stay
        if e < low or e != e:
            low = e
        if e > high or e != e:
            high = e
    return low, high
