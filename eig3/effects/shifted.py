"""Forces between two points that end smoothly at a distance, the reach.

The shifted force of molecular dynamics: the tension less its value at the reach, and the potential that belongs to it.
Both are 0 from there on, so that neither the force nor the energy jumps where a pair parts.
"""

import numpy as np

from ..kernels.compile.jit import element
from ..scene.effect import Link


@element
def shifted_tension(r, reach, tension, pull_at_reach):
    return tension - pull_at_reach if r < reach else 0.0


@element
def shifted_potential(r, reach, potential, pull_at_reach, energy_at_reach):
    return potential - energy_at_reach - (r - reach) * pull_at_reach if r < reach else 0.0


class Shifted(Link):
    """A link with the fields reach, and pull_at_reach and energy_at_reach, which are computed by `_shift`."""

    cutoff = "reach"
    picture = ""

    def needs_direction(self, columns):
        return True

    def _shift(self, tension, potential, *given):
        """Compute the tension and the potential at the reach from functions of the reach and of fields."""
        reach, *values = (self._reals(name) for name in ("reach", *given))
        self.require(reach > 0, "reach must be positive")
        for name, function in (("pull_at_reach", tension), ("energy_at_reach", potential)):
            object.__setattr__(self, name, np.vectorize(function, otypes=[float])(reach, *values))  # a frozen record
