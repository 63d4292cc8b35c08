"""The matrices of a structure: checks, lumped masses, and the block size of the fastest products."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse
import scipy.sparse.csgraph
import scipy.sparse.linalg

from ..functions.checks import reals, shown
from ..functions.sparse import is_of_scipy
from .products import EDGES

_FILLED = 1.25  # largest ratio of stored entries to nonzeros in blocks; blocks of 2 and 3 take 0.5 and 0.4 of the time
_SYMMETRIC = 1e-9  # largest relative difference of a symmetric matrix from its transpose


@dataclass(frozen=True)
class Mass:
    """The mass of a structure.

    Attributes
    ----------
    diagonal : ndarray, shape (n,), or None
        The masses, if lumped.
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
        If M is not square, not symmetric, not positive definite, or not finite.
    """
    if lump not in (None, "row", "hrz"):
        raise ValueError(f'lump must be "row" or "hrz", not {shown(lump)}.')
    given = None if is_of_scipy(M) else reals(M, "M")
    if given is not None and given.ndim == 1:
        check_masses(given, "M")
        return Mass(given, scipy.sparse.diags_array(given).tocsr())
    matrix = check_matrix(M, "M")
    check_symmetric(matrix, "M")
    if lump is not None:
        diagonal = _row_sums(matrix) if lump == "row" else _hrz(matrix)
        check_masses(diagonal, f'M with lump="{lump}"')
        return Mass(diagonal, scipy.sparse.diags_array(diagonal).tocsr())
    diagonal = matrix.diagonal()
    if matrix.count_nonzero() == np.count_nonzero(diagonal):
        check_masses(diagonal, "M")
        return Mass(diagonal, scipy.sparse.diags_array(diagonal).tocsr())
    return Mass(None, matrix)


def check_matrix(matrix: Any, name: str, n: int | None = None) -> Any:
    """Return a sparse array in compressed rows.

    Raises
    ------
    TypeError, ValueError
        If it is not square or does not have the shape (n, n), or is not made of finite real numbers.
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


def is_gyroscopic(C: Any) -> bool:
    """Return whether a damping matrix does no work, because it is antisymmetric."""
    return bool(abs(C + C.T).max() <= _SYMMETRIC * abs(C).max())


def check_symmetric(matrix: Any, name: str, remedy: str = "") -> None:
    """Refuse a matrix that is not symmetric."""
    difference, largest = abs(matrix - matrix.T), abs(matrix).max()
    if difference.max() > _SYMMETRIC * largest:
        entries = difference.tocoo()
        i, j = (int(places[entries.data.argmax()]) for places in (entries.row, entries.col))
        raise ValueError(f"{name} must be symmetric, but {name}[{i}, {j}] and {name}[{j}, {i}] differ{remedy}.")


def edge_of_blocks(matrices: Any) -> int:
    """Return the size of the square blocks for the fastest products with some sparse matrices, or 1."""
    for edge in EDGES[:-1]:
        if matrices and all(matrix.shape[0] % edge == 0 for matrix in matrices):
            stored = sum(matrix.tobsr((edge, edge)).data.size for matrix in matrices)
            if stored <= _FILLED * sum(matrix.nnz for matrix in matrices):
                return edge
    return 1


def without(K: Any, left_out: np.ndarray) -> Any:
    """Return the stiffness of the other degrees of freedom, where those that are left out carry no load.

    Static condensation (Guyan, 1965).

    Raises
    ------
    ValueError
        If the degrees of freedom that are left out can move without a force.
    """
    K, kept = K.tocsc(), ~left_out
    try:
        followed = scipy.sparse.linalg.splu(K[left_out][:, left_out]).solve(K[left_out][:, kept].toarray())
    except RuntimeError as error:
        raise ValueError(
            "a rotation without inertia moves without a force: support it, or give it an inertia."
        ) from error
    condensed = K[kept][:, kept].toarray() - K[kept][:, left_out] @ followed
    return scipy.sparse.csr_array((condensed + condensed.T) / 2)


def _row_sums(matrix: Any) -> np.ndarray:
    return np.asarray(matrix.sum(axis=1)).ravel()


def _hrz(matrix: Any) -> np.ndarray:
    """Scale the diagonal to preserve the mass of each direction (Hinton, Rock and Zienkiewicz, 1976).

    The directions are the uncoupled parts of the matrix.
    """
    diagonal, sums = matrix.diagonal(), _row_sums(matrix)
    _, part = scipy.sparse.csgraph.connected_components(matrix, directed=False)
    total, of_diagonal = (np.bincount(part, weights=x) for x in (sums, diagonal))
    return diagonal * (total / of_diagonal)[part]


def check_masses(masses: np.ndarray, name: str, n: int | None = None) -> None:
    """Refuse masses that are not positive and finite, or not n."""
    if n is not None and masses.size != n:
        raise ValueError(f"{name} must have {n} masses, not {masses.size}.")
    if masses.size == 0:
        raise ValueError(f"{name} must have at least one degree of freedom, but it is empty.")
    bad = np.flatnonzero(~(np.isfinite(masses) & (masses > 0)))
    if bad.size:
        remedy = ": condense it out of K, or give it a mass" if masses[bad[0]] == 0 else ""
        raise ValueError(
            f"{name} must have positive, finite masses, but the mass of degree of freedom {bad[0]} is "
            f"{masses[bad[0]]:g}{remedy}."
        )
