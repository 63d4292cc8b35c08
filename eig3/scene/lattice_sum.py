"""The base class of sums over all periodic images of charges, and the waves of their box."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from ..kernels import ewald
from .effect import Link

_MOST_WAVES = 10**7  # with which an evaluation takes about half a second


class LatticeSum(Link):
    """A link between all pairs of charges and their images: Ewald's sum.

    The functions of the class are the part that ends at the cutoff, the potential erfc(alpha r) / r of two charges. The
    other part is the sum over the waves up to the wave number `most`, in a box with three sides. Every class has the
    fields prefactor, charges, alpha and cutoff.
    """

    dimensions: ClassVar[tuple[int, ...]] = (3,)
    prefactor: float
    charges: Any
    alpha: float

    @property
    def most(self) -> float:
        """The largest wave number, rad/m."""
        raise NotImplementedError

    def block(self, box: np.ndarray, points: int, x: int, charges: int) -> np.ndarray:
        """Return the numbers of `eig3.kernels.ewald` for points whose positions and charges are at places of p."""
        longest = 2 * np.pi / box
        counts = np.floor(self.most / longest).astype(int)
        ranges = np.arange(counts[0] + 1), *(np.arange(-n, n + 1) for n in counts[1:])
        multiples = np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1).reshape(-1, 3)
        squares = np.sum((multiples * longest) ** 2, axis=1)
        nx, ny, nz = multiples.T
        is_first = (nx > 0) | (nx == 0) & ((ny > 0) | (ny == 0) & (nz > 0))  # of a wave and its opposite
        kept = is_first & (squares <= self.most**2)
        multiples, squares = multiples[kept], squares[kept]
        sizes = 4 * np.pi * self.prefactor / np.prod(box) * np.exp(-squares / (2 * self.alpha) ** 2) / squares
        return ewald.block(x, charges, points, longest, multiples, sizes)

    def check_group(self, pair_force: Any, cloud: Any) -> None:
        if not (cloud.box > 0).all() or cloud.shear:
            raise ValueError(f"{self.title} needs a scene with a periodic box along x, y and z, without shear.")
        if pair_force.exclude_bonded:
            raise ValueError(f"{self.title} acts between all charges: exclude_bonded is for links with a cutoff.")
        longest = 2 * np.pi / cloud.box
        waves = 2 / 3 * np.pi * np.prod(self.most / longest)  # in half a ball of wave numbers
        self.require(
            waves <= _MOST_WAVES, f"accuracy must be larger, or the cutoff: the sum would have {waves:.0e} waves"
        )
        self.require(longest.min() <= self.most, "accuracy must be smaller, or the cutoff: the sum would have no waves")
        charges = pair_force.columns["charges"]
        self.require(len(charges) > 1, "charges must be of at least two points")
        self.require(abs(charges.sum()) <= 1e-9 * np.abs(charges).sum(), "charges must have the sum 0")
