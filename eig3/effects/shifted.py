"""Forces between two points that end smoothly at a distance, the cutoff.

The shifted force of molecular dynamics: the tension minus its value at the cutoff, and the energy of this force. Both
are 0 beyond the cutoff, so that neither the force nor the energy jumps there.
"""

import numpy as np

from ..kernels.compile.jit import element
from ..scene.effect import Link


@element
def shifted_tension(r, cutoff, tension, pull_at_cutoff):
    return tension - pull_at_cutoff if r < cutoff else 0.0


@element
def shifted_potential(r, cutoff, potential, pull_at_cutoff, energy_at_cutoff):
    return potential - energy_at_cutoff - (r - cutoff) * pull_at_cutoff if r < cutoff else 0.0


class Shifted(Link):
    """A link with the fields cutoff, pull_at_cutoff and energy_at_cutoff; `_shift` computes the last two.

    With a cutoff of None, the force acts at all distances, and nothing is shifted.
    """

    picture = ""

    @property
    def cutoff_field(self):
        return "" if self.cutoff is None else "cutoff"

    def needs_direction(self, columns):
        return True

    def _shift(self, tension, potential, *given):
        """Compute the tension and the potential at the cutoff from functions of the cutoff and of fields."""
        if self.cutoff is None:
            return
        cutoff, *values = (self._reals(name) for name in ("cutoff", *given))
        self.require(cutoff > 0, "cutoff must be positive")
        for name, function in (("pull_at_cutoff", tension), ("energy_at_cutoff", potential)):
            object.__setattr__(self, name, np.vectorize(function, otypes=[float])(cutoff, *values))  # a frozen record
