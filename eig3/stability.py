"""Stability and accuracy of the compiled kernels on the oscillator u'' + 2 xi omega u' + omega^2 u = 0."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .callbacks import cached_jit, check_callback
from .checks import check_method
from .kernels.fixed import pointer_kernel
from .kernels.protocol import VECTOR, Run
from .methods import EIG3, Method

_ROUND_OFF = 1e-11  # round-off of an eigenvalue; at a limit found to 1e-10, the two of a pair are 1e-5 apart
_SIMPLE = 1e-6  # roots closer than this count as one multiple root
_SOLVED_TOGETHER = 32  # unit states of oscillators in one solve of an implicit method: its cost grows with their cube
_OSCILLATES = 1e-7  # least imaginary part of a complex root: round-off gives less to a double real root
_FURTHEST = 100.0  # a method that is stable up to this omega h counts as stable at every step
_TRACKING = 0.01  # increment of omega h with which the principal root is followed


def amplification_matrix(method: str | Method, Omega: ArrayLike, xi: ArrayLike = 0.0) -> np.ndarray:
    """The matrix of one step on (u, h v, ...). Its columns are one step of the kernel from each unit state.

    Parameters
    ----------
    method : str or Method
    Omega : float or array_like
        omega h.
    xi : float or array_like
        Physical damping ratio; broadcast against Omega.

    Returns
    -------
    ndarray, shape (..., k, k)
        One matrix for each Omega and xi. k is 2 plus the number of past values that the method carries. A matrix is NaN
        if the solve of an implicit method fails.
    """
    Omega, xi = np.broadcast_arrays(np.asarray(Omega, dtype=np.float64), np.asarray(xi, dtype=np.float64))
    return oscillator_matrices(method, Omega * Omega, 2 * xi * Omega)


def oscillator_matrices(method: str | Method, k: np.ndarray, c: np.ndarray) -> np.ndarray:
    """`amplification_matrix` for u'' + c u' + k u = 0 and h = 1. k and c have one shape and may be negative."""
    method = check_method(method)
    size = state_size(method)
    flat_k, flat_c = k.ravel(), c.ravel()
    each = _SOLVED_TOGETHER // size if method.is_implicit else max(1, flat_k.size)
    parts = [_matrices(method, flat_k[i : i + each], flat_c[i : i + each]) for i in range(0, flat_k.size, each)]
    matrices = np.concatenate(parts) if parts else np.empty((0, size, size))
    return matrices.reshape(*k.shape, size, size)


