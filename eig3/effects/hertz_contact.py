"""Contact between two points, such as the centres of balls."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from .hertz import damped_push, push, stored
from .touching import Touching


@element
def elastic(r, stiffness, contact_distance):
    return -push(contact_distance - r, stiffness)


@element
def damped(r, rate, stiffness, contact_distance, damping):
    return -damped_push(contact_distance - r, -rate, stiffness, damping)


@element
def elastic_potential(r, stiffness, contact_distance):
    return stored(contact_distance - r, stiffness)


@dataclass(frozen=True, eq=False)
class HertzContact(Touching):
    """Hertz's contact between two masses, or between a mass and a fixed point, with the damping of Hunt and Crossley.

    Formula: push = stiffness d^(3/2) (1 + damping d') at the indentation d = contact_distance - r > 0 with the rate d',
    and 0 where d or the bracket is negative. The contact_distance is the sum of the two radii. Without damping, energy
    = 2/5 stiffness d^(5/2).

    Pairs that do not touch cost little, so that a scene can have a contact between all pairs of some hundreds of
    masses.

    Parameters
    ----------
    stiffness : float or array_like
        N/m^(3/2).
    contact_distance : float or array_like
        The distance at which they touch, the sum of the two radii, m. Between all pairs of points: their diameters.
    damping : float or array_like
        s/m; 0 makes the contact elastic.
    radii : float or array_like
        In place of contact_distance: the radius of each point, or of all, m. A pair touches at the sum of its radii.

    Raises
    ------
    TypeError, ValueError
        For stiffness, contact_distance, radii or damping below 0, and without one of contact_distance and radii.

    Notes
    -----
    Other codes: without damping, the normal force of LAMMPS ``pair_style gran/hertz/history`` with Kn = stiffness /
    sqrt(R) and the effective radius R = R1 R2 / (R1 + R2). Its viscoelastic damping is another law. exudyn:
    ``ObjectContactSphereSphere`` with contactStiffnessExponent = 1.5.

    Not included: friction and the rotation of the bodies, as in `HertzMindlin`; a coefficient of restitution as a
    parameter: with this damping, restitution falls with the speed of the impact.
    """

    stiffness: ArrayLike
    contact_distance: ArrayLike | None = None
    damping: ArrayLike = 0.0
    radii: ArrayLike | None = field(default=None, kw_only=True)

    nonnegative = ("stiffness", "contact_distance", "damping")
    cutoff_field = "contact_distance"
    mixed = ("stiffness", "contact_distance", "damping")
    source = "Hertz (1881); damping of Hunt and Crossley (1975)"
    picture = "discs"

    def __post_init__(self) -> None:
        self.touch()
        super().__post_init__()

    def needs_direction(self, columns):
        return True

    @property
    def tension(self):
        return damped if np.any(self.damping) else elastic

    @property
    def potential(self):
        return None if np.any(self.damping) else elastic_potential
