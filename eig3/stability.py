"""Stability and accuracy of the compiled kernels on the oscillator u'' + 2 xi omega u' + omega^2 u = 0."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Iterable
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .functions.callbacks import check_callback, jit
from .functions.checks import check_method
from .kernels.loops.fixed import kernel
from .kernels.methods.eig import kappa, sigma
from .kernels.protocol import EVENTS, VECTOR, Steps
from .methods import EIG3, Method

_ROUND_OFF = 1e-11  # round-off of an eigenvalue; at a limit found to 1e-10, the eigenvalues of a pair are 1e-5 apart
_SIMPLE = 1e-6  # roots closer than this count as one multiple root
_SOLVED_TOGETHER = 32  # unit states of oscillators in one solve of an implicit method, whose cost grows with their cube
_OSCILLATES = 1e-7  # least imaginary part of a complex root: round-off gives less to a double real root
_FURTHEST = 100.0  # a method that is stable up to this omega h counts as stable at every step
_LAST_INTERVAL = 20.0  # omega h up to which the search finds further intervals of stable steps
_SPACING = 0.01  # spacing of omega h in a search
_FINE_SPACING = 1e-4  # spacing where two roots on the unit circle meet
_NEAR_CIRCLE = 1e-6  # a root is on the unit circle if it is within this distance of it
_BEYOND = np.array([1.00001, 1.0001, 1.001])  # where the growth beyond a limit is compared with the growth at the limit
_TRACKING = 0.01  # increment of omega h for tracking the principal root
_NODES = 64  # points on a circle of complex omega h
_RADII = 0.8 ** np.arange(20)  # radii of the circles
_CONVERGED = 1e-9  # the largest term in the last half of a converged series, on its circle
_EXACT = 1e-8  # relative tolerance for identifying a coefficient with a fraction
_FURTHER = 1.01  # a practical limit beyond this multiple of the limit is reported
_VISIBLE = 1e-11  # a smaller term on its circle is round-off
#: Growth per step that is negligible in most runs: 1 % in 1000 steps.
NEGLIGIBLE_GROWTH = 1e-5
NEGLIGIBLE = "1e-5"

#: A function of an array of omega h that is positive where a method is unstable.
Excess = Callable[[np.ndarray], np.ndarray]


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
    """Compute the matrices of all oscillators by one step of all oscillators from every unit state."""
    size, count = state_size(method), k.size
    params = np.concatenate([np.tile(k, size), np.tile(c, size)])
    state = np.repeat(np.eye(size), count, axis=1)
    matrices = step_once(method, _oscillators, params, state).reshape(size, size, count).transpose(2, 0, 1)
    if count > 1 and np.isnan(matrices).any():  # one failed solve ends the step of all oscillators
        return np.concatenate([_matrices(method, k[i : i + 1], c[i : i + 1]) for i in range(count)])
    return matrices


@jit
def _oscillators(t: float, u: np.ndarray, v: np.ndarray, p: np.ndarray, a: np.ndarray) -> None:
    n = u.size
    for j in range(n):
        a[j] = -p[j] * u[j] - p[n + j] * v[j]


def state_size(method: Method) -> int:
    """Number of values that a method carries from step to step for one degree of freedom: u, v and past values."""
    return 2 + method.formulas.past


def step_once(method: Method, rhs: Any, params: np.ndarray, state: np.ndarray) -> np.ndarray:
    """Take one step of h = 1 with the vector kernel from the rows (u, v, past ...); NaN if a solve fails."""
    method = (method.fallback(1) or method).without_noise()
    if method.jacobian is not None:  # it belongs to another system
        method = dataclasses.replace(method, jacobian=None)  # type: ignore[type-var]
    rows, n = state.shape
    formulas = method.formulas
    whole = np.zeros((formulas.state_rows(n), n))
    whole[:rows] = state
    nowhere = np.empty((0, n))
    steps = Steps(1.0, 0.0, params, formulas.start_steps, 1, 2**62, 0, nowhere, nowhere)
    settings = np.array(method.settings, dtype=np.float64)
    callbacks = check_callback(rhs, "rhs", VECTOR).address, None
    take = kernel(formulas, method.order, VECTOR, 0, looks=0)  # the kernel for any number of oscillators
    taken, _, _ = take(callbacks, whole, settings, np.zeros(EVENTS), steps, None)
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
    """Whether the method is stable on the oscillator: no root outside the unit circle, and simple roots on it.

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
    A growth below 1e-11 per step is not detected, because it is within the round-off of the roots.
    """
    return _unwrapped(_excess(amplification_matrix(method, Omega, xi)) <= _ROUND_OFF)


def _excess(matrices: np.ndarray) -> np.ndarray:
    """The spectral radius minus one; infinite if a root on the unit circle is not simple."""
    roots = eigenvalues(matrices)
    finite = np.isfinite(roots).all(axis=-1)
    roots[~finite] = 0.0
    # Round-off eps splits a double root by sqrt(eps), but does not move the mean of the two roots.
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
    below 0.01 with weak damping: this is returned as 0.0. `practical_limit` is the limit for a negligible growth.

    Steps beyond the limit can be stable again. An interval of unstable steps shorter than 1e-4 may be missed.
    """
    return _limit(check_method(method), float(xi))


