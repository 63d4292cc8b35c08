"""The Lennard-Jones force between two atoms."""

from __future__ import annotations

import copy
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..kernels.compile.jit import element
from .shifted import Shifted, shifted_potential, shifted_tension


@element
def tension_of(r, epsilon, sigma):
    inverse = 1 / r  # the only division, which the code of a scene shares
    s = (sigma * inverse) ** 2
    s6 = s * s * s
    return 24 * epsilon * s6 * (1 - 2 * s6) * inverse


@element
def potential_of(r, epsilon, sigma):
    s = (sigma * (1 / r)) ** 2
    s6 = s * s * s
    return 4 * epsilon * s6 * (s6 - 1)


@element
def tension(r, epsilon, sigma, cutoff, pull_at_cutoff):
    return shifted_tension(r, cutoff, tension_of(r, epsilon, sigma), pull_at_cutoff)


@element
def potential(r, epsilon, sigma, cutoff, pull_at_cutoff, energy_at_cutoff):
    return shifted_potential(r, cutoff, potential_of(r, epsilon, sigma), pull_at_cutoff, energy_at_cutoff)


@element
def tension_of_mixture(r, epsilon, sigma, cutoff):
    return tension(r, epsilon, sigma, cutoff, tension_of(cutoff, epsilon, sigma))


@element
def potential_of_mixture(r, epsilon, sigma, cutoff):
    pull, energy = tension_of(cutoff, epsilon, sigma), potential_of(cutoff, epsilon, sigma)
    return potential(r, epsilon, sigma, cutoff, pull, energy)


#: The rule for epsilon and the rule for sigma, by the name of both.
MIXING = {"lorentz-berthelot": ("geometric", "arithmetic"), "geometric": ("geometric", "geometric")}


@dataclass(frozen=True, eq=False)
class LennardJones(Shifted):
    """Repulsion of two atoms that are close, and attraction of two atoms farther apart.

    Formula: V(r) = 4 epsilon ((sigma / r)^12 - (sigma / r)^6). The energy is V(r) - V(cutoff) - (r - cutoff) V'(cutoff)
    up to the cutoff and 0 beyond (a shifted force), so that energy and force are continuous. The tension is the
    derivative of the energy.

    In a mixture, each point of a group has an epsilon and a sigma. A pair has the epsilon sqrt(epsilon_i epsilon_j)
    and, with the mixing "lorentz-berthelot", the sigma (sigma_i + sigma_j) / 2, or sqrt(sigma_i sigma_j) with the
    mixing "geometric".

    Parameters
    ----------
    epsilon : float or array_like
        The depth of V, J; also for each point of a group.
    sigma : float or array_like
        The distance at which V is 0, m; its minimum is at 2^(1/6) sigma. Also for each point of a group.
    cutoff : float or array_like
        The distance beyond which there is no force, m; 2.5 sigma is usual.
    mixing : {"lorentz-berthelot", "geometric"}
        The rule for the epsilon, J, and the sigma, m, of two points of a group.

    Raises
    ------
    ValueError
        For epsilon or sigma below 0, a cutoff that is not positive, or an unknown mixing.

    Notes
    -----
    Other codes: LAMMPS ``pair_style lj/smooth/linear cutoff`` with ``pair_coeff 1 1 epsilon sigma``; HOOMD
    ``md.pair.ForceShiftedLJ``. The mixing is ``pair_modify mix arithmetic`` or ``mix geometric`` in LAMMPS, which has
    "geometric" as its default; OpenMM's ``NonbondedForce`` has "lorentz-berthelot". It shifts no force; give this
    energy to a ``CustomNonbondedForce``.

    Not included: the constant and the tail correction in the energy sum of a crystal or a liquid (``pair_modify tail
    yes``): energy and pressure differ from the sum over all distances, and from ``lj/cut``. Other mixing rules: add one
    effect for each pair of kinds, with ``others=`` between two kinds. A cutoff for each point.
    """

    epsilon: ArrayLike
    sigma: ArrayLike
    cutoff: ArrayLike
    mixing: str = "lorentz-berthelot"
    pull_at_cutoff: ArrayLike = field(init=False, repr=False, default=0.0)
    energy_at_cutoff: ArrayLike = field(init=False, repr=False, default=0.0)

    nonnegative = ("epsilon", "sigma")
    source = "Lennard-Jones (1924); shifted force of Toxvaerd and Dyre (2011)"
    _is_mixture = False

    def __post_init__(self):
        super().__post_init__()
        if self.mixing not in MIXING:
            raise ValueError(f"mixing of LennardJones must be {' or '.join(map(repr, MIXING))}, not {self.mixing!r}.")
        self._shift(tension_of, potential_of, "epsilon", "sigma")

    @property
    def mixed(self):
        return dict(zip(("epsilon", "sigma"), MIXING[self.mixing], strict=True))

    def of_groups(self, groups):
        """Return the link that computes the shift of each pair if the points differ."""
        if not np.ptp(self._reals("epsilon")) and not np.ptp(self._reals("sigma")):
            return self
        mixture = copy.copy(self)
        object.__setattr__(mixture, "_is_mixture", True)  # the record is frozen
        return mixture

    @property
    def tension(self):
        return tension_of_mixture if self._is_mixture else tension

    @property
    def potential(self):
        return potential_of_mixture if self._is_mixture else potential