def _matrices(method: Method, k: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Compute the matrices of all oscillators by one step that starts all of them from every unit state."""
    size, count = state_size(method), k.size
    params = np.concatenate([np.tile(k, size), np.tile(c, size)])
    state = np.repeat(np.eye(size), count, axis=1)
    matrices = step_once(method, _oscillators, params, state).reshape(size, size, count).transpose(2, 0, 1)
    if count > 1 and np.isnan(matrices).any():  # one failed solve ends the step of all oscillators
        return np.concatenate([_matrices(method, k[i : i + 1], c[i : i + 1]) for i in range(count)])
    return matrices


@cached_jit
def _oscillators(t: float, u: np.ndarray, v: np.ndarray, p: np.ndarray, a: np.ndarray) -> None:
    n = u.size
    for j in range(n):
        a[j] = -p[j] * u[j] - p[n + j] * v[j]


def state_size(method: Method) -> int:
    """Number of values that a method carries from step to step for one degree of freedom: u, v and past values."""
    return 2 + method.formulas.past


def step_once(method: Method, rhs: Any, params: np.ndarray, state: np.ndarray) -> np.ndarray:
    """Take one step of h = 1 with the vector kernel from the rows (u, v, past ...); NaN if a solve fails."""
    method = method.fallback(1) or method
    if method.jacobian is not None:  # it is the jacobian of another system
        method = dataclasses.replace(method, jacobian=None)  # type: ignore[type-var]
    rows, n = state.shape
    formulas = method.formulas
    whole = np.zeros((formulas.state_rows(n), n))
    whole[:rows] = state
    nowhere = np.empty((0, n))
    run = Run(1.0, 0.0, params, formulas.start_steps, 1, 2**62, nowhere, nowhere)
    settings = np.array(method.settings, dtype=np.float64)
    callbacks = check_callback(rhs, "rhs", VECTOR).address, None
    taken = pointer_kernel(formulas, VECTOR)(callbacks, whole, settings, np.zeros(4), run)
    return whole[:rows] if taken else np.full_like(state, np.nan)


def characteristic_polynomial(method: str | Method, Omega: ArrayLike, xi: ArrayLike = 0.0) -> np.ndarray:
    """det(z I - A) of the amplification matrix A, by Faddeev and LeVerrier's recursion.

    Returns
    -------
    ndarray, shape (..., k + 1)
        For each Omega and xi, the coefficients of z^k, z^(k-1), ..., 1. The first is 1.
    """
    A = amplification_matrix(method, Omega, xi)
    size = A.shape[-1]
    identity = np.eye(size)
    coefficients = [np.ones(A.shape[:-2])]
    product = A
    for k in range(1, size + 1):
        coefficients.append(-np.trace(product, axis1=-2, axis2=-1) / k)
        product = A @ (product + coefficients[-1][..., None, None] * identity)
    return np.stack(coefficients, axis=-1)


def spectral_radius(method: str | Method, Omega: ArrayLike, xi: ArrayLike = 0.0) -> Any:
    """The largest absolute value of an eigenvalue of the amplification matrix; infinite if a solve fails."""
    return _unwrapped(np.abs(eigenvalues(amplification_matrix(method, Omega, xi))).max(axis=-1))


def eigenvalues(matrices: np.ndarray) -> np.ndarray:
    """The eigenvalues of each matrix of a stack; infinite for a matrix that is not finite."""
    finite = np.isfinite(matrices).all(axis=(-2, -1))
    roots = np.linalg.eigvals(np.where(finite[..., None, None], matrices, 0.0)).astype(complex)
    roots[~finite] = np.inf
    return roots


def is_stable(method: str | Method, Omega: ArrayLike, xi: ArrayLike = 0.0) -> Any:
    """Whether the method is stable on the oscillator: no root outside the unit circle, and those on it simple.

    Parameters
    ----------
    method : str or Method
    Omega, xi : float or array_like
        As for `amplification_matrix`.

    Returns
    -------
    bool or ndarray of bool

    Notes
    -----
    A growth below 1e-11 per step is not seen, because it is within the round-off of the roots.
    """
    return _unwrapped(_excess(amplification_matrix(method, Omega, xi)) <= _ROUND_OFF)


def _excess(matrices: np.ndarray) -> np.ndarray:
    """The spectral radius minus one; infinite if a root on the unit circle is not simple."""
    roots = eigenvalues(matrices)
    finite = np.isfinite(roots).all(axis=-1)
    roots[~finite] = 0.0
    # Round-off eps splits a double root by sqrt(eps), but does not move the mean of the two.
    near = np.abs(roots[..., :, None] - roots[..., None, :]) < _SIMPLE
    multiplicity = near.sum(axis=-1)
    excess = np.abs((near * roots[..., None, :]).sum(axis=-1) / multiplicity) - 1
    excess[(multiplicity > 1) & (excess > -_ROUND_OFF)] = np.inf
    return np.where(finite, excess.max(axis=-1), np.inf)


def limit(method: str | Method, xi: float = 0.0) -> float:
    """The limit of Omega = omega h below which `method` is stable on the oscillator.

    Parameters
    ----------
    method : str or Method
    xi : float
        Physical damping ratio.

    Returns
    -------
    float
        Accurate to 1e-9. It is 0.0 if every small step is unstable, and infinite if every step up to Omega = 100 is
        stable.

    Notes
    -----
    A step whose implicit solve fails counts as unstable. A method that is unstable without damping can have a limit
    below 0.01 with weak damping: this is returned as 0.0.
    """
    return _limit(check_method(method), float(xi))


@functools.cache
def _limit(method: Method, xi: float) -> float:
    def excess(Omega: np.ndarray) -> np.ndarray:
        return _excess(amplification_matrix(method, Omega, xi))

    return first_exit(excess, _ROUND_OFF)


def first_exit(
    excess: Callable[[np.ndarray], np.ndarray],
    tolerance: float,
    accuracy: float = 1e-10,
    blocks: Sequence[np.ndarray] | None = None,
) -> float:
    """The least x at which ``excess(x)`` passes `tolerance`, searched at the growing numbers of `blocks`.

    It is 0.0 if the excess grows from x = 0 on, and infinite if it never passes the tolerance.
    """
    stable = 0.0
    for block in _blocks() if blocks is None else blocks:
        unstable = np.flatnonzero(excess(block) > tolerance)
        if unstable.size:
            break
        stable = float(block[-1])
    else:
        return math.inf
    first = int(unstable[0])
    low, high = float(block[first - 1]) if first else stable, float(block[first])
    while high - low > accuracy * min(1.0, high):
        middle = (low + high) / 2
        low, high = (low, middle) if excess(np.array([middle]))[0] > tolerance else (middle, high)
    # Beyond a limit the excess rises steeply, or it is negative well before the limit. An excess that grows as a power
    # of x passes the tolerance too, but it is hardly larger a little further on.
    further, before = excess(np.array([high * 1.001, high / 2]))
    is_limit = further > 2 * tolerance or before < -tolerance
    return low if is_limit else 0.0


def _blocks() -> list[np.ndarray]:
    near = np.concatenate([0.001 * 2.0 ** np.arange(4), np.arange(0.01, 3, 0.01)])
    return [near, *(np.arange(start, start + 5, 0.01) for start in np.arange(3, _FURTHEST, 5))]


def stable_region(Omega: ArrayLike, alpha: ArrayLike = 1.0, beta: ArrayLike = 0.5, xi: ArrayLike = 0.0) -> np.ndarray:
    """Where EIG-3(alpha, beta) is stable.

    Parameters
    ----------
    Omega, alpha, beta, xi : float or array_like
        They are broadcast against each other: ``stable_region(Omega, alpha[:, None])`` is the region over
        (Omega, alpha).

    Returns
    -------
    ndarray of bool
    """
    arrays = np.broadcast_arrays(*(np.asarray(x, dtype=np.float64) for x in (Omega, alpha, beta, xi)))
    flat = np.stack([x.ravel() for x in arrays])
    region = np.empty(flat.shape[1], dtype=bool)
    sets, which = np.unique(flat[1:3], axis=1, return_inverse=True)
    for i, (one_alpha, one_beta) in enumerate(sets.T.tolist()):
        chosen = which.ravel() == i
        region[chosen] = is_stable(EIG3(one_alpha, one_beta), flat[0, chosen], flat[3, chosen])
    return region.reshape(arrays[0].shape)


def damping_ratio(method: str | Method, Omega: ArrayLike, xi: ArrayLike = 0.0) -> Any:
    """The algorithmic damping ratio -ln|z| / arg z of the principal root z; NaN if z does not oscillate.

    Parameters
    ----------
    method : str or Method
    Omega, xi : float or array_like
        As for `amplification_matrix`; Omega must be positive.

    Returns
    -------
    float or ndarray

    Notes
    -----
    The ratio of the exact solution is xi / sqrt(1 - xi^2).
    """
    size, angle = _polar(principal_root(method, Omega, xi))
    return _unwrapped(-np.log(size) / angle)


def period_error(method: str | Method, Omega: ArrayLike, xi: ArrayLike = 0.0) -> Any:
    """The relative error (T_h - T) / T of the period; NaN if the principal root does not oscillate.

    Parameters
    ----------
    method : str or Method
    Omega, xi : float or array_like
        As for `amplification_matrix`; Omega must be positive.

    Returns
    -------
    float or ndarray
        Omega sqrt(1 - xi^2) / arg z - 1 for the principal root z.
    """
    _, angle = _polar(principal_root(method, Omega, xi))
    with np.errstate(invalid="ignore"):  # xi may be above 1
        exact = np.asarray(Omega) * np.sqrt(1 - np.square(xi))
    return _unwrapped(exact / angle - 1)


def _polar(root: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """|z| and arg z, NaN if z does not oscillate."""
    oscillates = root.imag > _OSCILLATES
    return np.where(oscillates, np.abs(root), np.nan), np.where(oscillates, np.angle(root), np.nan)


def principal_root(method: str | Method, Omega: ArrayLike, xi: ArrayLike = 0.0) -> np.ndarray:
    """The eigenvalue that approximates exp((-xi + i sqrt(1 - xi^2)) Omega), followed from Omega = 0.

    It has to be followed, because at large Omega another root may be larger or closer to that exponential.
    """
    Omega, xi = np.broadcast_arrays(np.asarray(Omega, dtype=np.float64), np.asarray(xi, dtype=np.float64))
    if not (Omega > 0).all():
        raise ValueError("Omega must be positive.")
    roots = np.empty(Omega.shape, dtype=complex)
    for one_xi in np.unique(xi).tolist():
        chosen = xi == one_xi
        roots[chosen] = _follow(method, Omega[chosen], one_xi)
    return roots


def _follow(method: str | Method, Omega: np.ndarray, xi: float) -> np.ndarray:
    way = np.unique(np.concatenate([np.arange(_TRACKING, Omega.max(), _TRACKING), Omega]))
    candidates = eigenvalues(amplification_matrix(method, way, xi))
    rate = -xi + np.sqrt(complex(1 - xi * xi)) * 1j
    track = np.empty(way.shape, dtype=complex)
    root, before = 1.0 + 0j, 0.0
    for i, (here, values) in enumerate(zip(way.tolist(), candidates, strict=True)):
        expected = root * np.exp(rate * (here - before))
        nearest = values[np.argmin(np.abs(values - expected))]
        if np.isfinite(nearest):
            root, before = nearest, here
        track[i] = nearest if np.isfinite(nearest) else np.nan  # NaN if a solve fails
    return track[np.searchsorted(way, Omega)]


def explain(method: str | Method) -> str:
    """The properties of a method on the oscillator, in a few lines of text: order, limits, damping, period."""
    method = check_method(method)
    free = method.without_velocity()  # the same step on an undamped oscillator, without a solve
    undamped, evaluations = limit(free), method.evaluations
    each = (
        f"{evaluations} evaluation{'s' * (evaluations > 1)} a step"
        if evaluations
        else "a solve if the force reads velocity"
    )
    per_evaluation = f", {undamped / evaluations:.4g} per evaluation" if evaluations and 0 < undamped < math.inf else ""
    damped = ", ".join(f"{limit(method, xi):.6g} (xi = {xi:g})" for xi in (0.01, 0.1, 0.5, 1.0))
    return "\n".join(
        [
            f"{method!r}: order {method.order}, {each}.",
            f"  Undamped, it is stable {_bound(undamped)}{per_evaluation}.",
            f"  With physical damping, the limits are {damped}.",
            f"  {_leading_damping(free)}",
            f"  {_leading_period_error(free)}",
        ]
    )


def _bound(Omega: float) -> str:
    if Omega == 0:
        return "at no step, however small"
    return "at every step" if math.isinf(Omega) else f"up to omega h = {Omega:.6g}"


def _leading_damping(method: Method) -> str:
    term = _leading_term(lambda Omega: damping_ratio(method, Omega), parity=1)
    if term is None:
        return "It has no numerical damping."
    coefficient, power, shown = term
    if coefficient > 0:
        return f"It removes energy numerically: the algorithmic damping ratio is {shown} + O(Omega^{power + 2})."
    return f"It adds energy numerically: the algorithmic damping ratio is {shown} + O(Omega^{power + 2}), negative."


def _leading_period_error(method: Method) -> str:
    term = _leading_term(lambda Omega: period_error(method, Omega), parity=0)
    if term is None:
        return "Its period is exact."
    coefficient, power, shown = term
    kind = "longer" if coefficient > 0 else "shorter"
    shown = shown.removeprefix("-")
    return f"Its period is {kind} than the exact one by {shown} + O(Omega^{power + 2}), relatively (Omega = omega h)."


def _leading_term(function: Callable[[np.ndarray], np.ndarray], parity: int) -> tuple[float, int, str] | None:
    """The first term of an odd or even power series in Omega, from a fit; None if all of it is round-off."""
    Omega = np.linspace(0.03, 0.3, 28)
    powers = (1, 3, 5, 7, 9, 11, 13) if parity else (2, 4, 6, 8, 10, 12, 14)
    columns = Omega[:, None] ** np.array(powers)
    series = np.linalg.lstsq(columns, function(Omega), rcond=None)[0]
    for coefficient, power in zip(series.tolist(), powers, strict=True):
        if abs(coefficient) * 0.3**power > 1e-8:
            return coefficient, power, _term(coefficient, power)
    return None


def _term(coefficient: float, power: int) -> str:
    variable = "Omega" if power == 1 else f"Omega^{power}"
    fraction = Fraction(coefficient).limit_denominator(1000)
    if fraction and abs(float(fraction) - coefficient) < 1e-5 * abs(coefficient):
        above = "" if abs(fraction.numerator) == 1 else f"{abs(fraction.numerator)} "
        below = "" if fraction.denominator == 1 else f"/{fraction.denominator}"
        return f"{'-' if coefficient < 0 else ''}{above}{variable}{below}"
    return f"{coefficient:.4g} {variable}"


def _unwrapped(values: np.ndarray) -> Any:
    """A Python scalar for one value, else the array."""
    return values.item() if values.ndim == 0 else values
