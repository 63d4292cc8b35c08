"""Stability on the oscillator u'' + 2 xi omega u' + omega^2 u = 0, read off the kernels themselves."""

import dataclasses
import functools

import numpy as np

from .callbacks import check_callback, jit
from .checks import check_method
from .kernels.jit import SCALAR, pointer_kernel
from .methods import Method

_ROUND_OFF = 1e-11  # of an eigenvalue: its pair is 1e-5 apart where the limit is bisected to 1e-10
_REGULAR_STEP = 16  # a step index past every method's starting procedure


@jit
def _oscillator(t: float, u: float, v: float, p: np.ndarray) -> float:
    return -p[0] * p[0] * u - 2 * p[1] * p[0] * v


def amplification_matrix(method: str | Method, Omega: float, xi: float = 0.0) -> np.ndarray:
    """The matrix of one step on (u, h v, ...), found by stepping the kernel from each unit state.

    Parameters
    ----------
    method : str or Method
    Omega : float
        omega h.
    xi : float
        Physical damping ratio.

    Returns
    -------
    ndarray, shape (k, k)
        k is 2 and the number of past values the method carries. The step is taken as h = 1. A column is NaN where an
        implicit method's solve fails.
    """
    method = check_method(method)
    if method.jacobian is not None:  # that of another system
        method = dataclasses.replace(method, jacobian=None)  # type: ignore[type-var]
    kernel = pointer_kernel(method.function(SCALAR), SCALAR)
    rhs = check_callback(_oscillator, "rhs", SCALAR)
    size = 2 + len(method.module.start(1.0, 1.0, 1.0, 1.0))
    settings, params, nowhere = np.array(method.settings), np.array([Omega, xi]), np.empty(0)
    columns = []
    for state in np.eye(size):
        run = (1.0, 0.0, params, _REGULAR_STEP, 1, 2**62, nowhere, nowhere)
        taken = kernel(rhs, state, settings, np.zeros(4), run)
        columns.append(state if taken else np.full(size, np.nan))
    return np.array(columns).T


def spectral_radius(method: str | Method, Omega: float, xi: float = 0.0) -> float:
    """The largest absolute value of an eigenvalue of the amplification matrix; infinite where a solve fails."""
    matrix = amplification_matrix(method, Omega, xi)
    return float(np.abs(np.linalg.eigvals(matrix)).max()) if np.isfinite(matrix).all() else np.inf


@functools.cache
def limit(method: str | Method, xi: float = 0.0) -> float:
    """The Omega up to which `method` is stable on the oscillator; 0.0 where it is unstable for every step."""
    stable, step = 0.0, 0.05
    unstable = step
    while spectral_radius(method, unstable, xi) <= 1 + _ROUND_OFF:
        stable, unstable = unstable, unstable + step
        if unstable > 100:
            return float("inf")
    if stable == 0.0:
        return 0.0
    while unstable - stable > 1e-10:
        middle = (stable + unstable) / 2
        if spectral_radius(method, middle, xi) <= 1 + _ROUND_OFF:
            stable = middle
        else:
            unstable = middle
    return stable
