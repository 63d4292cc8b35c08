"""The covariance of parameters that were found by least squares."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

_DOUBTFUL = 1e-3  # from here on, the error of one-sided differences might make values look determined
_DEPENDENT = 1e-7  # a singular value below this part of the largest one is that of values the data do not tell apart
_INVOLVED = 1e-2  # least part of a value in such a combination


def is_doubtful(jacobian: np.ndarray) -> bool:
    """Return whether derivatives must be more exact, because their smallest singular value is small."""
    s = np.linalg.svd(jacobian, compute_uv=False)
    return bool(s[-1] <= _DOUBTFUL * s[0])


def covariance(
    jacobian: np.ndarray, sizes: np.ndarray, is_free: np.ndarray, variance: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the covariance ``variance * inverse(J^T J)`` of the free parameters, and which of them are not determined.

    To the first order, this is the covariance of a least-squares estimate (Seber and Wild, Nonlinear Regression, 1989,
    section 2.1). It follows from the singular values of J, which lose no digits in J^T J.

    Parameters
    ----------
    jacobian : ndarray, shape (m, p)
        The derivatives J of the weighted residuals by the parameters, as parts of their sizes.
    sizes : ndarray, shape (p,)
        The sizes of the parameters.
    is_free : ndarray of bool, shape (p,)
        Parameters that are not at a bound. The others are held, and their rows and columns are NaN.
    variance : float
        That of the weighted residuals.

    Returns
    -------
    matrix : ndarray, shape (p, p)
        With infinite variances and NaN covariances of parameters that the data do not determine.
    is_loose : ndarray of bool, shape (p,)
    """
    p = len(sizes)
    found, is_loose = np.full((p, p), np.nan), np.zeros(p, dtype=bool)
    free = np.flatnonzero(is_free)
    if not free.size:
        return found, is_loose
    _, s, rows = np.linalg.svd(jacobian[:, free], full_matrices=False)
    is_small = s <= _DEPENDENT * s[0]
    scaled = rows[~is_small] / s[~is_small, None]
    found[np.ix_(free, free)] = variance * (scaled.T @ scaled) * np.outer(sizes[free], sizes[free])
    is_loose[free] = (np.abs(rows[is_small]) > _INVOLVED).any(axis=0)
    found[is_loose], found[:, is_loose] = np.nan, np.nan
    found[is_loose, is_loose] = np.inf
    return found, is_loose


def correlation(matrix: np.ndarray) -> np.ndarray:
    """Return the correlations of a covariance; NaN where they are not known."""
    errors = np.sqrt(np.diag(matrix))
    with np.errstate(invalid="ignore"):
        return matrix / np.outer(errors, errors)


def loose_note(names: Sequence[str], is_loose: np.ndarray) -> str:
    """Return a sentence about parameters that the data do not determine; empty if there are none."""
    loose = [name for name, each in zip(names, is_loose, strict=True) if each]
    if not loose:
        return ""
    if len(loose) == 1:
        return f" The data do not depend on {loose[0]}: leave it out of parameters."
    return f" The data do not tell {', '.join(loose[:-1])} and {loose[-1]} apart: leave one of them out of parameters."
