"""Meshes: arrays of cells, each a row with the numbers of its corners, as meshio gives them."""

from __future__ import annotations

import warnings
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike

from ..functions.checks import reals

__all__ = ["edges", "hinges", "surface"]


def edges(cells: ArrayLike) -> np.ndarray:
    """Return the edges of triangles or tetrahedra, each once.

    Parameters
    ----------
    cells : array_like of int, shape (cells, corners)

    Returns
    -------
    ndarray of int, shape (2, edges)
        The lower and the higher number of the ends.
    """
    cells = np.asarray(cells)
    ends = np.concatenate([cells[:, pair] for pair in combinations(range(cells.shape[1]), 2)])
    return np.unique(np.sort(ends, axis=1), axis=0).T


def hinges(triangles: ArrayLike) -> np.ndarray:
    """Return the edges that two triangles share, with the opposite corners, for effects such as HingeBending.

    Parameters
    ----------
    triangles : array_like of int, shape (triangles, 3)

    Returns
    -------
    ndarray of int, shape (4, hinges)
        The corner of one triangle, the lower and the higher end of the edge, and the corner of the other triangle.

    Raises
    ------
    ValueError
        If more than two triangles meet at an edge.
    """
    triangles = np.asarray(triangles)
    sides = np.sort(np.concatenate([triangles[:, [1, 2]], triangles[:, [2, 0]], triangles[:, [0, 1]]]), axis=1)
    facing = triangles.T.ravel()
    order = np.lexsort((sides[:, 1], sides[:, 0]))
    sides, facing = sides[order], facing[order]
    meets = np.append((sides[1:] == sides[:-1]).all(axis=1), False)
    if (meets[1:] & meets[:-1]).any():
        a, b = sides[np.flatnonzero(meets[1:] & meets[:-1])[0]]
        raise ValueError(f"triangles must meet in pairs, but three have the edge from {a} to {b}: cut the sheet there.")
    first = np.flatnonzero(meets)
    return np.stack([facing[first], *sides[first].T, facing[first + 1]])


def surface(cells: ArrayLike) -> np.ndarray:
    """Return the visible triangles: the triangles of a sheet, or the faces of tetrahedra that belong to one cell.

    Parameters
    ----------
    cells : array_like of int, shape (cells, 3 or 4)

    Returns
    -------
    ndarray of int, shape (triangles, 3)
        The corners of a face of a tetrahedron are counterclockwise as seen from outside.
    """
    cells = np.asarray(cells)
    if cells.shape[1] == 3:
        return cells
    sides = np.concatenate([cells[:, three] for three in ([0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3])])
    _, first, count = np.unique(np.sort(sides, axis=1), axis=0, return_index=True, return_counts=True)
    return sides[first[count == 1]]


def check_cells(cells: ArrayLike, corners: int, count: int) -> np.ndarray:
    """Return cells as an array, or raise an error that names what is wrong."""
    found = np.asarray(cells)
    if found.ndim != 2 or found.shape[1] != corners or not found.size:
        raise ValueError(f"cells must have the shape (cells, {corners}), not {found.shape}.")
    if not np.issubdtype(found.dtype, np.integer):
        raise TypeError(f"cells must be integers, the numbers of points, not {found.dtype}.")
    if found.min() < 0 or found.max() >= count:
        wrong = np.flatnonzero(((found < 0) | (found >= count)).any(axis=1))[0]
        raise ValueError(f"cells must name points from 0 to {count - 1}, but cell {wrong} is {found[wrong].tolist()}.")
    lonely = np.setdiff1d(np.arange(count), found)
    if lonely.size:
        raise ValueError(f"points must belong to cells, but point {lonely[0]} does not: remove it from the mesh.")
    return found.astype(np.int64)


def oriented(cells: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Return the cells in the orientation of meshio, in which no cell that fills its dimension is inverted.

    Warns
    -----
    UserWarning
        If all cells are inverted, so that two corners of each are exchanged.
    """
    edges = rest[cells[:, 1:]] - rest[cells[:, :1]]
    if edges.shape[1] < edges.shape[2] or not (np.linalg.det(edges) < 0).all():
        return cells
    warnings.warn("all cells of the mesh are inverted: two corners of each are exchanged.", stacklevel=4)
    return cells[:, [0, 2, 1, *range(3, cells.shape[1])]]


def lumped(cells: np.ndarray, volumes: np.ndarray, density: ArrayLike, count: int) -> np.ndarray:
    """Return the masses of points: an equal part of each cell's mass for each of its corners, kg."""
    rho = reals(density, "density")
    if not (np.isfinite(rho) & (rho > 0)).all():
        raise ValueError("density must be positive and finite.")
    if rho.shape not in ((), volumes.shape):
        raise ValueError(f"density must be a number or have the shape {volumes.shape} of the cells, not {rho.shape}.")
    share = rho * volumes / cells.shape[1]
    return np.bincount(cells.ravel(), np.repeat(share, cells.shape[1]), count)


def is_fixed(fixed: ArrayLike, count: int) -> np.ndarray:
    """Return which points are fixed, as a boolean array, from their numbers or from a boolean array."""
    given = np.asarray(fixed)
    if given.dtype == bool:
        if given.shape != (count,):
            raise ValueError(f"fixed must have the shape ({count},) of the points if it is boolean, not {given.shape}.")
        return given
    if given.size and not np.issubdtype(given.dtype, np.integer):
        raise TypeError(f"fixed must be the numbers of points or boolean, not {given.dtype}.")
    if given.size and (given.min() < 0 or given.max() >= count):
        raise ValueError(f"fixed must name points from 0 to {count - 1}.")
    return np.isin(np.arange(count), given)
