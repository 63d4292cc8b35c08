"""Damping of a structure without a matrix: Rayleigh and modal damping."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..functions.checks import check_count, reals
from .matrices import Mass
from .modes import highest_frequency, natural_modes


@dataclass(frozen=True)
class Rayleigh:
    """Damping C = a M + b K with given ratios at two frequencies, or in two modes.

    The damping ratio of a mode is a / (2 omega) + b omega / 2: lower between the two frequencies, and higher outside.

    Parameters
    ----------
    xi : float or (float, float)
        The damping ratio at both frequencies, or at each frequency.
    omega1, omega2 : float
        The angular frequencies, rad/s.
    modes : (int, int)
        In place of the frequencies: two modes of the structure, such as (1, 3). Mode 1 has the lowest frequency.

    Raises
    ------
    TypeError, ValueError
        If a ratio is not from 0 to 1, or the frequencies are not positive and different.

    Notes
    -----
    Other codes: OpenSees ``rayleigh(alphaM, 0, betaKinit, 0)``, with a and b in `coefficients`.

    Not included: a K that changes in the run; a corotational frame has K at rest.
    """

    xi: Any
    omega1: float | None = None
    omega2: float | None = None
    modes: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        xi = reals(self.xi, "xi")
        if xi.shape not in ((), (2,)) or not ((xi >= 0) & (xi <= 1)).all():
            raise ValueError(
                f"xi must be a damping ratio from 0 to 1, such as 0.05 for 5 %, or a pair of them, not {self.xi!r}."
            )
        if [x is None for x in (self.modes, self.omega1, self.omega2)] not in (
            [True, False, False],
            [False, True, True],
        ):
            raise TypeError("Rayleigh takes two frequencies, omega1 and omega2, or modes=(i, j).")
        if self.modes is not None:
            if np.shape(self.modes) != (2,) or len({check_count(mode, "a mode") for mode in self.modes}) != 2:
                raise ValueError(f"modes must be two different modes, not {self.modes!r}.")
            return
        omega = reals([self.omega1, self.omega2], "omega1 and omega2")
        if not (np.isfinite(omega).all() and (omega > 0).all() and omega[0] != omega[1]):
            raise ValueError(f"omega1 and omega2 must be positive and differ, not {omega[0]:g} and {omega[1]:g}.")

    def of(self, mass: Mass, K: Any) -> Rayleigh:
        """Return the damping with the frequencies of a structure in place of its modes.

        Raises
        ------
        ValueError
            If a mode is a rigid motion, or a mode of the structure would have a negative damping ratio, and grow.
        """
        found = self
        if self.modes is not None:
            i, j = self.modes
            omega = natural_modes(mass, K, max(i, j))[0]
            for mode in self.modes:
                if omega[mode - 1] == 0:
                    raise ValueError(
                        f"modes must vibrate, but mode {mode} is a rigid motion of K, which does not include links: "
                        "give C = b K in place of damping, or the frequencies omega1 and omega2."
                    )
            found = Rayleigh(self.xi, float(omega[i - 1]), float(omega[j - 1]))
        a, b = found.coefficients
        if min(a, b) < 0:
            last = highest_frequency(mass, K) if b < 0 else float(natural_modes(mass, K, 1)[0][0])
            if a + b * last**2 < 0:
                raise ValueError(
                    f"xi gives the mode of {last:.4g} rad/s a negative damping ratio, with which it grows: take ratios "
                    f"that differ less, or frequencies that differ more."
                )
        return found

    @property
    def coefficients(self) -> tuple[float, float]:
        """The factors a of M, 1/s, and b of K, s.

        Raises
        ------
        ValueError
            If the damping is given by modes, whose frequencies depend on the structure.
        """
        if self.omega1 is None or self.omega2 is None:
            raise ValueError("the coefficients depend on the structure: problem.params.a and .b have them.")
        (w1, w2), xi = (float(self.omega1), float(self.omega2)), np.broadcast_to(self.xi, 2)
        a, b = np.linalg.solve([[1 / (2 * w1), w1 / 2], [1 / (2 * w2), w2 / 2]], xi)
        return float(a), float(b)


@dataclass(frozen=True, eq=False)
class Modal:
    """Damping of the lowest modes with given ratios; the other modes are undamped.

    Parameters
    ----------
    xi : float or array_like, shape (k,)
        The damping ratio of these modes, or of each mode.
    modes : int
        The number k of modes.

    Raises
    ------
    TypeError, ValueError
        If a ratio is negative, or the numbers do not match.

    Notes
    -----
    Formula: C = sum over the modes of 2 xi omega (M phi) (M phi)^T, for modes phi with phi^T M phi = 1.

    Other codes: OpenSees ``modalDamping``.

    Not included: modes that change in the run. Another K or mass in `with_`, an ensemble or a fit is refused: make
    another problem of `eig3.linear`.
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
