"""The longest stable step of a method for a system at a state."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .callbacks import check_callback, jit, read_only
from .checks import check_method, check_params, check_state, check_time
from .kernels.jit import SCALAR
from .linear import Linearised, linearise
from .methods import Method
from .stability import eigenvalues, first_exit, oscillator_matrices, state_size, step_once

_COMMUTING = 1e-5  # of K or C: what an eigenvector of both leaves of each, where differences give K and C
_RIGID = 1e-7  # of the largest: rates below this are those of rigid motion, with the round-off of differences
_ROUND_OFF = 1e-8  # of the eigenvalues of one oscillator's step
_COUPLED_ROUND_OFF = 1e-6  # of those of many
_NEAR = 2e-3  # the accuracy to which the limit of modes that do not decouple is searched
_SAME = 1e-3  # of an eigenvalue: far above what round-off does to a multiple one, far below what tells methods apart
_SOLVED = 12  # directions of each kind, for an implicit method
_SPAN = 100.0  # how far it is searched


@dataclass(frozen=True)
class CriticalStep:
    """The longest stable step at a state, as `critical_step` finds it.

    Attributes
    ----------
    h : float
        The step to take: `limit` times the safety factor.
    omega_max : float
        Angular frequency of the mode that limits the step, undamped; 0.0 where nothing restores it.
    xi : float
        Its damping ratio; infinite where nothing restores it.
    evaluations : int
        Of the right-hand side.
    limit : float
        The step beyond which the linearised system is unstable.
    """

    h: float
    omega_max: float
    xi: float
    evaluations: int
    limit: float


class NoCriticalStepError(ValueError):
    """There is no such step: every step is stable, or none is."""


def critical_step(
    rhs: Any,
    u0: ArrayLike,
    v0: ArrayLike,
    params: ArrayLike = (),
    *,
    method: str | Method = "eig3",
    t: float = 0.0,
    safety: float = 0.9,
) -> CriticalStep:
    """Find the longest stable step of a method for the system linearised at a state.

    Parameters
    ----------
    rhs : jitted function
        As for `eig3.integrate`.
    u0, v0 : float or array_like, shape (n,)
        The state.
    params : float or array_like
    method : str or Method
    t : float
        The time of the state.
    safety : float
        What to multiply the step by: a system that is not linear has other frequencies elsewhere on its way.

    Returns
    -------
    CriticalStep

    Raises
    ------
    TypeError, ValueError
        For arguments `eig3.integrate` would refuse.
    NoCriticalStepError
        A ValueError: where nothing oscillates or decays, so that every step is stable, and where the method is unstable
        at every step, as RK2 and AB2 without damping.

    Notes
    -----
    K = -df/du and C = -df/dv are projected on all directions in systems of up to 64 degrees of freedom, else on up to
    90, which Arnoldi's iteration finds from differences of rhs. Where K and C have common modes, each is an oscillator
    u'' + c u' + k u = 0. Where they do not commute, a Runge-Kutta or Adams method sees the rates of the system's own
    modes, but EIG-3 and central difference do not: there the method's kernel takes one step of the projected system
    from each unit state, and the eigenvalues of that matrix tell. Solutions that grow by themselves, as from an
    unstable position, are allowed to.
    """
    method = check_method(method)
    u, v, form = check_state(u0, v0)
    p, t = read_only(check_params(params)), check_time(t, "t")
    if not (isinstance(safety, int | float) and 0 < safety <= 1):
        raise ValueError(f"safety must be a number above 0 and up to 1, not {safety!r}.")
    f = check_callback(rhs, "rhs", form)

    def acceleration(t: float, u: Any, v: Any) -> Any:
        if form is SCALAR:
            return f(t, u, v, p)
        a = np.full(u.size, np.nan)
        f(t, read_only(u), read_only(v), p, a)
        return a

    if not np.isfinite(acceleration(t, u, v)).all():
        raise ValueError("u0 and v0 must be a state where rhs is finite, and here it is not.")
    return critical(acceleration, t, u, v, method, float(safety))


def critical(acceleration: Callable, t: float, u: Any, v: Any, method: Method, safety: float = 1.0) -> CriticalStep:
    """`critical_step` for a function ``acceleration(t, u, v)`` that is finite at the state."""
    system = linearise(acceleration, t, u, v)
    if method.ignores_velocity and system.C.any():
        raise ValueError("velocity='none' needs a rhs that ignores v, and this one does not; leave it out.")
    if not system.C.any():
        method = method.without_velocity()  # the same step, without a solve
    rates = system.rates()
    if not np.abs(rates).max() > 0:
        raise NoCriticalStepError("nothing oscillates or decays at this state, so that every step is stable.")
    modes = _modes(system)
    if modes is None and method.evaluations is not None and _sees_rates(method, system, rates):
        modes = _oscillators_of(rates)
    limit, omega, xi = _coupled_limit(method, system, rates) if modes is None else _modal_limit(method, *modes)
    if math.isinf(limit):
        raise NoCriticalStepError(
            "nothing that oscillates or decays limits the step at this state; choose h for accuracy."
        )
    if limit == 0:
        raise NoCriticalStepError(
            f"{method!r} is unstable at every step for this system, with a mode at {omega:.4g} rad per unit of time "
            f"and damping ratio {xi:.2g}; choose a method with a stable step for it, such as 'cd' or 'rk4'."
        )
    return CriticalStep(safety * limit, omega, xi, system.evaluations, limit)


def _modes(system: Linearised) -> tuple[np.ndarray, np.ndarray] | None:
    """k and c of each mode u'' + c u' + k u = 0 that K and C have in common; None where there are no such modes."""
    K, C = system.K, system.C
    norm_k, norm_c = (np.linalg.norm(x, 2) or 1.0 for x in (K, C))
    # the weights only have to keep apart modes with the same sum
    shapes = np.linalg.eig(K / norm_k + 0.7310585786 * C / norm_c)[1]
    k, c = (np.einsum("ij,ij->j", shapes.conj(), x @ shapes) for x in (K, C))
    left_k = np.abs(K @ shapes - k * shapes).max() / norm_k
    left_c = np.abs(C @ shapes - c * shapes).max() / norm_c
    imaginary = max(np.abs(k.imag).max() / norm_k, np.abs(c.imag).max() / norm_c)
    if max(left_k, left_c, imaginary) > _COMMUTING:
        return None
    k, c = k.real, c.real
    k[np.abs(k) < _RIGID * norm_k] = 0.0
    c[np.abs(c) < _RIGID * norm_c] = 0.0
    return k, c