@functools.cache
def _limit(method: Method, xi: float) -> float:
    blocks = (_with_meetings(method, xi, block) for block in _blocks())
    return first_exit(_excess_at(method, xi), _ROUND_OFF, blocks)


def practical_limit(method: str | Method, xi: float = 0.0, growth: float = NEGLIGIBLE_GROWTH) -> float:
    """The limit of Omega = omega h below which the motion of the oscillator grows by at most `growth` a step.

    Parameters
    ----------
    method : str or Method
    xi : float
        Physical damping ratio.
    growth : float
        The growth per step, relative to the motion. It must be positive.

    Returns
    -------
    float
        Infinite if the motion grows by at most `growth` at every step up to Omega = 100.

    Notes
    -----
    Some methods are unstable at every step, but grow slowly at short steps. EIG of grade 7 grows by 7/96 Omega^8 a step
    without damping, for example. In N steps the motion grows by the factor exp(N growth) at most.
    """
    if not growth > 0:
        raise ValueError(f"growth must be positive, not {growth}.")
    return first_above(_excess_at(check_method(method), float(xi)), growth, _blocks())[0]


@functools.cache
def alternating_limit(grade: int, xi: float) -> float:
    """The omega h at which a root of EIG(grade) is -1, in closed form.

    It is `limit`, except without damping in the grades 6, 7, 10 and 11, which are unstable at every step, and in grade
    8, which is unstable from 0.618 on.
    """
    stiffness = float(sum(x * 2**j for j, x in enumerate(sigma(grade - 1))))
    damping = 4 * xi * (stiffness + 2 * float(sum(x * 2**j for j, x in enumerate(kappa(grade - 2)))))
    return (math.sqrt(damping * damping + 16 * stiffness) - damping) / (2 * stiffness)


def _excess_at(method: Method, xi: float) -> Excess:
    return lambda Omega: _excess(amplification_matrix(method, Omega, xi))


def first_exit(excess: Excess, tolerance: float, blocks: Iterable[np.ndarray]) -> float:
    """The least x at which ``excess(x)`` exceeds `tolerance`, searched at the increasing numbers of `blocks`.

    It is 0.0 if the excess grows from x = 0 on, and infinite if it never exceeds the tolerance.
    """
    low, high = first_above(excess, tolerance, blocks)
    if math.isinf(low):
        return low
    # Beyond a limit the excess rises steeply, or it is negative well before the limit. An excess that grows as a power
    # of x exceeds the tolerance too, but is hardly larger slightly beyond.
    further, before = excess(_BEYOND * high), excess(np.array([high / 2]))[0]
    is_limit = further.max() > 2 * tolerance or before < -tolerance
    return low if is_limit else 0.0


def first_above(excess: Excess, tolerance: float, blocks: Iterable[np.ndarray]) -> tuple[float, float]:
    """The last x before ``excess(x)`` first exceeds `tolerance` and the first x after; both infinite if it never does.

    They differ by 1e-10, relatively if they are below 1, or by round-off.
    """
    stable = 0.0
    for block in blocks:
        unstable = np.flatnonzero(excess(block) > tolerance)
        if unstable.size:
            break
        stable = float(block[-1])
    else:
        return math.inf, math.inf
    first = int(unstable[0])
    low, high = float(block[first - 1]) if first else stable, float(block[first])
    while high - low > max(1e-10 * min(1.0, high), 2 * np.spacing(high)):
        middle = (low + high) / 2
        low, high = (low, middle) if excess(np.array([middle]))[0] > tolerance else (middle, high)
    return low, high


def _blocks() -> list[np.ndarray]:
    near = np.concatenate([0.001 * 2.0 ** np.arange(4), np.arange(_SPACING, 3, _SPACING)])
    return [near, *(np.arange(start, start + 5, _SPACING) for start in np.arange(3, _FURTHEST, 5))]


