"""A torque on a rigid body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..scene.effect import Body


@element
def across_plane(x, torque):
    return -0.5 * torque[0] * x[1], 0.5 * torque[0] * x[0]


@element
def across_space(x, torque):
    a, b, c = torque
    return 0.5 * (b * x[2] - c * x[1]), 0.5 * (c * x[0] - a * x[2]), 0.5 * (a * x[1] - b * x[0])


@dataclass(frozen=True, eq=False)
class Torque(Body):
    """A constant torque, which acts on the axes of a rigid body: ``scene.add(Torque(3.0), body.axes)``.

    Add the opposite torque to another body for a motor between both.

    Parameters
    ----------
    torque : float or array_like, shape (3,)
        N m; in space a vector in the frame of the scene.
    """

    torque: ArrayLike

    dimensions = (2, 3)
    vectors = ("torque",)
    source = "the forces torque x e / 2 on the unit vectors e of the body"

    def components(self, vector: str, dimension: int) -> int:
        return 1 if dimension == 2 else 3

    @property
    def force(self):
        return across_plane if np.size(self.torque) == 1 else across_space
