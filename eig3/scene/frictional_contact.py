"""The base class of contacts with friction, between grains that may spin."""

from __future__ import annotations

from typing import Any, ClassVar

from .effect import Link

_OF_CONTACT = ("t", "r", "rate", "radius", "mass")


class FrictionalContact(Link):
    """A contact with friction between near points, with a spring along the surfaces that touch.

    A class has ``tension``, the force along the line through the points as for a `Link`, and ``shear_stiffness``, the
    stiffness k of the spring along the surfaces, N/m. It may have ``shear_damping``, N s/m. The fields
    contact_distance, at which two points touch, and friction belong to every such class. The arguments can be the time
    t, the distance r, the rate at which r grows, rate, the effective radius of the two, radius, which is
    R1 R2 / (R1 + R2), their effective mass, mass, which is m1 m2 / (m1 + m2), and fields.

    The force of the spring grows as k times the relative velocity of the surfaces, falls with k, and ends with the
    contact. With the damping, it is at most friction times the force that pushes the points apart. The springs belong
    to the run, and go on to the state at the end of each step: `eig3.kernels.grains` has the formulas. They are turned
    with the line through the points, but not about it.

    Points of one group touch at half the sum of their contact distances, which are their diameters. `others` must be
    fixed points, which have the radius wall_radius; the points then have the radius contact_distance - wall_radius.
    """

    offers: ClassVar[dict[str, tuple[str, ...]]] = {
        **dict.fromkeys(("tension", "shear_stiffness", "shear_damping"), _OF_CONTACT),
    }
    needs: ClassVar[tuple[str, ...]] = ("tension",)
    cutoff_field: ClassVar[str] = "contact_distance"
    mixed: ClassVar[tuple[str, ...]] = ("contact_distance",)
    picture: ClassVar[str] = "discs"
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)

    def check(self, dimension: int) -> None:
        super().check(dimension)
        if "shear_stiffness" not in self.functions():
            raise TypeError(f"{self.title} must have a function shear_stiffness.")
        if "friction" not in self._read():
            raise TypeError(f"{self.title} must have a field friction.")

    def reads_velocity(self) -> bool:
        return True

    def needs_direction(self, columns: dict[str, Any]) -> Any:
        return True

    def _read(self) -> list[str]:
        known = getattr(type(self), "__dataclass_fields__", {})
        return [
            name
            for name in known
            if name in super(FrictionalContact, self)._read() or name in ("friction", "wall_radius")
        ]
