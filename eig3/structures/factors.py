"""The factors of a consistent mass matrix, and compiled solves with them.

Neighbouring columns of a factor have nonzeros in nearly the same rows. They form panels, which also store zeros: a
solve then reads the index of a row, and its value, once for the panel.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

from ..kernels.compile.jit import element
from ..kernels.compile.source import Writer, define
from .products import EDGES

_SAME = 1e-14  # largest relative difference of the masses of two directions
_WIDTHS = 4, 2, 1  # of panels; a width of 3 too would save 2 % of a solve, and compile for half as long again
_FILLED = 1.5  # largest ratio of stored entries to nonzeros in a panel


class Factors(NamedTuple):
    """The factors L D L^T of a mass, as compiled code takes them.

    Attributes
    ----------
    order : ndarray of int, shape (n,)
        The degrees of freedom in the order of elimination.
    panels : ndarray of int, shape (panels + 1, 3)
        The begins of the columns, the rows and the values of each panel.
    rows : ndarray of int
        The degrees of freedom below each panel.
    values : ndarray
        The entries of L below the diagonal: in each panel first the entries of the diagonal block, then of each row
        below.
    inverse : ndarray, shape (n,)
        1 / D.
    """

    order: np.ndarray
    panels: np.ndarray
    rows: np.ndarray
    values: np.ndarray
    inverse: np.ndarray


def copies_in(mass: Any) -> int:
    """Return the number of uncoupled directions with the same mass, or 1.

    Their degrees of freedom alternate: the mass is the Kronecker product of one direction's mass and a unit matrix.
    """
    return next(count for count in EDGES if _has_copies(mass, count))


def factors(mass: Any) -> Factors:
    """Return the factors of a sparse mass, computed by SciPy.

    Raises
    ------
    ValueError
        If the mass is not positive definite.
    """
    options = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
    try:
        lu = scipy.sparse.linalg.splu(mass.tocsc(), **options)
    except RuntimeError:  # exactly singular
        raise _not_definite() from None
    pivots = lu.U.diagonal()
    if not (np.array_equal(lu.perm_r, lu.perm_c) and (pivots > 0).all() and np.isfinite(pivots).all()):
        raise _not_definite()
    order = np.argsort(lu.perm_c)
    panels, rows, values = _in_panels(scipy.sparse.csc_array(scipy.sparse.tril(lu.L, -1)))
    return Factors(order.astype(np.int32), panels, order[rows].astype(np.int32), values, 1 / pivots)


@functools.cache
def solution(copies: int) -> Any:
    """Return the compiled in-place solve of L D L^T x = b for several vectors, whose entries alternate in x.

    Its arguments are the fields of `Factors`, and x.
    """
    out = Writer()
    with out.block("def solution(order, panels, rows, values, inverse, x)"):
        for panels, write in (("0, len(panels) - 1", _forward), ("len(panels) - 2, -1, -1", _backward)):
            with out.block(f"for s in range({panels})"):
                out.line("j, width = panels[s, 0], panels[s + 1, 0] - panels[s, 0]", "first = unsigned(panels[s, 2])")
                for width in _WIDTHS:
                    with out.block(f"if width == {width}"):
                        out.line(*(f"i_{k} = unsigned({copies}) * unsigned(order[j + {k}])" for k in range(width)))
                        write(out, width, copies)
    names = {"__name__": __name__, "unsigned": np.uint64}
    return element(define(str(out), "solution", names)["solution"])


def _forward(out: Writer, width: int, copies: int) -> None:
    """Subtract the columns of a panel from the later rows."""
    own = [(k, c) for k in range(width) for c in range(copies)]
    out.line(*(f"x_{k}_{c} = x[i_{k} + unsigned({c})]" for k, c in own))
    out.line(*(f"x_{i}_{c} -= values[first + unsigned({_place(i, k)})] * x_{k}_{c}" for i, c in own for k in range(i)))
    out.line(*(f"x[i_{k} + unsigned({c})] = x_{k}_{c}" for k, c in own))
    with _below(out, width, copies):
        for c in range(copies):
            terms = [f"values[at + unsigned({k})] * x_{k}_{c}" for k in range(width)]
            out.line(f"x[i + unsigned({c})] -= {' + '.join(terms)}")


def _backward(out: Writer, width: int, copies: int) -> None:
    """Subtract the later rows from the rows of a panel."""
    own = [(k, c) for k in range(width) for c in range(copies)]
    out.line(*(f"x_{k}_{c} = x[i_{k} + unsigned({c})] * inverse[j + {k}]" for k, c in own))
    with _below(out, width, copies):
        out.line(*(f"y_{c} = x[i + unsigned({c})]" for c in range(copies)))
        out.line(*(f"x_{k}_{c} -= values[at + unsigned({k})] * y_{c}" for k, c in own))
    for i, c in reversed(own):
        out.line(*(f"x_{k}_{c} -= values[first + unsigned({_place(i, k)})] * x_{i}_{c}" for k in range(i)))
    out.line(*(f"x[i_{k} + unsigned({c})] = x_{k}_{c}" for k, c in own))


@contextmanager
def _below(out: Writer, width: int, copies: int) -> Iterator[None]:
    """Write a loop over the rows below a panel."""
    out.line(f"at = first + unsigned({_place(width, 0)})")
    with out.block("for q in range(unsigned(panels[s, 1]), unsigned(panels[s + 1, 1]))"):
        out.line(f"i = unsigned({copies}) * unsigned(rows[q])")
        yield
        out.line(f"at += unsigned({width})")


def _place(i: int, k: int) -> int:
    """Return the place of row i and column k in the values of the diagonal block of a panel."""
    return i * (i - 1) // 2 + k


def _in_panels(L: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the panels, rows and values of a strict triangle in compressed columns."""
    begins, rows, values = [(0, 0, 0)], [], []
    while begins[-1][0] < L.shape[0]:
        column, row, value = begins[-1]
        width, below = _panel(L, column)
        full = np.zeros((width + len(below), width))
        for k in range(width):
            entries = slice(*L.indptr[column + k : column + k + 2])
            i = L.indices[entries]
            full[np.where(i < column + width, i - column, width + np.searchsorted(below, i)), k] = L.data[entries]
        rows.append(below)
        values += [full[i, :i] for i in range(width)] + [full[width:].ravel()]
        begins.append((column + width, row + len(below), value + _place(width, 0) + full[width:].size))
    return np.array(begins), np.concatenate(rows), np.concatenate(values)


def _panel(L: Any, column: int) -> tuple[int, np.ndarray]:
    """Return the width of the panel that begins with a column, and the rows below it."""
    for width in _WIDTHS:
        end = min(column + width, L.shape[0])
        entries = L.indices[slice(*L.indptr[[column, end]])]
        below = np.unique(entries[entries >= end])
        if end == column + width and width * len(below) + _place(width, 0) <= _FILLED * entries.size:
            break
    return width, below


def _has_copies(mass: Any, count: int) -> bool:
    """Whether a matrix is the Kronecker product of another matrix with the unit matrix of this size."""
    if mass.shape[0] % count:
        return False
    entries = mass.tocoo()
    if ((entries.row - entries.col) % count).any():
        return False
    first, *others = (mass[i::count][:, i::count] for i in range(count))
    return all(abs(first - other).max() <= _SAME * abs(first).max() for other in others)


def _not_definite() -> ValueError:
    return ValueError(
        "M must be positive definite, but a motion has zero or negative mass: remove the degrees of freedom "
        'without mass, or lump it with lump="hrz".'
    )
