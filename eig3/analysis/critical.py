"""The longest stable step of a method for a system at a state."""

from __future__ import annotations

import functools
import math
import numbers
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..callbacks import cached_jit
from ..checks import check_method, check_time
from ..methods import Method
from ..stability import eigenvalues, first_exit, oscillator_matrices, state_size, step_once
from ..stability import limit as limit_of
from ..stepper import Stepper
from .linear import Linearised, linearise

_COMMUTING = 1e-5  # of K or C: what an eigenvector of both leaves of each, where differences give K and C
_RIGID = 1e-7  # of the largest: rates below this are those of rigid motion, with the round-off of differences
_ROUND_OFF = 1e-8  # of the eigenvalues of one oscillator's step
_COUPLED_ROUND_OFF = 1e-6  # of those of many
_NEAR = 2e-3  # the accuracy to which the limit of modes that do not decouple is searched
_SAME = 1e-3  # of an eigenvalue: far above what round-off does to a multiple one, far below what tells methods apart
_STEPPED = 20  # directions of each kind that modes which do not decouple are looked at on
_SOLVED = 12  # and by an implicit method, with a solve for each unit state of each step looked at
_STEADY = ("eig3", "cd", "rk4")  # what to name where a method has no stable step
_SHORTEST, _LONGEST = 1e-3, 100.0  # steps looked at, in radians of the fastest mode and of the slowest
_COUPLED_SHORTEST = 0.03
_FINE, _COARSE = 1.02, 1.3  # from one step looked at to the next


@dataclass(frozen=True)
class CriticalStep:
    """The longest stable step at a state, as `critical_step` finds it.

    Attributes
    ----------
    h : float
        The step to take, in the unit of time of rhs: `limit` times the safety factor.
    omega_max : float
        Undamped angular frequency of the mode that limits the step, in radians by that unit; 0.0 where nothing restores
        it.
    xi : float
        Its damping ratio, negative where it is excited; infinite where nothing restores it.
    evaluations : int
        Of the right-hand side.
    limit : float
        The step beyond which the linearised system is unstable or, with fixed-point iteration, the solve does not
        converge.
    """

    h: float
    omega_max: float
    xi: float
    evaluations: int
    limit: float


class NoCriticalStepError(ValueError):
    """There is no such step: every step is stable, or none is."""


