"""Compiled products with sparse matrices.

Indices are unsigned: Numba wraps negative signed indices, and the test takes as long as the products.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from ..kernels.compile.jit import element
from ..kernels.compile.source import Writer, define

#: The sizes of blocks for which there is code.
EDGES = 3, 2, 1

_NAMES = {"__name__": __name__, "unsigned": np.uint64, "one": np.uint64(1), "two": np.uint64(2)}

# Two alternating sums, because one sum would be limited by the latency of the addition.
_ROW = """\
def product(data, indices, indptr, row, x{further}):
    first, last = unsigned(indptr[row]), unsigned(indptr[row + 1])
    total, other = 0.0, 0.0
    for k in range(first + one, last, two):
        i, j = unsigned(indices[k - one]), unsigned(indices[k])
        total += data[k - one] * ({at_i})
        other += data[k] * ({at_j})
    if (last - first) & one:
        i = unsigned(indices[last - one])
        total += data[last - one] * ({at_i})
    return (total + other,)
"""


@functools.cache
def product(edge: int, has_rate: bool) -> Any:
    """Return the compiled rows of a product A x or, with a rate, A (x + rate v).

    The arguments are the three arrays of A, with blocks in one axis, a row of blocks, x, and with a rate also rate and
    v. The product returns `edge` sums.
    """
    further = ", rate, v" if has_rate else ""
    at = "x[{0}] + rate * v[{0}]" if has_rate else "x[{0}]"
    if edge == 1:
        text = _ROW.format(further=further, at_i=at.format("i"), at_j=at.format("j"))
        return element(define(text, "product", _NAMES)["product"])
    out, sums = Writer(), [f"sum_{i}" for i in range(edge)]
    with out.block(f"def product(data, indices, indptr, row, x{further})"):
        out.line(f"{' = '.join(sums)} = 0.0")
        with out.block("for k in range(unsigned(indptr[row]), unsigned(indptr[row + 1]))"):
            out.line(f"i, b = unsigned({edge}) * unsigned(indices[k]), unsigned({edge * edge}) * k")
            out.line(*(f"x_{j} = {at.format(f'i + unsigned({j})')}" for j in range(edge)))
            for i in range(edge):
                terms = [f"data[b + unsigned({edge * i + j})] * x_{j}" for j in range(edge)]
                out.line(f"{sums[i]} += {' + '.join(terms)}")
        out.line(f"return {', '.join(sums)}")
    return element(define(str(out), "product", _NAMES)["product"])
