"""A linear spring between two points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..scene.effect import Link


@element
def tension(r, stiffness, rest_length):
    return stiffness * (r - rest_length)


@element
def potential(r, stiffness, rest_length):
    return stiffness / 2 * (r - rest_length) * (r - rest_length)


@element
def density_without_rest_length(stiffness):
    return stiffness


@element
def potential_without_rest_length(r, stiffness):
    return stiffness / 2 * r * r


@dataclass(frozen=True, eq=False)
class LinearSpring(Link):
    """A linear spring between two points.

    Formula: tension = stiffness (r - rest_length); energy = stiffness / 2 (r - rest_length)^2; r is the distance of the
    ends.

    Without a rest length the scene computes no distance, which makes the spring cheaper.

    Parameters
    ----------
    stiffness : float or array_like
        N/m.
    rest_length : float or array_like
        m.

    Raises
    ------
    ValueError
        For stiffness or rest_length below 0.

    Notes
    -----
    Other codes: OpenMM ``HarmonicBondForce`` with k = stiffness; LAMMPS ``bond_style harmonic`` with K = stiffness / 2;
    MuJoCo: a spatial tendon with ``stiffness`` and ``springlength``; OpenSees: a ``corotTruss`` with E A / L =
    stiffness; exudyn ``ObjectConnectorSpringDamper``; Modelica ``Forces.Spring``.

    Not included: damping: add a `LinearDamper`.
    """

    stiffness: ArrayLike
    rest_length: ArrayLike = 0.0

    nonnegative = ("stiffness",)
    source = "Hooke"
    picture = "spring"

    @property
    def tension(self):
        return tension if np.any(self.rest_length) else None

    @property
    def force_density(self):
        return None if np.any(self.rest_length) else density_without_rest_length

    @property
    def potential(self):
        return potential if np.any(self.rest_length) else potential_without_rest_length
