"""A sparse matrix as a named parameter."""

from typing import Any, NamedTuple


class Sparse(NamedTuple):
    """A sparse matrix in compressed rows, as functions get it.

    The entries of row i are ``data[k]`` in the columns ``indices[k]``, for k from ``indptr[i]`` to ``indptr[i + 1]``.
    In a matrix of blocks, as a `scipy.sparse.bsr_array`, rows, columns and entries count blocks: ``data[k]`` is a
    block.

    Attributes
    ----------
    data : ndarray of float64, shape (entries,) or (blocks, edge, edge)
    indices : ndarray of int32, shape (entries,)
    indptr : ndarray of int64, shape (rows + 1,)
    shape : (int, int)
        Rows and columns of the matrix; in a matrix of blocks too, the entries of blocks are counted.
    """

    data: Any
    indices: Any
    indptr: Any
    shape: Any

    @property
    def edge(self) -> int:
        """The number of rows of a block, or 1."""
        return 1 if self.data.ndim == 1 else self.data.shape[1]


def is_of_scipy(value: Any) -> bool:
    """Whether a value is a sparse matrix of SciPy. SciPy is not imported."""
    return hasattr(value, "tocsr")


def has_blocks(value: Any) -> bool:
    """Whether a sparse matrix of SciPy has square blocks, which are kept."""
    return value.format == "bsr" and value.blocksize[0] == value.blocksize[1] > 1
