"""Giuffre's, Menegotto's and Pinto's link: steel that yields with the Bauschinger effect."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from ..kernels.elementary import exp, log
from ..scene.effect import Link
from .elastic_plastic import falling, over_yield, require_yield


@element
def target(r, state, stiffness, yield_force, rest_length):
    """The turn from which the branch begins, the point to which it tends, and its direction.

    A link that has not turned yet begins at the rest length.
    """
    turn, force, aim, aim_force, _, _ = state
    if aim == turn:
        direction = 1.0 if r >= rest_length else -1.0
        return 0.0, 0.0, direction * yield_force / stiffness, direction * yield_force, direction
    return turn, force, aim, aim_force, 1.0 if aim > turn else -1.0


@element
def force_of_branch(r, state, stiffness, yield_force, hardening, R0, cR1, cR2, rest_length):
    turn, force, aim, aim_force, direction = target(r, state, stiffness, yield_force, rest_length)
    yield_stretch = yield_force / stiffness
    most = direction * yield_stretch + (state[4] if direction > 0 else state[5])
    excess = abs(most - aim) / yield_stretch
    R = R0 * (1 - cR1 * excess / (cR2 + excess))
    x = (r - rest_length - turn) / (aim - turn)
    size = exp(log(1 + exp(R * log(abs(x)))) / R)
    return force + (aim_force - force) * x * (hardening + (1 - hardening) / size)


@element
def turning(r, rate, state, stiffness, yield_force, rest_length):
    """Negative while the stretch changes in the direction of the branch; it becomes positive where the link turns."""
    ahead = rate * target(r, state, stiffness, yield_force, rest_length)[4]
    return falling(ahead) if r != rest_length else -ahead


@element
def next_branch(r, state, stiffness, yield_force, hardening, R0, cR1, cR2, rest_length):
    direction = target(r, state, stiffness, yield_force, rest_length)[4]
    force = force_of_branch(r, state, stiffness, yield_force, hardening, R0, cR1, cR2, rest_length)
    turn, yield_stretch = r - rest_length, yield_force / stiffness
    above, below = max(state[4], turn - yield_stretch), min(state[5], turn + yield_stretch)
    # where the elastic line through the turn meets the line of yielding on the other side
    aim = (stiffness * turn - force - direction * (1 - hardening) * yield_force) / ((1 - hardening) * stiffness)
    return turn, force, aim, force + stiffness * (aim - turn), above, below


@element
def next_branch_after_shift(r, state, stiffness, yield_force, hardening, R0, cR1, cR2, rest_length, a1, a2, a3, a4):
    turn, force, aim, aim_force, above, below = next_branch(
        r, state, stiffness, yield_force, hardening, R0, cR1, cR2, rest_length
    )
    side, share, size = (1.0, a3, a4) if aim > turn else (-1.0, a1, a2)
    yield_stretch = yield_force / stiffness
    strain = (1 + (above - below) / (2 * yield_stretch)) / size
    shift = side * share * yield_stretch * exp(0.8 * log(strain))
    return turn, force, aim + shift, aim_force + stiffness * shift, above, below


@dataclass(frozen=True, eq=False)
class GiuffreMenegottoPinto(Link):
    """A link of steel that yields with round loops, by Giuffre, Menegotto and Pinto: reinforcement, hinges, braces.

    Formula: from a turn (r_0, F_0) of the stretch, the force tends to the corner (r_1, F_1) of the elastic line and the
    line of yielding, F = F_0 + (F_1 - F_0) x (b + (1 - b) / (1 + |x|^R)^(1/R)) with x = (s - r_0) / (r_1 - r_0),
    s = r - rest_length, b = hardening and R = R0 (1 - cR1 e / (cR2 + e)). e is the distance of the corner from the
    largest stretch on this side so far, in units of yield_force / stiffness; r is the distance of the ends.

    Isotropic hardening moves the line of yielding: at a turn towards tension, its yield force is yield_force (1 + a3
    d^0.8), where d is the range of the stretch so far, in units of 2 a4 yield_force / stiffness; and with a1 and a2 at
    a turn towards compression.

    A stretched link that moves back at the start turns there. Later turns are events: ``solution.events["giuffre
    menegotto pinto 0"]`` has the times and states. The state has six numbers: the turn, the corner, and by how much the
    largest and the smallest stretch exceeded the yield stretch. EIG-3 keeps its second order with a fixed step, and
    tolerances hold.

    Parameters
    ----------
    stiffness : float or array_like
        The elastic stiffness, N/m.
    yield_force : float or array_like
        N.
    hardening : float or array_like
        The ratio of the stiffness after yield and the elastic stiffness, from 0 to below 1.
    R0, cR1, cR2 : float or array_like
        Coefficients: how sharply the link yields at first, and how much less after large strains.
    rest_length : float or array_like
        m.
    a1, a2, a3, a4 : float or array_like
        Coefficients of the isotropic hardening in compression, a1 and a2, and in tension, a3 and a4.

    Raises
    ------
    ValueError
        For a value outside these ranges, or stiffness, yield_force, R0, a2 or a4 that is not positive.

    Notes
    -----
    Other codes: ``uniaxialMaterial Steel02`` of OpenSees.

    Not included: an initial stress, as sigInit of ``Steel02``, and buckling.
    """

    stiffness: ArrayLike
    yield_force: ArrayLike
    hardening: ArrayLike = 0.0
    R0: ArrayLike = 20.0
    cR1: ArrayLike = 0.925  # noqa: N815 - as in OpenSees
    cR2: ArrayLike = 0.15  # noqa: N815
    rest_length: ArrayLike = 0.0
    a1: ArrayLike = 0.0
    a2: ArrayLike = 1.0
    a3: ArrayLike = 0.0
    a4: ArrayLike = 1.0

    nonnegative = ("cR1", "cR2", "a1", "a3")
    crossing = 1
    turns = True
    state_size = 6
    source = "Menegotto and Pinto, IABSE Symposium on Resistance and Ultimate Deformability (1973) 15"
    picture = "spring"

    def __post_init__(self) -> None:
        super().__post_init__()
        require_yield(self)
        for name in ("R0", "a2", "a4"):
            self.require(np.asarray(getattr(self, name)) > 0, f"{name} must be positive")

    @property
    def state_after(self):
        return next_branch_after_shift if np.any(self.a1) or np.any(self.a3) else next_branch

    tension = force_of_branch
    event = turning
    ductility = over_yield
