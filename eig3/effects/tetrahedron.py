"""The kind of effects on tetrahedra of constant strain."""

from itertools import combinations

import numpy as np

from ..kernels.compile.jit import element
from ..scene.cell import ORIENT, Cell, offers_of
from .triangle import FLAT
from .vector import add, scale, subtract


@element
def combined(s, a, b, c):
    """Return the sum of three vectors times the numbers s."""
    return add(scale(s[0], a), add(scale(s[1], b), scale(s[2], c)))


@element
def gradient(x, inverse):
    a, b, c = subtract(x[1], x[0]), subtract(x[2], x[0]), subtract(x[3], x[0])
    m = inverse
    return (
        combined((m[0], m[3], m[6]), a, b, c),
        combined((m[1], m[4], m[7]), a, b, c),
        combined((m[2], m[5], m[8]), a, b, c),
    )


@element
def gradient_rate(v, inverse):
    return gradient(v, inverse)


@element
def nodal_forces(stress, inverse, volume):
    m = inverse
    f, g, h = scale(-volume, stress[0]), scale(-volume, stress[1]), scale(-volume, stress[2])
    a, b, c = combined(m[:3], f, g, h), combined(m[3:6], f, g, h), combined(m[6:], f, g, h)
    return combined((-1.0, -1.0, -1.0), a, b, c), a, b, c


class Tetrahedron(Cell):
    """An effect of the deformation of a tetrahedron, in which the strain is constant.

    A class has ``stress``, the derivative of the potential with respect to the deformation gradient F: the first
    Piola-Kirchhoff stress, Pa. It may have ``potential``, the energy per volume at rest, J/m^3. Their arguments can be
    F, the rate at which it grows, rate, and fields; the stress can take the time t. See `Body` for `vectors`, `arrays`
    and `nonnegative`.

    F, its rate and the stress are tuples of three columns. Column k of F is the vector that a unit vector along axis k
    at rest has become. The corners are in the order of meshio: seen from the fourth, the first three are
    counterclockwise.
    """

    takes = (4,)
    dimensions = (3,)
    variable, conjugate = "F", "stress"
    shape = {"inverse": 9, "volume": 0}  # noqa: RUF012, as in the base class
    extent = "volume"
    picture = "surface"
    offers = offers_of(variable, conjugate, shape)
    needs = (conjugate,)
    value, rate, forces = gradient, gradient_rate, nodal_forces

    def shape_columns(self, rest):
        edges = np.stack([corner - rest[0] for corner in rest[1:]], axis=-1)
        longest = np.max([np.linalg.norm(a - b, axis=-1) for a, b in combinations(rest, 2)], axis=0)
        volumes = np.linalg.det(edges) / 6
        self.refuse_cells(np.abs(volumes) <= FLAT * longest**3, "has no volume at rest", "move a corner of each")
        self.refuse_cells(volumes < 0, "is inverted at rest", ORIENT)
        return {"inverse": np.linalg.inv(edges).reshape(-1, 9), "volume": volumes}