def _with_meetings(method: Method, xi: float, Omega: np.ndarray) -> np.ndarray:
    """Add values of Omega where two roots on the unit circle come close to each other.

    The roots of a method that conserves a quantity can meet at -1 or 1 and separate again after a short interval of
    unstable steps. BM6 has such intervals near Omega = pi and 2 pi.
    """
    roots = eigenvalues(amplification_matrix(method, Omega, xi))
    with np.errstate(invalid="ignore"):  # a solve may have failed
        distances = np.abs(roots[:, :, None] - roots[:, None, :])
    off_circle = np.abs(np.abs(roots) - 1) > _NEAR_CIRCLE
    ignored = off_circle[:, :, None] | off_circle[:, None, :] | np.eye(roots.shape[1], dtype=bool)
    gap = np.where(ignored, np.inf, distances).min(axis=(1, 2))
    meets = np.flatnonzero((gap[1:-1] < gap[:-2]) & (gap[1:-1] <= gap[2:])) + 1
    fine = [np.arange(Omega[i - 1], Omega[i + 1], _FINE_SPACING) for i in meets.tolist()]
    return np.unique(np.concatenate([Omega, *fine]))


def _later_intervals(method: Method, bound: float) -> list[tuple[float, float]]:
    """The intervals of stable steps beyond the limit `bound`, without damping, that are not very short."""
    Omega = _with_meetings(method, 0.0, np.arange(bound + _FINE_SPACING, _LAST_INTERVAL, _SPACING))
    stable = is_stable(method, Omega)
    changes = np.flatnonzero(stable[1:] != stable[:-1])
    ends = [_boundary(method, float(Omega[i]), float(Omega[i + 1])) for i in changes]
    if stable[0]:
        ends = [bound, *ends]
    return [(low, high) for low, high in zip(ends[::2], ends[1::2], strict=False) if high - low > _SPACING]


def _boundary(method: Method, low: float, high: float) -> float:
    """The boundary of stability between a stable and an unstable step."""
    before = is_stable(method, low)
    while high - low > 1e-9:
        middle = (low + high) / 2
        low, high = (middle, high) if is_stable(method, middle) is before else (low, middle)
    return low


