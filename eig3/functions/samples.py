"""Where a quantity is evaluated within a step of variable length."""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np


class Samples(NamedTuple):
    """The values of a quantity within a step, as `eig3.kernels.loops.within` takes them.

    Attributes
    ----------
    points : ndarray, shape (m + 1,)
        Fractions of the step, from 0 to 1: the extremes of the Chebyshev polynomial of degree m.
    fit : ndarray, shape (m + 1, m + 1)
        The coefficients of the polynomial in 2 s - 1 for a value of 1 at one of the points and 0 at the others.
    floor : float
        Changes within a step of at most this part of a value are not looked at.
    before : ndarray, shape (k,)
        The values at the start of the next step.
    values, times : ndarray, shape (m + 2, k) and (m + 2,)
        Scratch for the values and the times at the points, and at one more.
    coefficients : ndarray, shape (m + 1,)
        Scratch for the coefficients of a polynomial.
    state : ndarray, shape (2, n)
        Scratch for u and v.
    """

    points: np.ndarray
    fit: np.ndarray
    floor: float
    before: np.ndarray
    values: np.ndarray
    times: np.ndarray
    coefficients: np.ndarray
    state: np.ndarray

    @classmethod
    def of(cls, start: np.ndarray, n: int, order: int, floor: float) -> Samples:
        """Return the samples of a quantity with the values `start` at the start, for a method of an order.

        The polynomial has the degree of the order, or the next even one: a smooth quantity then differs from it by a
        term of the order of the error of the step.
        """
        degree = order + order % 2
        shapes = (degree + 2, len(start)), (degree + 2,), (degree + 1,), (2, n)
        return cls(*_fit(degree), floor, start.copy(), *(np.empty(shape) for shape in shapes))

    def copy(self) -> Samples:
        """Return independent samples with the same values at the start of the next step."""
        return Samples(*self[:3], *(x.copy() for x in self[3:]))


@functools.cache
def _fit(degree: int) -> tuple[np.ndarray, np.ndarray]:
    x = -np.cos(np.pi * np.arange(degree + 1) / degree)
    return (1 + x) / 2, np.ascontiguousarray(np.linalg.inv(np.vander(x, increasing=True)))
