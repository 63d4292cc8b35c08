"""A torque on a rigid body."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..scene.body_torque import BodyTorque
from .vector import cross, scale


@dataclass(frozen=True, eq=False)
class Torque(BodyTorque):
    """A constant torque, which acts on the axes of a rigid body: ``scene.add(Torque(3.0), body.axes)``.

    Formula: the torque of forces torque x e / 2 on the unit vectors e of the body, whose sum is 0.

    Add the opposite torque to another body for a motor between both. `Motor` has a torque that depends on the time.

    Parameters
    ----------
    torque : float or array_like, shape (3,)
        N m; in space a vector in the frame of the scene.

    Raises
    ------
    TypeError
        By `Scene.add`, for other points than the axes of one body.

    Notes
    -----
    Other codes: MuJoCo: the torque of ``xfrc_applied``; exudyn ``LoadTorqueVector``; Modelica ``Forces.WorldTorque``.

    Not included: a torque that turns with the body.
    """

    torque: ArrayLike

    vectors = ("torque",)

    def components(self, vector, dimension):
        return 1 if dimension == 2 else 3

    @staticmethod
    @element
    def force(x, torque):
        return scale(0.5, cross(torque, x))
