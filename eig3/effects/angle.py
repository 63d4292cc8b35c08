"""The kind of effects on the angle of three points."""

import math

from ..kernels.compile.jit import element
from ..scene.cell import Cell, offers_of
from .vector import add, cross, dot, norm, scale, subtract, turn

TINY = 2.0**-1000  # avoids 0 / 0 where the points are in line; too small to change other values


@element
def angle(x):
    a, b = subtract(x[0], x[1]), subtract(x[2], x[1])
    return math.atan2(norm(turn(a, b)), dot(a, b))


@element
def turned(x, torque):
    a, b = subtract(x[0], x[1]), subtract(x[2], x[1])
    normal = turn(a, b)
    axis = scale(1 / math.sqrt(TINY + dot(normal, normal)), normal)
    first, last = scale(torque / dot(a, a), cross(axis, a)), scale(-torque / dot(b, b), cross(axis, b))
    return first, scale(-1.0, add(first, last)), last


@element
def angular_rate(x, v):
    first, middle, last = turned(x, 1.0)
    return -dot(first, v[0]) - dot(middle, v[1]) - dot(last, v[2])


class Angle(Cell):
    """An effect of the angle at the second of three points, between the directions to the first and to the third.

    A class has ``torque``, the derivative of the potential with respect to the angle: a positive torque makes the angle
    smaller. It may have ``potential``, an energy. Their arguments can be the angle theta, rad, from 0 to pi, the rate
    at which it grows, rate, and fields; the torque can take the time t. See `Body` for `vectors`, `arrays` and
    `nonnegative`.

    It corresponds to a ``CustomAngleForce`` of OpenMM and ``angle_style lepton`` of LAMMPS.

    The forces are perpendicular to the two directions. Where the three points are in line they are 0, which is their
    limit if the torque is 0 there.
    """

    takes = (3,)
    dimensions = (2, 3)
    variable, conjugate = "theta", "torque"
    offers = offers_of(variable, conjugate)
    needs = (conjugate,)
    value, rate, forces = angle, angular_rate, turned

    def check_points(self, masses, positions, columns):
        super().check_points(masses, positions, columns)
        first, middle, last = positions
        for end, point in (("first", first), ("last", last)):
            what = f"has no angle where the {end} of its points is at the middle one"
            self.refuse_cells((point == middle).all(axis=-1), what, "put them apart")
