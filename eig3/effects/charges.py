"""Charges of the points of a group, and the forces between charges that clouds of the opposite charge screen."""

import math

from ..kernels.compile.jit import element
from ..kernels.elementary import gauss_and_erfc
from ..scene.effect import Link


@element
def screened_tension_of(r, prefactor, alpha):
    gauss, erfc = gauss_and_erfc(alpha * r)
    return -prefactor * (erfc / r + 2 / math.sqrt(math.pi) * alpha * gauss) / r


@element
def screened_potential_of(r, prefactor, alpha):
    return prefactor * gauss_and_erfc(alpha * r)[1] / r


class OfCharges(Link):
    """A link with the field charges, which has the charge of each point of one group, or None."""

    @property
    def mixed(self):
        return {} if self.charges is None else {"charges": "product"}

    def of_groups(self, groups):
        self._refuse_charges(groups > 1)
        return self

    def check_points(self, masses, positions, columns):
        self._refuse_charges(True)
        super().check_points(masses, positions, columns)

    def _refuse_charges(self, condition):
        if condition and self.charges is not None:
            raise ValueError(
                f"charges of {self.title} must be of one array of points; elsewhere, multiply the prefactor of "
                "Coulomb by two charges."
            )
