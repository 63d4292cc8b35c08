"""The growth a step of the EIG members, from their rational coefficients, however small it is.

A growth of 1e-13 is lost in the round-off of an eigenvalue. Here a root is found in double precision, and then improved
by Newton's method with residuals in rational arithmetic.
"""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np

from eig3.kernels.methods.eig import kappa, ordinates, sigma

_ITERATIONS = 4  # each adds about ten digits: the derivative is taken at the first root

Polynomial = list[Fraction]  # the coefficients, in descending powers


def oscillator_growth(grade: int, Omega: float) -> float:
    """|z| - 1 of the largest root on u'' = -omega^2 u, where Omega = omega h."""
    p = grade - 1
    square = Fraction(Omega) ** 2
    inertia = [Fraction(1), Fraction(-2), Fraction(1)] + [Fraction(0)] * (p - 2)  # (z - 1)^2 z^(p-2)
    return _growth(_sum(inertia, [square * x for x in ordinates(sigma(p))]), [Fraction(0)])


def gyroscope_growth(grade: int, k: float) -> float:
    """|z| - 1 of the largest root on v' = i kappa v, where k = kappa h, without the root 1 of a body at rest.

    f is given the predicted velocity, so that (z - 1) (z^(p-1) - i k kappa(z)) = i k sigma(z).
    """
    p = grade - 1
    predicted = ordinates(kappa(p - 1))
    inertia = [Fraction(1), Fraction(-1)] + [Fraction(0)] * (p - 1)  # (z - 1) z^(p-1)
    force = _sum(ordinates(sigma(p)), _sum([*predicted, Fraction(0)], [-x for x in predicted]))
    return _growth(inertia, [-Fraction(k) * x for x in force])


def _sum(a: Polynomial, b: Polynomial) -> Polynomial:
    count = max(len(a), len(b))
    a, b = ([Fraction(0)] * (count - len(x)) + x for x in (a, b))
    return [x + y for x, y in zip(a, b, strict=True)]


def _growth(real: Polynomial, imaginary: Polynomial) -> float:
    """|z| - 1 of the largest root z of real(z) + i imaginary(z)."""
    imaginary = _sum(imaginary, [Fraction(0)] * len(real))
    polynomial = np.array(real, dtype=float) + 1j * np.array(imaginary, dtype=float)
    roots = np.roots(polynomial)
    root = complex(roots[np.abs(roots).argmax()])
    derivative = complex(np.polyval(np.polyder(polynomial), root))
    x, y = Fraction(root.real), Fraction(root.imag)
    for _ in range(_ITERATIONS):
        value_re, value_im = Fraction(0), Fraction(0)
        for c_re, c_im in zip(real, imaginary, strict=True):
            value_re, value_im = value_re * x - value_im * y + c_re, value_re * y + value_im * x + c_im
        step = complex(value_re, value_im) / derivative
        x, y = x - Fraction(step.real), y - Fraction(step.imag)
    return math.expm1(math.log1p(float(x * x + y * y - 1)) / 2)