class NoStableStepError(NoCriticalStepError):
    """The method is unstable at every step."""


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
        What to multiply the limit by: a system that is not linear has other frequencies elsewhere on its way. A stable
        step is not yet an accurate one: `eig3.plan` looks for that.

    Returns
    -------
    CriticalStep

    Raises
    ------
    TypeError, ValueError
        For arguments `eig3.integrate` would refuse, a rhs that is not finite close to the state, and a method with
        velocity="none" where rhs reads v.
    NoCriticalStepError
        A ValueError: where nothing at this state limits the step, and where the method is unstable at every step, as
        RK2 and AB2 are without damping.

    Notes
    -----
    K = -df/du and C = -df/dv come from differences of rhs, on the stiffer side of a kink: in full up to 64 degrees of
    freedom, else on 60 to 90 directions of Arnoldi's iteration, by which the limit is some 0.1 % too long. Where K and
    C have common modes, each is an oscillator u'' + c u' + k u = 0. Where they do not commute, a Runge-Kutta or Adams
    method sees the rates of the system's own modes, but EIG-3 and central difference do not: there the method's kernel
    takes one step of the projected system from each unit state, and the eigenvalues of that matrix tell. Solutions that
    grow by themselves, as from an unstable position, are allowed to.
    """
    method, t = check_method(method), check_time(t, "t")
    if isinstance(safety, bool) or not (isinstance(safety, numbers.Real) and 0 < safety <= 1):
        raise ValueError(f"safety must be a number above 0 and up to 1, not {safety!r}.")
    start = Stepper(rhs, u0, v0, h=1.0, t0=t, params=params, method="rk4")  # which checks them
    return critical(start.acceleration, t, start.u, start.v, method, float(safety))


def critical(acceleration: Callable, t: float, u: Any, v: Any, method: Method, safety: float = 1.0) -> CriticalStep:
    """`critical_step` for a function ``acceleration(t, u, v)`` that is finite at the state."""
    system = linearise(acceleration, t, u, v)
    if method.ignores_velocity and system.C.any():
        raise ValueError("velocity='none' needs a rhs that ignores v, and this one does not; leave it out.")
    rates = system.rates()
    limit, omega, xi = _limit(method, system, rates) if np.abs(rates).max() > 0 else (math.inf, 0.0, 0.0)
    if math.isinf(limit):
        raise NoCriticalStepError(
            "nothing that oscillates or decays limits the step at this state: choose h for accuracy, and for the "
            "states on the way."
        )
    if limit == 0:
        others = [name for name in _STEADY if _limit(check_method(name), system, rates)[0] > 0]
        such = f", such as {', '.join(map(repr, others))}" if others else ""
        raise NoStableStepError(
            f"{method!r} is unstable at every step for this system, with a mode of omega = {omega:.4g} and xi = "
            f"{xi:.2g}; choose a method that has a stable step for it{such}."
        )
    return CriticalStep(safety * limit, omega, xi, system.evaluations, limit)


def _limit(method: Method, system: Linearised, rates: np.ndarray) -> tuple[float, float, float]:
    """The limit, and the frequency and damping ratio of the mode that sets it."""
    if not system.C.any():
        method = method.without_velocity()  # the same step, without a solve
    modes = _modes(system)
    if modes is None and not method.is_implicit and _sees_rates(method):
        modes = _oscillators_of(rates)
    if modes is None:
        system = system.fastest(_SOLVED if method.is_implicit else _STEPPED)
    limit, k, c = _coupled_limit(method, system) if modes is None else _modal_limit(method, *modes)
    return limit, *_frequency(k, c)


def _frequency(k: complex, c: complex) -> tuple[float, float]:
    """Undamped frequency and damping ratio of a mode u'' + c u' + k u = 0; c is imaginary in a gyroscopic one."""
    omega = math.sqrt(max(0.0, k.real))
    if abs(c.imag) > _COMMUTING * abs(c):
        rate = max(np.roots([1.0, c, k]), key=abs)
        omega, xi = abs(rate), -rate.real / abs(rate)
    else:
        xi = c.real / (2 * omega) if omega > 0 else math.inf
    return float(omega), 0.0 if abs(xi) < _COMMUTING else float(xi)


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
    """The limit over all modes, and k and c of the mode that sets it."""
    scale = float(np.maximum(np.sqrt(np.abs(k)), np.abs(c)).max())
    k, c = k / scale / scale, c / scale
    moving = (k != 0) | (c != 0)
    k, c = k[moving], c[moving]
    root = np.sqrt((c * c / 4 - k).astype(complex))
    rates = np.stack([-c / 2 + root, -c / 2 - root], axis=-1)

    def growth(h: np.ndarray) -> np.ndarray:
        h = h[:, None]
        return _growth(oscillator_matrices(method, h * h * k, h * c), h, rates)

    slowest = float(np.where(k != 0, np.sqrt(np.abs(k)), np.abs(c)).min())
    steps = _geometric(_SHORTEST, _LONGEST / slowest, _FINE)
    limit = first_exit(lambda h: growth(h).max(axis=1), _ROUND_OFF, blocks=np.array_split(steps, len(steps) // 50 + 1))
    if math.isinf(limit):
        return limit, 0.0, 0.0
    limiting = int(np.argmax(growth(np.array([1.001 * limit if limit > 0 else 0.1]))[0]))
    return limit / scale, float(k[limiting]) * scale * scale, float(c[limiting]) * scale


def _geometric(first: float, last: float, ratio: float) -> np.ndarray:
    return first * ratio ** np.arange(math.ceil(math.log(last / first) / math.log(ratio)) + 1)


def _growth(matrices: np.ndarray, h: Any, rates: np.ndarray) -> np.ndarray:
    """By how much a step's matrix lets something grow that does not grow in the system with these rates.

    As many roots may be outside the unit circle as the system has growing rates, and they not further than at twice the
    fastest of these.
    """
    sizes = np.abs(eigenvalues(matrices))
    growing = (rates.real > _RIGID * np.abs(rates).max()).sum(axis=-1)
    fastest = np.where(growing > 0, rates.real.max(axis=-1), 0.0)
    with np.errstate(over="ignore"):
        beyond = sizes.max(axis=-1) - np.exp(2 * h * fastest)
    allowed = np.arange(sizes.shape[-1]) < growing[..., None]
    others = np.where(allowed, 0.0, -np.sort(-sizes, axis=-1)).max(axis=-1) - 1
    return np.where(np.isfinite(sizes).all(axis=-1), np.maximum(beyond, others), np.inf)


def _oscillators_of(rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """k and c of oscillators with these rates: of a conjugate pair, and of a real rate twice."""
    upper = rates[rates.imag >= 0]
    return np.abs(upper) ** 2, -2 * upper.real


@functools.cache
def _sees_rates(method: Method) -> bool:
    """Whether the method's step depends on the rates of a system only, as that of a method of first-order systems.

    Judged by a system in which stiffness, damping and gyroscopic forces are of one size and have no modes in common.
    """
    system = Linearised(np.array([[1.0, 0.0], [0.0, 0.5]]), np.array([[0.3, 0.5], [-0.4, 0.6]]), 0)
    k, c = _oscillators_of(system.rates())
    by_rates = eigenvalues(oscillator_matrices(method, k, c)).ravel()
    apart = np.abs(eigenvalues(_step_matrix(method, system, 1.0))[:, None] - by_rates)
    return bool(apart.min(axis=1).max() < _SAME and apart.min(axis=0).max() < _SAME)


def _coupled_limit(method: Method, system: Linearised) -> tuple[float, complex, complex]:
    """The limit of modes that do not decouple, by the eigenvalues of the method's step of the projected system."""
    rates = system.rates()

    def is_stable(h: float, tolerance: float = _COUPLED_ROUND_OFF) -> bool:
        return bool(_growth(_step_matrix(method, system, h), h, rates) <= tolerance)

    low = high = 0.0
    for high in _steps(method, system, float(np.abs(rates).max())):
        if not is_stable(high):
            break
        low = high
    else:
        return math.inf, 0.0, 0.0
    while low > 0 and high > (1 + _NEAR) * low:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if is_stable(middle) else (low, middle)
    # As in `first_exit`: a growth at every step passes the tolerance too, but not steeply. Two steps are looked at, as
    # the system may be stable again just beyond a limit.
    if all(is_stable(h, 2 * _COUPLED_ROUND_OFF) for h in (high, 1.01 * high)):
        low = 0.0
    values, vectors = np.linalg.eig(_step_matrix(method, system, 1.01 * high))
    # what is unstable alternates or oscillates, unlike what grows by itself
    limiting = np.argmax(np.where(np.abs(values) > 1, np.abs(values - 1), 0.0))
    shape = vectors[: len(system.K), limiting]
    k, c = (complex((shape.conj() @ x @ shape) / (shape.conj() @ shape)) for x in (system.K, system.C))
    return low, k, c


def _steps(method: Method, system: Linearised, fastest: float) -> list[float]:
    """The steps at which an instability is looked for, from the shortest to the longest.

    Gyroscopic forces can stabilise two modes again that central difference, which sees no velocity in what alternates
    from step to step, loses one by one: hence those just above the undamped limit of the stiffest.
    """
    stiffness = np.abs(np.linalg.eigvals(system.K))
    stiffest = math.sqrt(stiffness.max())
    restored = stiffness[stiffness > _RIGID * stiffness.max()]
    slowest = math.sqrt(restored.min()) if restored.size else fastest
    steps = _geometric(_COUPLED_SHORTEST / fastest, _LONGEST / slowest, _COARSE)
    if stiffest > 0:
        beyond = limit_of(method.without_velocity()) / stiffest * np.array([1.0005, 1.002, 1.01])
        steps = np.concatenate([steps, beyond[(beyond > steps[0]) & (beyond < steps[-1])]])
    return sorted(steps.tolist())


def _step_matrix(method: Method, system: Linearised, h: float) -> np.ndarray:
    """The matrix of one step of the whole system on (u, h v, past ...), from every unit state."""
    m, rows = len(system.K), state_size(method)
    size = m * rows
    params = np.concatenate([[m], h * h * system.K.ravel(), h * system.C.ravel()])
    units = np.eye(size).reshape(size, rows, m)
    each = size if not method.is_implicit else 1  # an iteration would couple the copies of one call
    columns = []
    for first in range(0, size, each):
        copies = units[first : first + each]
        state = np.ascontiguousarray(copies.transpose(1, 0, 2).reshape(rows, -1))
        stepped = step_once(method, _copies, params, state)
        columns.append(stepped.reshape(rows, len(copies), m).transpose(1, 0, 2).reshape(len(copies), size))
    return np.concatenate(columns).T


@cached_jit
def _copies(t: float, u: np.ndarray, v: np.ndarray, p: np.ndarray, a: np.ndarray) -> None:
    m = int(p[0])
    for first in range(0, u.size, m):
        for i in range(m):
            total = 0.0
            for j in range(m):
                total -= p[1 + i * m + j] * u[first + j] + p[1 + m * m + i * m + j] * v[first + j]
            a[first + i] = total
