"""Damping of a structure by a few numbers in place of a matrix."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse.linalg
from numpy.typing import ArrayLike

from ..functions.checks import check_count, reals
from .matrices import Mass

_ALL = 0.5  # part of the modes from which on all of them are computed by full matrices
_SHIFT = 1e-9  # of the largest square of a frequency
_FULL = 500  # degrees of freedom of full matrices


@dataclass(frozen=True)
class Rayleigh:
    """Damping C = a M + b K with given ratios at two frequencies.

    The damping ratio of a mode is a / (2 omega) + b omega / 2: it is less between the two frequencies, and more beyond
    them.

    Parameters
    ----------
    xi : float or (float, float)
        The damping ratio at both frequencies, or at each of them.
    omega1, omega2 : float
        The angular frequencies, rad/s.

    Raises
    ------
    TypeError, ValueError
        If a ratio is negative, or the frequencies are not positive and different.

    Notes
    -----
    Other codes: OpenSees ``rayleigh(alphaM, betaK, 0, 0)``, with a and b in `coefficients`.

    Not included: corotational frames, and a K that changes in the run.
    """

    xi: Any
    omega1: float
    omega2: float

    def __post_init__(self) -> None:
        xi, omega = reals(self.xi, "xi"), reals([self.omega1, self.omega2], "omega1 and omega2")
        if xi.shape not in ((), (2,)) or not (np.isfinite(xi).all() and (xi >= 0).all()):
            raise ValueError(f"xi must be a damping ratio of at least 0, or a pair of them, not {self.xi!r}.")
        if not (np.isfinite(omega).all() and (omega > 0).all() and omega[0] != omega[1]):
            raise ValueError(f"omega1 and omega2 must be positive and differ, not {omega[0]:g} and {omega[1]:g}.")

    @property
    def coefficients(self) -> tuple[float, float]:
        """The factors a of M, 1/s, and b of K, s."""
        (w1, w2), xi = (float(self.omega1), float(self.omega2)), np.broadcast_to(self.xi, 2)
        a, b = np.linalg.solve([[1 / (2 * w1), w1 / 2], [1 / (2 * w2), w2 / 2]], xi)
        return float(a), float(b)


@dataclass(frozen=True, eq=False)
class Modal:
    """Damping of the lowest modes, each with its ratio; the others are not damped.

    Parameters
    ----------
    xi : float or array_like, shape (k,)
        The damping ratio of all these modes, or of each.
    modes : int
        The number k of modes.

    Raises
    ------
    TypeError, ValueError
        If a ratio is negative, or the numbers do not fit.

    Notes
    -----
    Formula: C = sum over the modes of 2 xi omega (M phi) (M phi)^T, for modes phi with phi^T M phi = 1.

    Other codes: OpenSees ``modalDamping``.

    Not included: modes that change in the run.
    """

    xi: ArrayLike
    modes: int

    def __post_init__(self) -> None:
        k, xi = check_count(self.modes, "modes"), reals(self.xi, "xi")
        if xi.shape not in ((), (k,)) or not (np.isfinite(xi).all() and (xi >= 0).all()):
            raise ValueError(f"xi must be a damping ratio of at least 0, or one for each of the {k} modes.")

    def factors(self, mass: Mass, K: Any) -> tuple[np.ndarray, np.ndarray]:
        """Return the modes, shape (k, n), and M times each, times 2 xi omega."""
        omega, shapes = natural_modes(mass, K, self.modes)
        rates = 2 * np.broadcast_to(reals(self.xi, "xi"), omega.shape) * omega
        return np.ascontiguousarray(shapes.T), np.ascontiguousarray((mass.matrix @ shapes * rates).T)


def natural_modes(mass: Mass, K: Any, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest angular frequencies, rad/s, and the modes, shape (n, k), with M as their unit matrix.

    Raises
    ------
    ValueError
        If there are fewer modes.
    """
    n = mass.n
    if count > n:
        raise ValueError(f"modes must be at most the {n} degrees of freedom, not {count}.")
    if n <= _FULL or count > _ALL * n:
        squares, shapes = scipy.linalg.eigh(K.toarray(), mass.matrix.toarray(), subset_by_index=(0, count - 1))
    else:
        shift = -_SHIFT * K.diagonal().max() / mass.matrix.diagonal().max()  # also K of a free structure has an inverse
        squares, shapes = scipy.sparse.linalg.eigsh(K, count, mass.matrix, sigma=shift)
        order = np.argsort(squares)
        squares, shapes = squares[order], shapes[:, order]
    return np.sqrt(np.maximum(squares, 0.0)), shapes
