"""The constants of an isotropic material."""

from ..kernels.compile.jit import element
from .tetrahedron import Tetrahedron


@element
def lame(E, nu):
    """Return Lame's constants, the second of which is the shear modulus."""
    return E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))


class Isotropic(Tetrahedron):
    """A tetrahedron of an isotropic elastic material, with the fields E and nu."""

    nonnegative = ("E",)

    def __post_init__(self):
        super().__post_init__()
        nu = self._reals("nu")
        self.require((nu > -1) & (nu < 0.5), "nu must be between -1 and 0.5")
