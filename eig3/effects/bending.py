"""The kind of effects on the angle between two triangles with a common edge."""

import math

import numpy as np

from ..kernels.compile.jit import element
from ..scene.cell import Cell, offers_of
from .dihedral import sides, twist_rate, twisted


@element
def bend(x):
    sine, cosine = sides(x)
    return math.atan2(-sine, -cosine)  # two triangles are flat where their four corners are trans


class Bending(Cell):
    """An effect of the angle between two triangles that meet at an edge.

    The four points are the corner of the first triangle, the two ends of the edge, and the corner of the second; the
    function `eig3.scene.hinges` finds them in a mesh.

    A class has ``torque``, the derivative of the potential with respect to the angle, and may have ``potential``, an
    energy. Their arguments can be the angle theta, rad, the rate at which it grows, rate, fields, and two numbers of
    the shape at rest: rest_angle, and aspect, the square of the edge divided by the area of both triangles. The torque
    can take the time t. See `Body` for `vectors`, `arrays` and `nonnegative`.

    The angle is 0 where the triangles are flat and nears pi or -pi where they are folded onto each other.
    """

    takes = (4,)
    dimensions = (3,)
    variable, conjugate = "theta", "torque"
    shape = {"rest_angle": 0, "aspect": 0}  # noqa: RUF012, as in the base class
    offers = offers_of(variable, conjugate, read=tuple(shape))
    needs = (conjugate,)
    value, rate, forces = bend, twist_rate, twisted

    def shape_columns(self, rest):
        edge = rest[2] - rest[1]
        normals = [np.cross(corner - rest[1], edge) for corner in (rest[0], rest[3])]
        areas = [np.linalg.norm(normal, axis=-1) / 2 for normal in normals]
        squares = [np.sum((rest[i] - rest[j]) ** 2, axis=-1) for i, j in ((0, 1), (0, 2), (1, 2), (1, 3), (2, 3))]
        self.refuse_cells(
            np.minimum(*areas) <= 1e-9 * np.max(squares, axis=0),
            "has a triangle without area at rest",
            "move a corner of each",
        )
        angles = np.array([bend(tuple(map(tuple, points))) for points in np.stack(rest, axis=1)])
        return {"rest_angle": angles, "aspect": np.sum(edge**2, axis=-1) / (areas[0] + areas[1])}
