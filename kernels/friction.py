"""The torque of friction in a hinge, as forces on unit vectors across its axis, one in each of two bodies."""

import math

from .compile.jit import element
from .vector_angle import product


@element
def torque_of_friction(rate, limit, damping, regularization_speed):
    return -(limit / math.sqrt(rate * rate + regularization_speed * regularization_speed) + damping) * rate


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
def friction_in_plane(x, v, limit, damping, regularization_speed):
    return couple_in_plane(x, torque_of_friction(rate_in_plane(x, v), limit, damping, regularization_speed))


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


@element
def friction_in_space(x, v, limit, damping, regularization_speed):
    return couple_in_space(x, torque_of_friction(rate_in_space(x, v), limit, damping, regularization_speed))
