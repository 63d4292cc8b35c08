"""The matrices of a structure: what they must be, lumped masses, and the factors of a consistent mass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse
import scipy.sparse.csgraph
import scipy.sparse.linalg

from ..functions.checks import reals, shown
from ..functions.sparse import is_of_scipy

_SYMMETRIC = 1e-9  # part of the largest entry by which a symmetric matrix may differ from its transpose


@dataclass(frozen=True)
class Mass:
    """The mass of a structure.

    Attributes
    ----------
    diagonal : ndarray, shape (n,), or None
        The masses, if they are lumped.
    matrix : sparse array
    """

    diagonal: np.ndarray | None
    matrix: Any

    @property
    def n(self) -> int:
        """Number of degrees of freedom."""
        return self.matrix.shape[0]


def check_mass(M: Any, lump: str | None) -> Mass:
    """Return the mass.

    Raises
    ------
    TypeError, ValueError
        If M is no mass: not square, not symmetric, not positive definite, or not made of finite numbers.
    """
    if lump not in (None, "row", "hrz"):
        raise ValueError(f'lump must be "row" or "hrz", not {shown(lump)}.')
    given = None if is_of_scipy(M) else reals(M, "M")
    if given is not None and given.ndim == 1:
        _check_masses(given, "M")
        return Mass(given, scipy.sparse.diags_array(given).tocsr())
    matrix = check_matrix(M, "M")
    check_symmetric(matrix, "M")
    if lump is not None:
        diagonal = _row_sums(matrix) if lump == "row" else _hrz(matrix)
        _check_masses(diagonal, f'M with lump="{lump}"')
        return Mass(diagonal, scipy.sparse.diags_array(diagonal).tocsr())
    diagonal = matrix.diagonal()
    if matrix.count_nonzero() == np.count_nonzero(diagonal):
        _check_masses(diagonal, "M")
        return Mass(diagonal, scipy.sparse.diags_array(diagonal).tocsr())
    return Mass(None, matrix)


def check_matrix(matrix: Any, name: str, n: int | None = None) -> Any:
    """Return a sparse array in compressed rows.

    Raises
    ------
    TypeError, ValueError
        If it is not square or has not the shape (n, n), or is not made of finite real numbers.
    """
    if not is_of_scipy(matrix):
        matrix = np.atleast_2d(reals(matrix, name))
    if len(matrix.shape) != 2 or matrix.shape[0] != matrix.shape[1]:
        raise ValueError(f"{name} must be a square matrix, not one of the shape {matrix.shape}.")
    if matrix.shape[0] == 0:
        raise ValueError(f"{name} must have at least one degree of freedom, but it is empty.")
    if n is not None and matrix.shape[0] != n:
        raise ValueError(f"{name} must have the shape ({n}, {n}) of M, not {matrix.shape}.")
    rows = scipy.sparse.csr_array(matrix, copy=True)
    rows.sum_duplicates()
    rows.data = reals(rows.data, name)
    if not np.isfinite(rows.data).all():
        raise ValueError(f"{name} must be made of finite numbers, but it has {rows.data[~np.isfinite(rows.data)][0]}.")
    rows.eliminate_zeros()
    return rows


def check_symmetric(matrix: Any, name: str) -> None:
    """Refuse a matrix that is not symmetric."""
    difference, largest = abs(matrix - matrix.T), abs(matrix).max()
    if difference.max() > _SYMMETRIC * largest:
        entries = difference.tocoo()
        i, j = (int(places[entries.data.argmax()]) for places in (entries.row, entries.col))
        raise ValueError(f"{name} must be symmetric, but {name}[{i}, {j}] and {name}[{j}, {i}] differ.")


def factors(mass: Any) -> tuple[np.ndarray, Any, Any, np.ndarray]:
    """Return factors of a consistent mass: the order of elimination, L and U without diagonals, and 1 / diag(U).

    L and U are sparse arrays in compressed rows. Row i belongs to the degree of freedom order[i], and the columns are
    degrees of freedom, so that systems are solved in place.

    Raises
    ------
    ValueError
        If the mass is not positive definite.
    """
    options = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
    try:
        lu = scipy.sparse.linalg.splu(mass.tocsc(), **options)
    except RuntimeError:  # it is exactly singular
        raise _not_definite() from None
    pivots = lu.U.diagonal()
    if not (np.array_equal(lu.perm_r, lu.perm_c) and (pivots > 0).all() and np.isfinite(pivots).all()):
        raise _not_definite()
    order = np.argsort(lu.perm_c)
    return order, _below(lu.L, order, -1), _below(lu.U, order, 1), 1 / pivots


def _below(triangle: Any, order: np.ndarray, side: int) -> Any:
    """Return a triangle without its diagonal, whose columns are degrees of freedom."""
    part = scipy.sparse.tril(triangle, -1) if side < 0 else scipy.sparse.triu(triangle, 1)
    rows = scipy.sparse.csr_array(part)
    return scipy.sparse.csr_array((rows.data, order[rows.indices], rows.indptr), shape=rows.shape)


def _not_definite() -> ValueError:
    return ValueError(
        "M must be positive definite: some motion has no mass, or a negative one; remove the degrees of freedom "
        'without mass, or lump it with lump="hrz".'
    )


def _row_sums(matrix: Any) -> np.ndarray:
    return np.asarray(matrix.sum(axis=1)).ravel()


def _hrz(matrix: Any) -> np.ndarray:
    """Scale the diagonal so that the mass of each direction stays (Hinton, Rock and Zienkiewicz, 1976).

    The directions are the parts of the matrix that are not connected with each other.
    """
    diagonal, sums = matrix.diagonal(), _row_sums(matrix)
    _, part = scipy.sparse.csgraph.connected_components(matrix, directed=False)
    total, of_diagonal = (np.bincount(part, weights=x) for x in (sums, diagonal))
    return diagonal * (total / of_diagonal)[part]


def _check_masses(masses: np.ndarray, name: str) -> None:
    if masses.size == 0:
        raise ValueError(f"{name} must have at least one degree of freedom, but it is empty.")
    bad = np.flatnonzero(~(np.isfinite(masses) & (masses > 0)))
    if bad.size:
        raise ValueError(
            f"{name} must have positive, finite masses, but that of degree of freedom {bad[0]} is {masses[bad[0]]:g}."
        )