def stable_region(Omega: ArrayLike, alpha: ArrayLike = 1.0, beta: ArrayLike = 0.5, xi: ArrayLike = 0.0) -> np.ndarray:
    """Return whether EIG-3(alpha, beta) is stable.

    Parameters
    ----------
    Omega, alpha, beta, xi : float or array_like
        Broadcast against each other: ``stable_region(Omega, alpha[:, None])`` is the region over (Omega, alpha).

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

    The root is tracked, because at large Omega another root may be larger or closer to the exponential.
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


@functools.cache
def expansion(method: Method) -> tuple[np.ndarray, float]:
    """The power series of the principal root z without damping: ln z = x sum_k c_k x^k, where x = i Omega.

    c_0 is 1. The odd coefficients change the size of the motion, and the even ones its period.

    Returns
    -------
    coefficients : ndarray, shape (32,)
    radius : float
        The radius of a circle within which the series converges.

    Notes
    -----
    The coefficients are the Fourier coefficients of ln z / x on the largest circle of complex x on which the series
    converges. A fit to real Omega would lose the small terms of methods of high order.
    """
    turns = np.exp(2j * np.pi * np.arange(_NODES) / _NODES)
    for radius in _RADII.tolist():
        x = radius * turns
        roots = eigenvalues(_complex_matrices(method, -x * x))
        nearest = np.abs(roots - np.exp(x)[:, None]).argmin(axis=1)
        terms = np.fft.fft(np.log(roots[np.arange(_NODES), nearest]) / x) / _NODES
        if np.abs(terms[_NODES // 2 :]).max() < _CONVERGED:
            break
    return (terms.real / radius ** np.arange(_NODES))[: _NODES // 2], radius


def _complex_matrices(method: Method, k: np.ndarray) -> np.ndarray:
    """The matrices of one step of u'' + k u = 0 with h = 1 and complex k: the step acts on real and imaginary parts."""
    size, count = state_size(method), k.size
    params = np.concatenate([np.tile(k.real, size), np.tile(k.imag, size)])
    units = np.repeat(np.eye(size), count, axis=1)
    stepped = step_once(method, _complex_oscillators, params, np.concatenate([units, 0 * units], axis=1))
    real, imaginary = stepped.reshape(size, 2, size, count).transpose(1, 3, 0, 2)
    return real + 1j * imaginary


@jit
def _complex_oscillators(t: float, u: np.ndarray, v: np.ndarray, p: np.ndarray, a: np.ndarray) -> None:
    n = u.size // 2
    for j in range(n):
        a[j] = p[n + j] * u[n + j] - p[j] * u[j]
        a[n + j] = -p[j] * u[n + j] - p[n + j] * u[j]


def explain(method: str | Method) -> str:
    """The properties of a method on the oscillator, in a few lines of text: order, limits, damping, period."""
    method = check_method(method)
    free = method.without_velocity()  # an equal step on an undamped oscillator, without a solve
    evaluations = method.evaluations
    each = (
        f"{evaluations} evaluation{'s' * (evaluations > 1)} a step"
        if evaluations
        else "a solve if the force reads velocity"
    )
    return "\n".join(
        [
            f"{method!r}: order {method.order}, {each}.",
            f"  Undamped, it is stable {_undamped(free, evaluations)}.",
            f"  {_damped(method)}",
            f"  {_leading_damping(free)}",
            f"  {_leading_period_error(free)}",
        ]
    )


def _undamped(method: Method, evaluations: int | None) -> str:
    bound = limit(method)
    if math.isinf(bound):
        return "at every step"
    practical = practical_limit(method)
    if bound == 0:
        return (
            f"at no step, however small, but it grows weakly: by {growth_in_words(method)} a step, which is below "
            f"{NEGLIGIBLE} up to omega h = {practical:.4g}"
        )
    parts = [f"up to omega h = {bound:.6g}"]
    if evaluations:
        parts.append(f", {bound / evaluations:.4g} per evaluation")
    again = [f"from {low:.6g} to {high:.6g}" for low, high in _later_intervals(method, bound)]
    if again:
        parts.append(f", and again {' and '.join(again)}")
    elif practical > _FURTHER * bound:
        parts.append(f"; the growth beyond that is below {NEGLIGIBLE} a step up to {practical:.4g}")
    return "".join(parts)


def growth_in_words(method: Method) -> str:
    """The leading term of the growth per step without damping; empty if the method does not grow."""
    term = _leading_term(method, odd=True)
    if term is None or term[0] > 0:
        return ""
    coefficient, power = term
    return _term(-coefficient, power + 1)


def _damped(method: Method) -> str:
    if method.ignores_velocity:
        return "It is for forces that do not depend on the velocity."
    limits = ", ".join(f"{limit(method, xi):.6g} (xi = {xi:g})" for xi in (0.01, 0.1, 0.5, 1.0))
    return f"With physical damping, the limits are {limits}."


def _leading_damping(method: Method) -> str:
    term = _leading_term(method, odd=True)
    if term is None:
        return "It has no numerical damping."
    coefficient, power = term
    ratio = f"the algorithmic damping ratio is {_term(coefficient, power)} + O(Omega^{power + 2})"
    if coefficient > 0:
        return f"It removes energy numerically: {ratio}."
    return f"It adds energy numerically: {ratio}, negative."


def _leading_period_error(method: Method) -> str:
    term = _leading_term(method, odd=False)
    if term is None:
        return "Its period is exact."
    coefficient, power = term
    kind = "longer" if coefficient > 0 else "shorter"
    shown = f"{_term(abs(coefficient), power)} + O(Omega^{power + 2})"
    return f"Its period is {kind} than the exact one by {shown}, relatively (Omega = omega h)."


def _leading_term(method: Method, odd: bool) -> tuple[float, int] | None:
    """Coefficient and power of the first term of the damping ratio, which is odd in Omega, or of the period error.

    A term below the order of the method is round-off of its coefficients. It is None if all terms are round-off.
    """
    coefficients, radius = expansion(method)
    for power in range(max(1, method.order), len(coefficients)):
        if power % 2 == odd and abs(coefficients[power]) * radius**power > _VISIBLE:
            sign = 1 if (power + odd) % 4 == 2 else -1  # sign of -i^(power + odd)
            return sign * float(coefficients[power]), power
    return None


def _term(coefficient: float, power: int) -> str:
    variable = "Omega" if power == 1 else f"Omega^{power}"
    fraction = Fraction(coefficient).limit_denominator(1000)
    if fraction and abs(float(fraction) - coefficient) < _EXACT * abs(coefficient):
        above = "" if abs(fraction.numerator) == 1 else f"{abs(fraction.numerator)} "
        below = "" if fraction.denominator == 1 else f"/{fraction.denominator}"
        return f"{'-' if coefficient < 0 else ''}{above}{variable}{below}"
    return f"{coefficient:.4g} {variable}"


def _unwrapped(values: np.ndarray) -> Any:
    """A Python scalar for one value, otherwise the array."""
    return values.item() if values.ndim == 0 else values
