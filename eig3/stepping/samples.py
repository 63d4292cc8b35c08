"""Sample points for quantities within a step of variable length."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from ..kernels.protocol import Within


def within_steps(before: np.ndarray, n: int, formulas: Any, floors: np.ndarray) -> Within:
    """Return the sample points within a step, and scratch for the values, for `eig3.kernels.loops.extremes_within`.

    `before` has the values of all quantities at the start of the next step. The polynomial through the values has the
    degree of the order of the method, or the next even degree: a smooth quantity then differs from it by a term of the
    order of the error of the step. Relative changes within a step below the `floors` of a quantity are ignored.
    """
    degree = formulas.order + formulas.order % 2
    shapes = (degree + 2, len(before)), (degree + 2,), (degree + 1,), (2, n), (2 * formulas.terms, n)
    return Within(*_fit(degree), floors, before, *(np.empty(shape) for shape in shapes))


@functools.cache
def _fit(degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the extremes of the Chebyshev polynomial of a degree, as fractions of the step from 0 to 1, and the
    coefficients of the polynomial in 2 s - 1 for a value of 1 at one of these points and 0 at the others."""
    x = -np.cos(np.pi * np.arange(degree + 1) / degree)
    return (1 + x) / 2, np.ascontiguousarray(np.linalg.inv(np.vander(x, increasing=True)))