def _modal_limit(method: Method, k: np.ndarray, c: np.ndarray) -> tuple[float, float, float]:
    """The limit over all modes, and the frequency and damping ratio of the mode that sets it."""
    scale = float(np.maximum(np.sqrt(np.abs(k)), np.abs(c)).max())
    k, c = k / scale / scale, c / scale
    moving = (k != 0) | (c != 0)
    k, c = k[moving], c[moving]
    root = np.sqrt((c * c / 4 - k).astype(complex))
    rates = np.stack([-c / 2 + root, -c / 2 - root], axis=-1)

    def excess_of_modes(h: np.ndarray) -> np.ndarray:
        h = h[:, None]
        return _excess(oscillator_matrices(method, h * h * k, h * c), h, rates)

    limit = first_exit(lambda h: excess_of_modes(h).max(axis=1), _ROUND_OFF)
    if math.isinf(limit):
        return limit, 0.0, 0.0
    limiting = int(np.argmax(excess_of_modes(np.array([1.001 * limit or 0.1]))[0]))
    omega = math.sqrt(max(0.0, k[limiting])) * scale
    return limit / scale, omega, float(c[limiting] * scale / (2 * omega)) if omega > 0 else math.inf


def _excess(matrices: np.ndarray, h: Any, rates: np.ndarray) -> np.ndarray:
    """By how much a step's matrix lets something grow that does not grow in the system with these rates.

    As many roots may be outside the unit circle as the system has growing rates, and they not further than at twice the
    fastest of these.
    """
    sizes = -np.sort(-np.abs(eigenvalues(matrices)), axis=-1)
    growing = (rates.real > _RIGID * np.abs(rates).max()).sum(axis=-1)
    fastest = np.where(growing > 0, rates.real.max(axis=-1), 0.0)
    with np.errstate(over="ignore"):
        beyond = sizes[..., 0] - np.exp(2 * h * fastest)
    allowed = np.arange(sizes.shape[-1]) < growing[..., None]
    others = np.where(allowed, 0.0, sizes).max(axis=-1) - 1
    return np.where(np.isfinite(sizes[..., 0]), np.maximum(beyond, others), np.inf)


