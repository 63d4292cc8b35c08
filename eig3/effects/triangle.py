"""The kind of effects on triangles of constant strain."""

import numpy as np

from ..kernels.compile.jit import element
from ..scene.cell import ORIENT, Cell, offers_of
from .vector import add, scale, subtract

FLAT = 1e-9  # the least area or volume of a cell, divided by the power of its longest edge


@element
def gradient(x, inverse):
    a, b = subtract(x[1], x[0]), subtract(x[2], x[0])
    return add(scale(inverse[0], a), scale(inverse[2], b)), add(scale(inverse[1], a), scale(inverse[3], b))


@element
def gradient_rate(v, inverse):
    return gradient(v, inverse)


@element
def nodal_forces(stress, inverse, volume):
    first, second = scale(-volume, stress[0]), scale(-volume, stress[1])
    a = add(scale(inverse[0], first), scale(inverse[1], second))
    b = add(scale(inverse[2], first), scale(inverse[3], second))
    return scale(-1.0, add(a, b)), a, b


class Triangle(Cell):
    """An effect of the deformation of a triangle in the plane or in space, in which the strain is constant.

    A class has a field ``thickness``, m, and the function ``stress``, the derivative of the potential with respect to
    the deformation gradient F: the first Piola-Kirchhoff stress, Pa. It may have ``potential``, the energy per volume
    at rest, J/m^3. Their arguments can be F, the rate at which it grows, rate, and fields; the stress can take the time
    t. See `Body` for `vectors`, `arrays` and `nonnegative`.

    F, its rate and the stress are tuples of two columns. Column k of F is the vector that a unit vector along axis k of
    the triangle at rest has become: it has a component for each dimension of the scene. In space, the first axis is
    along the first edge at rest, and the second is across it in the plane of the triangle. In the plane they are x and
    y.
    """

    takes = (3,)
    dimensions = (2, 3)
    variable, conjugate = "F", "stress"
    shape = {"inverse": 4, "volume": 0}  # noqa: RUF012, as in the base class
    extent = "volume"
    picture = "surface"
    offers = offers_of(variable, conjugate, shape)
    needs = (conjugate,)
    value, rate, forces = gradient, gradient_rate, nodal_forces

    def __post_init__(self):
        super().__post_init__()
        if not hasattr(self, "thickness"):
            raise TypeError(f"{self.title} must have a field thickness, m.")
        self.require(self._reals("thickness") > 0, "thickness must be positive")

    def shape_columns(self, rest):
        edges = np.stack([rest[1] - rest[0], rest[2] - rest[0]], axis=-1)
        longest = np.max([np.linalg.norm(rest[i] - rest[j], axis=-1) for i, j in ((0, 1), (0, 2), (1, 2))], axis=0)
        if rest[0].shape[-1] == 3:
            edges = np.linalg.qr(edges, mode="r")  # in an orthonormal frame of the plane of the triangle
            edges *= np.sign(np.diagonal(edges, axis1=1, axis2=2))[..., None]
        areas = np.linalg.det(edges) / 2
        self.refuse_cells(np.abs(areas) <= FLAT * longest**2, "has no area at rest", "move a corner of each")
        self.refuse_cells(areas < 0, "is inverted at rest", ORIENT)
        thickness = self._column("thickness", areas.shape, 2)
        return {"inverse": np.linalg.inv(edges).reshape(-1, 4), "volume": areas * thickness}
