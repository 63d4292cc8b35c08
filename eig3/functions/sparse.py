"""A sparse matrix among parameters with names."""

from typing import Any, NamedTuple


class Sparse(NamedTuple):
    """A sparse matrix in compressed rows, as functions get it.

    The entries of row i are ``data[k]`` in the columns ``indices[k]``, for k from ``indptr[i]`` to ``indptr[i + 1]``.

    Attributes
    ----------
    data : ndarray of float64, shape (entries,)
    indices : ndarray of int64, shape (entries,)
    indptr : ndarray of int64, shape (rows + 1,)
    shape : (int, int)
    """

    data: Any
    indices: Any
    indptr: Any
    shape: Any


def is_of_scipy(value: Any) -> bool:
    """Whether a value is a sparse matrix of SciPy, which need not be installed."""
    return hasattr(value, "tocsr")