def _oscillators_of(rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """k and c of oscillators with these rates: of a conjugate pair, and of a real rate twice."""
    upper = rates[rates.imag >= 0]
    return np.abs(upper) ** 2, -2 * upper.real


def _sees_rates(method: Method, system: Linearised, rates: np.ndarray) -> bool:
    """Whether the method's step depends on the rates of the system only, as that of a method of first-order systems."""
    h = 1 / np.abs(rates).max()
    k, c = _oscillators_of(rates)
    by_rates = eigenvalues(oscillator_matrices(method, h * h * k, h * c)).ravel()
    apart = np.abs(eigenvalues(_step_matrix(method, system, h))[:, None] - by_rates)
    return bool(apart.min(axis=1).max() < _SAME and apart.min(axis=0).max() < _SAME)


def _coupled_limit(method: Method, system: Linearised, rates: np.ndarray) -> tuple[float, float, float]:
    """The limit of modes that do not decouple, by the eigenvalues of the method's step of the projected system."""
    if method.evaluations is None:
        system = system.fastest(_SOLVED)  # a solve for each unit state of each step tried
        rates = system.rates()
    fastest = rates[np.argmax(np.abs(rates))]
    omega = float(np.abs(fastest))
    xi = float(-fastest.real / omega)
    xi = 0.0 if abs(xi) < _RIGID else xi

    def is_stable(h: float, tolerance: float = _COUPLED_ROUND_OFF) -> bool:
        return bool(_excess(_step_matrix(method, system, h), h, rates) <= tolerance)

    low = high = 2 / omega
    while is_stable(high):
        low, high = high, 1.5 * high
        if high > _SPAN / omega:
            return math.inf, omega, xi
    while not is_stable(low):
        low, high = low / 1.5, low
        if low < 1 / (_SPAN * omega):
            return 0.0, omega, xi
    while high > (1 + _NEAR) * low:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if is_stable(middle) else (low, middle)
    # as in `first_exit`: a growth at every step passes the tolerance too, but not steeply
    return (0.0 if is_stable(1.1 * high, 2 * _COUPLED_ROUND_OFF) else low), omega, xi


def _step_matrix(method: Method, system: Linearised, h: float) -> np.ndarray:
    """The matrix of one step of the whole system on (u, h v, past ...), from every unit state."""
    m, rows = len(system.K), state_size(method)
    size = m * rows
    params = np.concatenate([[m], h * h * system.K.ravel(), h * system.C.ravel()])
    units = np.eye(size).reshape(size, rows, m)
    each = size if method.evaluations is not None else 1  # an iteration would couple the copies of one call
    columns = []
    for first in range(0, size, each):
        copies = units[first : first + each]
        state = np.ascontiguousarray(copies.transpose(1, 0, 2).reshape(rows, -1))
        stepped = step_once(method, _copies, params, state)
        columns.append(stepped.reshape(rows, len(copies), m).transpose(1, 0, 2).reshape(len(copies), size))
    return np.concatenate(columns).T


@jit
def _copies(t: float, u: np.ndarray, v: np.ndarray, p: np.ndarray, a: np.ndarray) -> None:
    m = int(p[0])
    for first in range(0, u.size, m):
        for i in range(m):
            total = 0.0
            for j in range(m):
                total -= p[1 + i * m + j] * u[first + j] + p[1 + m * m + i * m + j] * v[first + j]
            a[first + i] = total
