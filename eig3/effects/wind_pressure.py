"""The force of wind on surfaces."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..scene.cell import Cell
from .vector import add, dot, norm, scale, subtract, turn


@dataclass(frozen=True, eq=False)
class WindPressure(Cell):
    """The pressure of air, still or in motion, on both sides of a triangle of a sheet.

    Formula: force = coefficient density / 2 (w . n)^2 area along the normal n on the leeward side, with w = wind - v
    and the velocity v of the middle of the triangle.

    Parameters
    ----------
    density : float or array_like
        Of the air, kg/m^3.
    wind : array_like, shape (3,) or (..., 3)
        Velocity of the air, m/s.
    coefficient : float or array_like
        Coefficient of pressure: the difference of the pressures on the two sides divided by density / 2 |w|^2, for w
        along the normal.

    Raises
    ------
    ValueError
        For density or coefficient below 0.

    Notes
    -----
    Other codes: none in LAMMPS, OpenMM and OpenSees. MuJoCo's ``wind`` and ``density`` act on the boxes or ellipsoids
    of bodies.

    Not included: friction along the sheet, lift, and the wake: triangles do not shield each other.
    """

    density: ArrayLike
    wind: ArrayLike
    coefficient: ArrayLike = 1.0

    takes = (3,)
    dimensions = (3,)
    vectors = ("wind",)
    nonnegative = ("density", "coefficient")
    source = "pressure of the velocity across the sheet, as in computer graphics"

    @staticmethod
    @element
    def forces(x, v, density, wind, coefficient):
        normal = turn(subtract(x[1], x[0]), subtract(x[2], x[0]))  # its length is twice the area
        along = dot(subtract(wind, scale(1 / 3, add(v[0], add(v[1], v[2])))), normal)
        length = norm(normal)
        push = coefficient * density * along * abs(along) / (12 * length * length) if length > 0 else 0.0
        force = scale(push, normal)
        return force, force, force
