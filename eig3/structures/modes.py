"""The natural modes of a structure: frequencies, shapes, participation and effective masses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse.linalg

from .matrices import Mass

_ALL = 0.5  # with a larger share of the modes, all modes are computed by full matrices
_SHIFT = 1e-9  # relative to the largest square of a frequency
_NEGATIVE = 1e-11  # the same; more is not round-off
_ZERO = 1e-14  # the same; less is round-off of a rigid-body mode, which is at most 1e-16
_FULL = 500  # up to this number of degrees of freedom, full matrices are used


@dataclass(frozen=True, eq=False)
class Modes:
    """The lowest natural modes of an undamped structure, the lowest frequency first.

    `print` shows a table of them.

    Attributes
    ----------
    omega : ndarray, shape (k,)
        The angular frequencies, rad/s; 0 for a mode of a rigid body.
    shapes : ndarray, shape (k, n)
        The displacements of each mode, with phi^T M phi = 1.
    participation : ndarray, shape (k,)
        The participation factors phi^T M r for a ground motion with the influence r.
    effective_masses : ndarray, shape (k,)
        The squares of the participation factors. The sum over all modes is the total mass.
    total_mass : float
        r^T M r.

    Notes
    -----
    Source: Chopra, Dynamics of Structures, sections 13.1 and 13.2.

    Other codes: OpenSees ``eigen`` and ``modalProperties``.
    """

    omega: np.ndarray
    shapes: np.ndarray
    participation: np.ndarray
    effective_masses: np.ndarray
    total_mass: float

    @property
    def frequencies(self) -> np.ndarray:
        """The frequencies, Hz, shape (k,)."""
        return self.omega / (2 * np.pi)

    def __repr__(self) -> str:
        parts = 100 * self.effective_masses / self.total_mass
        lines = [f"{'mode':>4} {'omega, rad/s':>13} {'f, Hz':>10} {'mass, %':>9} {'sum, %':>9}"]
        for k, (omega, f, part, total) in enumerate(
            zip(self.omega, self.frequencies, parts, np.cumsum(parts), strict=True), start=1
        ):
            lines.append(f"{k:>4} {omega:>13.5g} {f:>10.4g} {part:>9.2f} {total:>9.2f}")
        return "\n".join(lines)


def modes_of(mass: Mass, K: Any, count: int, influence: np.ndarray) -> Modes:
    """Return the lowest modes, with their participation in a ground motion of this influence."""
    omega, shapes = natural_modes(mass, K, count)
    moved = mass.matrix @ influence
    participation = shapes.T @ moved
    return Modes(omega, np.ascontiguousarray(shapes.T), participation, participation**2, float(influence @ moved))


def natural_modes(mass: Mass, K: Any, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest angular frequencies, rad/s, and the modes, shape (n, k), normalised with M.

    The frequency of a rigid-body mode is 0.

    Raises
    ------
    ValueError
        If there are fewer modes, or K has a negative eigenvalue.
    """
    n = mass.n
    if count > n:
        raise ValueError(f"modes must be at most the {n} degrees of freedom, not {count}.")
    if n <= _FULL or count > _ALL * n:
        squares, shapes = scipy.linalg.eigh(K.toarray(), mass.matrix.toarray(), subset_by_index=(0, count - 1))
    else:
        shift = -_SHIFT * K.diagonal().max() / mass.matrix.diagonal().max()  # K of a free structure is singular
        squares, shapes = scipy.sparse.linalg.eigsh(K, count, mass.matrix, sigma=shift)
        order = np.argsort(squares)
        squares, shapes = squares[order], shapes[:, order]
    largest = (K.diagonal() / mass.matrix.diagonal()).max()
    if squares[0] < -_NEGATIVE * largest:
        raise ValueError(
            f"K must have no negative eigenvalue: a mode has omega^2 = {squares[0]:.3g}, so the structure is unstable "
            "and has no frequency there; check the signs of K, or integrate the problem."
        )
    return np.sqrt(np.where(squares > _ZERO * largest, squares, 0.0)), shapes


def highest_frequency(mass: Mass, K: Any) -> float:
    """Return the highest angular frequency, rad/s."""
    if mass.n <= _FULL:
        squares = scipy.linalg.eigh(
            K.toarray(), mass.matrix.toarray(), eigvals_only=True, subset_by_index=(mass.n - 1, mass.n - 1)
        )
    else:
        squares = scipy.sparse.linalg.eigsh(K, 1, mass.matrix, which="LA", return_eigenvectors=False)
    return float(np.sqrt(squares[0]))
