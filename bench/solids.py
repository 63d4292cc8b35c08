"""The lumped mass and the stiffness of an elastic cube of equal trilinear elements.

A finite element library takes minutes for a million degrees of freedom. Here each pair of an element's corners is added
for all elements at once, since the elements are equal.
"""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import scipy.sparse

YOUNG, POISSON = 1e3, 0.3  # Pa, -
_CORNERS = np.array(list(product((0, 1), repeat=3)))


def size(n: int) -> int:
    """Return the number of degrees of freedom of a cube of n^3 elements."""
    return 3 * n * (n + 1) ** 2


def cube(n: int) -> tuple[np.ndarray, Any]:
    """Return the masses, shape (size,), and the stiffness, in blocks, of a unit cube that is fixed at x = 0.

    The density is 1 kg/m^3. Nodes are in the order of x, y and z, and each has three degrees of freedom.
    """
    nodes = (n + 1,) * 3
    K = element_stiffness(1 / n).reshape(8, 3, 8, 3)
    blocks = np.zeros((*nodes, 27, 3, 3))
    masses = np.zeros(nodes)
    for i, at in enumerate(_CORNERS):
        of = tuple(slice(x, x + n) for x in at)
        masses[of] += 1 / (8 * n**3)
        for j, to in enumerate(_CORNERS):
            blocks[(*of, np.dot(to - at + 1, (9, 3, 1)))] += K[i, :, j]
    offsets = np.array(list(product((-1, 0, 1), repeat=3)))
    places = np.moveaxis(np.indices(nodes), 0, -1)[1:]  # the nodes that are free
    neighbours = places[..., None, :] + offsets
    exists = ((neighbours >= (1, 0, 0)) & (neighbours <= n)).all(axis=-1).reshape(-1, 27)
    number = (neighbours - (1, 0, 0)) @ ((n + 1) ** 2, n + 1, 1)
    indptr = np.concatenate([[0], np.cumsum(exists.sum(axis=1))])
    data = blocks[1:].reshape(-1, 27, 3, 3)[exists]
    stiffness = scipy.sparse.bsr_array((data, number.reshape(-1, 27)[exists], indptr), shape=(size(n),) * 2)
    return np.repeat(masses[1:].ravel(), 3), stiffness


def element_stiffness(side: float) -> np.ndarray:
    """Return the stiffness of a cubic element, shape (24, 24), by Gauss's rule with two points in each direction."""
    lame, shear = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON)), YOUNG / (2 * (1 + POISSON))
    elastic = np.diag([2 * shear] * 3 + [shear] * 3)
    elastic[:3, :3] += lame
    K = np.zeros((24, 24))
    for point in product((0.5 - 0.5 / np.sqrt(3), 0.5 + 0.5 / np.sqrt(3)), repeat=3):
        shapes = np.where(_CORNERS, point, 1 - np.array(point))
        slopes = np.where(_CORNERS, 1, -1) / side
        dx, dy, dz = (slopes[:, k] * np.delete(shapes, k, axis=1).prod(axis=1) for k in range(3))
        zero = np.zeros(8)
        rows = [(dx, zero, zero), (zero, dy, zero), (zero, zero, dz), (dy, dx, zero), (zero, dz, dy), (dz, zero, dx)]
        strain = np.stack([np.column_stack(row).ravel() for row in rows])
        K += strain.T @ elastic @ strain * side**3 / 8
    return K
