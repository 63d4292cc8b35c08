"""Contacts of points with radii, which touch where their distance is the sum of their radii."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..scene.effect import Link


class Touching(Link):
    """A contact with the fields contact_distance and radii, of which the user gives one."""

    contact_distance: ArrayLike | None
    radii: ArrayLike | None

    def touch(self) -> None:
        """Take the contact distance from the radii, if they are given."""
        if self.radii is not None:
            radii = self._reals("radii")
            self.require(radii >= 0, "radii must not be negative")
            if self.contact_distance is not None and not np.array_equal(self.contact_distance, 2 * radii):
                raise TypeError(f"contact_distance and radii of {self.title} exclude each other: give one of them.")
            object.__setattr__(self, "contact_distance", 2 * radii)  # the record is frozen
        elif self.contact_distance is None:
            raise TypeError(f"{self.title} needs the radii of its points, or the contact_distance: give one of them.")

    def of_groups(self, groups: int) -> Any:
        """Return the contact between points with these radii, and a group of others if there are two groups."""
        if groups == 1 or self.radii is None:
            return self
        other = copy.copy(self)
        object.__setattr__(other, "contact_distance", self._reals("radii") + self._radius_of_others())
        return other

    def _radius_of_others(self) -> float:
        radii = self._reals("radii")
        if radii.ndim:
            raise ValueError(
                f"{self.title} does not know the radius of the others, because its points have several: give "
                "contact_distance, the sum of the radii of a point and of the others."
            )
        return float(radii)
