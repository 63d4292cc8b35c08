"""The angle from a vector to another one, in the plane or about an axis, and its gradient."""

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
