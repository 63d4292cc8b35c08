"""A uniform field of gravity."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..scene.effect import Body
from .vector import dot


@dataclass(frozen=True, eq=False)
class Gravity(Body):
    """Uniform gravity: the same acceleration for every mass.

    Formula: force = m field; energy = -m field . x.

    Parameters
    ----------
    field : array_like, shape (dimension,)
        The acceleration, m/s^2, such as ``(0, -9.81)``.

    Notes
    -----
    Other codes: LAMMPS ``fix gravity``, MuJoCo ``option gravity``, exudyn ``LoadMassProportional``, Modelica
    ``World.g``. In OpenSees, weights are nodal loads.

    Not included: the attraction between masses: that is `Coulomb` with the prefactor -G m1 m2.
    """

    field: ArrayLike

    vectors = ("field",)
    source = "Newton"
    picture = "weight"

    @staticmethod
    @element
    def acceleration(field):
        return field

    @staticmethod
    @element
    def potential(x, m, field):
        return -m * dot(field, x)
