"""The covariance of least-squares estimates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

_DOUBTFUL = 1e-3  # below this singular value, errors of one-sided differences might make parameters look determined
_DEPENDENT = 1e-7  # smaller singular values, relative to the largest, belong to undetermined parameters
_REST, _BEYOND = 0.5, 10.0  # parts of the residuals, and multiples of their errors, that a further step would remove
_FAR = 2.0  # multiple of the spread of the data that the residuals of a right model do not exceed
_INVOLVED = 1e-2  # least share of a parameter in such a combination


def is_doubtful(jacobian: np.ndarray) -> bool:
    """Return whether the derivatives must be more accurate, because their smallest singular value is small."""
    s = np.linalg.svd(jacobian, compute_uv=False)
    return bool(s[-1] <= _DOUBTFUL * s[0])


def covariance(
    jacobian: np.ndarray, sizes: np.ndarray, is_free: np.ndarray, variance: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the covariance ``variance * inverse(J^T J)`` of the free parameters, and a mask of undetermined ones.

    To the first order, this is the covariance of a least-squares estimate (Seber and Wild, Nonlinear Regression, 1989,
    section 2.1). It is computed from the singular values of J, without the round-off of J^T J. J has the derivatives of
    the weighted residuals with respect to the p parameters, scaled by their sizes.

    Parameters that are not free are at a bound: their rows and columns are NaN. Parameters that the data do not
    determine have infinite variances, and covariances that are NaN.
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


def loose_note(names: Sequence[str], is_loose: np.ndarray, jacobian: np.ndarray) -> str:
    """Return sentences about parameters that the data do not determine; empty if there are none."""
    sizes = np.linalg.norm(jacobian, axis=0)
    is_tied = is_loose & (sizes > _DEPENDENT * sizes.max())
    if np.count_nonzero(is_tied) == 1:
        is_tied[:] = False
    idle, tied = (np.array(names)[mask] for mask in (is_loose & ~is_tied, is_tied))
    note = ""
    if len(idle):
        them = "it" if len(idle) == 1 else "them"
        note += f" The data do not depend on {' or '.join(idle)}: leave {them} out of parameters."
    if len(tied):
        note += (
            f" The data do not tell {', '.join(tied[:-1])} and {tied[-1]} apart: leave one of them out of parameters."
        )
    return note


def steps_note(names: Sequence[str], shifts: np.ndarray, errors: np.ndarray) -> str:
    """Return a sentence about parameters that the time steps shift by more than their errors; empty if none are."""
    shifted = [name for name, shift, error in zip(names, shifts, errors, strict=True) if shift > error]
    if not shifted:
        return ""
    return f" The time steps shift {', '.join(shifted)} by more than the standard errors: take a smaller h or rtol."


def far_note(scatter: float, spread: float, least: float) -> str:
    """Return a sentence if the residuals scatter far more than the data do about their means; empty otherwise.

    A scatter up to about `least` is explained by the noise or by round-off.
    """
    if not scatter > _FAR * max(spread, least):
        return ""
    return (
        f" The residuals have a standard deviation of {scatter:.2g}, and the data have only {spread:.2g} about their "
        "mean: the standard errors mean nothing. Start from other values, or take a shorter step."
    )


def early_note(jacobian: np.ndarray, residuals: np.ndarray, of_steps: np.ndarray) -> str:
    """Return a sentence, beginning with a space, if a Gauss-Newton step from the end would still reduce the residuals.

    It is empty where the errors `of_steps` of the residuals may be the reason.
    """
    rest = np.linalg.norm(jacobian @ (np.linalg.pinv(jacobian) @ residuals))
    if rest <= max(_REST * np.linalg.norm(residuals), _BEYOND * np.linalg.norm(np.nan_to_num(of_steps))):
        return ""
    return " It is not at the least sum, because the steps change with the parameters: take a smaller rtol, or h."
