"""A string that breaks."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..scene.effect import Link, distance


@dataclass(frozen=True, eq=False)
class BreakingString(Link):
    """A linear spring that breaks where its tension reaches its strength.

    Formula: tension = stiffness (r - rest_length) until it reaches the strength, and 0 from then on; r is the distance
    of the ends.

    The break is an event: ``solution.events["breaking string 0"]`` has its time. The degree of freedom "breaking string
    0" of the problem is 0 while the string is whole and 1 after. The elastic energy is lost at the break.

    Parameters
    ----------
    stiffness : float or array_like
        N/m.
    rest_length : float or array_like
        m.
    strength : float or array_like
        The largest tension, N.

    Raises
    ------
    ValueError
        For stiffness, rest_length or strength below 0, or a tension at the start that is not below the strength.

    Notes
    -----
    Other codes: OpenSees: a truss with ``uniaxialMaterial MinMax`` around ``Elastic``. LAMMPS: ``fix bond/break`` with
    Rmax = rest_length + strength / stiffness, which tests the distance every N steps; here the time is found within a
    step.

    Not included: damping, healing, and a loss of stiffness before the break. The string also pushes, below its rest
    length. `Breaking` breaks other laws, and at a stretch or an energy.
    """

    stiffness: ArrayLike
    rest_length: ArrayLike
    strength: ArrayLike

    nonnegative = ("stiffness", "strength")
    crossing = 1
    at_start = "strength must be above the tension at the start"
    source = "Hooke, up to a strength"
    picture = "string"

    def check_points(self, masses, positions, columns):
        super().check_points(masses, positions, columns)
        pull = columns["stiffness"] * (distance(positions) - columns["rest_length"])
        self.require(pull < columns["strength"], self.at_start)

    @staticmethod
    @element
    def tension(r, state, stiffness, rest_length):
        return stiffness * (r - rest_length) * (1 - state)

    @staticmethod
    @element
    def potential(r, state, stiffness, rest_length):
        return stiffness / 2 * (r - rest_length) * (r - rest_length) * (1 - state)

    @staticmethod
    @element
    def event(r, state, stiffness, rest_length, strength):
        return stiffness * (r - rest_length) - strength if state == 0 else -1.0

    @staticmethod
    @element
    def state_after():
        return 1.0
