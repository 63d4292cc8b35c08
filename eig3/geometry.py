"""The points of a problem in space, and what is between them: what animations draw, and files contain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True, eq=False)
class Geometry:
    """Moving points in the plane or in space, and the links, cells and bodies between them.

    Attributes
    ----------
    places : callable
        ``places(t, u)`` returns the positions of all points at the times t, shape (m,), for the displacements u, shape
        (m, n): an array of shape (m, points, 2) or (m, points, 3), m.
    velocities : callable, optional
        ``velocities(t, v)`` returns their velocities in the same form, m/s, from the velocities v.
    spins : callable, optional
        ``spins(v)`` returns the angular velocities of the points, rad/s, shape (m, points, 1) in the plane or (m,
        points, 3) in space.
    links : array_like of int, shape (links, 2)
        The numbers of the points at the ends of each link.
    strings : dict of int to int
        For the number of each breakable link, the degree of freedom that differs from 0 once it is broken.
    cells : sequence of ndarray of int, shape (cells, corners)
        The triangles of sheets and the tetrahedra of solids, each kind in one array.
    bodies : ndarray of int, shape (bodies, 1 + dimension)
        The numbers of the centre of each rigid body, and of the points that represent its axes as unit vectors.
    surfaces : dict of int to (ndarray, ndarray of int)
        For the rows in `bodies` of bodies with a given shape: points on the surface as factors of the vectors, m, shape
        (corners, dimension), and the triangles between them, shape (triangles, 3).
    vectors : sequence of int
        The numbers of the points that represent vectors: no places.
    fixed : sequence of int
        The numbers of the points that are supports.
    masses : sequence of float, shape (points,)
        kg; 0 for fixed points and for points that bodies carry. For a vector of a body, the integral of the square of
        the coordinate along it over the mass, kg m^2. Empty if they are not known.
    radii : sequence of float, shape (points,)
        m; 0 for points without contact. Empty if no point has a radius.
    contacts : callable, optional
        ``contacts(t, x, v)`` returns the pairs of points that push each other, and their normal forces, N, from the
        positions of all points inside the box and their velocities, shape (points, dimension). It needs SciPy.
    box : sequence of float, shape (2 or 3,)
        The sides of the periodic box, m; 0 along an axis that is not periodic. Empty without a box.
    shear : float
        The rate at which the box shears, 1/s.
    """

    places: Callable[[np.ndarray, np.ndarray], np.ndarray]
    velocities: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None
    spins: Callable[[np.ndarray], np.ndarray] | None = None
    links: Any = ()
    strings: Any = ()
    cells: Any = ()
    bodies: Any = ()
    surfaces: Any = ()
    vectors: Any = ()
    fixed: Any = ()
    masses: Any = ()
    radii: Any = ()
    contacts: Callable[[float, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]] | None = None
    box: Any = ()
    shear: float = 0.0
