"""The base class of torques on rigid bodies."""

from __future__ import annotations

from typing import ClassVar

from .effect import Body


class BodyTorque(Body):
    """A torque on a rigid body, applied as forces on its unit vectors, the points of ``body.axes``."""

    takes: ClassVar[tuple[int, ...]] = (1,)
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    source: ClassVar[str] = "the forces torque x e / 2 on the unit vectors e of the body"
