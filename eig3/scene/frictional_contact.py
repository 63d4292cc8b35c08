"""The base class of frictional contacts between grains, which may rotate."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from .effect import Link

_OF_CONTACT = ("t", "r", "rate", "radius", "mass")


class FrictionalContact(Link):
    """A frictional contact between near points, with a tangential spring.

    A class has ``tension``, the normal force as for a `Link`, and ``shear_stiffness``, the stiffness k of the
    tangential spring, N/m. It may have ``shear_damping``, N s/m. Every class has the fields contact_distance, at which
    two points touch, and friction. The arguments can be the time t, the distance r, its time derivative rate, the
    effective radius, radius = R1 R2 / (R1 + R2), the effective mass, mass = m1 m2 / (m1 + m2), and fields.

    The rate of the spring force is k times the relative velocity of the surfaces. If k decreases, the force is reduced
    in proportion. The spring ends with the contact. Spring force and damping together are limited to friction times the
    normal force. The springs are the history of the run, and advance at the end of each step: `eig3.kernels.grains` has
    the formulas. They rotate with the line through the points, but not about it.

    The contact distance of a point of one group is its diameter. `others` must be fixed points, which have the radius
    wall_radius; the points then have the radius contact_distance - wall_radius.
    """

    offers: ClassVar[dict[str, tuple[str, ...]]] = {
        **dict.fromkeys(("tension", "shear_stiffness", "shear_damping"), _OF_CONTACT),
    }
    needs: ClassVar[tuple[str, ...]] = ("tension",)
    cutoff_field: ClassVar[str] = "contact_distance"
    mixed: ClassVar[tuple[str, ...] | Mapping[str, str]] = ("contact_distance",)
    picture: ClassVar[str] = "discs"
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)

    def check(self, dimension: int) -> None:
        super().check(dimension)
        if "shear_stiffness" not in self.functions():
            raise TypeError(f"{self.title} must have a function shear_stiffness.")
        if "friction" not in self._read():
            raise TypeError(f"{self.title} must have a field friction.")

    def check_group(self, pair_force: Any, cloud: Any) -> None:
        if (cloud.masses[pair_force.second] > 0).any():
            raise ValueError(f"others of {self.title} must be fixed points; give all masses in the first array.")

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
