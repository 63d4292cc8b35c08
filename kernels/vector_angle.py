"""The angle from a vector to another one, in the plane or about an axis: its gradient, its rate, and its torque."""

import math

from .compile.jit import element


@element
def angle_in_plane(x0, x1):
    return math.atan2(x1[0] * x0[1] - x1[1] * x0[0], x1[0] * x0[0] + x1[1] * x0[1])


@element
def slope_in_plane(x0, x1):
    first, second = 1 / (x0[0] * x0[0] + x0[1] * x0[1]), 1 / (x1[0] * x1[0] + x1[1] * x1[1])
    return -x0[1] * first, x0[0] * first, x1[1] * second, -x1[0] * second


@element
def product(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@element
def sine_and_cosine(x0, x1, x2):
    way = product(x1, x0)
    return way[0] * x2[0] + way[1] * x2[1] + way[2] * x2[2], x0[0] * x1[0] + x0[1] * x1[1] + x0[2] * x1[2]


@element
def angle_in_space(x0, x1, x2):
    sine, cosine = sine_and_cosine(x0, x1, x2)
    return math.atan2(sine, cosine)


@element
def slope_in_space(x0, x1, x2):
    sine, cosine = sine_and_cosine(x0, x1, x2)
    square = sine * sine + cosine * cosine
    c, s = cosine / square, sine / square
    a, b, w = product(x2, x1), product(x0, x2), product(x1, x0)
    return (
        *(c * a[0] - s * x1[0], c * a[1] - s * x1[1], c * a[2] - s * x1[2]),
        *(c * b[0] - s * x0[0], c * b[1] - s * x0[1], c * b[2] - s * x0[2]),
        *(c * w[0], c * w[1], c * w[2]),
    )


@element
def rate_in_plane(x, v):
    """Return the rate at which the first of two vectors turns against the second one."""
    (e, g), (e_rate, g_rate) = x, v
    return e[0] * e_rate[1] - e[1] * e_rate[0] - g[0] * g_rate[1] + g[1] * g_rate[0]


@element
def couple_in_plane(x, torque):
    """Return the forces of a torque on the first vector, and of the opposite one on the second."""
    e, g = x
    return (-torque * e[1], torque * e[0]), (torque * g[1], -torque * g[0])


@element
def rate_in_space(x, v):
    """Return the rate at which the first of two vectors turns against the second one about the third, an axis."""
    e, g, axis = x
    mine, theirs = product(e, v[0]), product(g, v[1])
    return axis[0] * (mine[0] - theirs[0]) + axis[1] * (mine[1] - theirs[1]) + axis[2] * (mine[2] - theirs[2])


@element
def couple_in_space(x, torque):
    e, g, axis = x
    a, b = product(axis, e), product(axis, g)
    return (
        (torque * a[0], torque * a[1], torque * a[2]),
        (-torque * b[0], -torque * b[1], -torque * b[2]),
        (0.0, 0.0, 0.0),
    )
