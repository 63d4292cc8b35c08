"""The kind of effects on the dihedral angle of four points."""

import math

import numpy as np

from ..kernels.compile.jit import element
from ..scene.cell import Cell, offers_of
from .vector import add, dot, norm, scale, subtract, turn

_IN_LINE = 1e-12  # the sine of an angle that is round-off


@element
def sides(x):
    """Return the sine and the cosine of the dihedral angle, times the lengths of the two normals."""
    f, g, h = subtract(x[0], x[1]), subtract(x[1], x[2]), subtract(x[3], x[2])
    a, b = turn(f, g), turn(h, g)
    return dot(turn(b, a), g) / norm(g), dot(a, b)


@element
def dihedral_angle(x):
    sine, cosine = sides(x)
    return math.atan2(sine, cosine)


@element
def twisted(x, torque):
    """Blondel and Karplus (1996), equation 27: no term is large where the angle is near 0 or pi."""
    f, g, h = subtract(x[0], x[1]), subtract(x[1], x[2]), subtract(x[3], x[2])
    a, b = turn(f, g), turn(h, g)
    axis = norm(g)
    u, w = scale(torque / dot(a, a), a), scale(torque / dot(b, b), b)
    first, last = scale(axis, u), scale(-axis, w)
    middle = subtract(scale(dot(f, g) / axis, u), scale(dot(h, g) / axis, w))
    return first, scale(-1.0, add(first, middle)), subtract(middle, last), last


@element
def twist_rate(x, v):
    first, second, third, last = twisted(x, 1.0)
    return -dot(first, v[0]) - dot(second, v[1]) - dot(third, v[2]) - dot(last, v[3])


class Dihedral(Cell):
    """An effect of the dihedral angle of four points in space: of a chain, the angle of torsion of its middle link.

    A class has ``torque``, the derivative of the potential with respect to the angle, and may have ``potential``, an
    energy. Their arguments can be the angle phi, rad, from -pi to pi, the rate at which it grows, rate, and fields; the
    torque can take the time t. See `Body` for `vectors`, `arrays` and `nonnegative`.

    It corresponds to a ``CustomTorsionForce`` of OpenMM and ``dihedral_style lepton`` of LAMMPS.

    The angle is 0 where the first and the last point are on the same side (cis), and pi where they are on opposite
    sides (trans). It is positive if, seen along the middle link, the last point is clockwise of the first, as IUPAC
    defines it. No three consecutive points may be in line.
    """

    takes = (4,)
    dimensions = (3,)
    variable, conjugate = "phi", "torque"
    offers = offers_of(variable, conjugate)
    needs = (conjugate,)
    value, rate, forces = dihedral_angle, twist_rate, twisted

    def check_points(self, masses, positions, columns):
        super().check_points(masses, positions, columns)
        for which, (a, b, c) in (("first", positions[:3]), ("last", positions[1:])):
            normal, sizes = np.cross(b - a, c - b), np.linalg.norm(b - a, axis=-1) * np.linalg.norm(c - b, axis=-1)
            in_line = np.linalg.norm(normal, axis=-1) <= _IN_LINE * sizes
            self.refuse_cells(in_line, f"has no angle where the {which} three of its points are in line", "move one")
