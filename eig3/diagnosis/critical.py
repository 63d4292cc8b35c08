"""The longest stable step of a method for a system at a state."""

from __future__ import annotations

import functools
import math
import numbers
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..functions.callbacks import jit
from ..functions.checks import check_method, check_time, velocity_refused
from ..functions.companions import constraints_of
from ..keywords import with_suggestions
from ..methods import Method
from ..stability import (
    NEGLIGIBLE,
    NEGLIGIBLE_GROWTH,
    eigenvalues,
    first_above,
    first_exit,
    growth_in_words,
    oscillator_matrices,
    state_size,
    step_once,
)
from ..stability import limit as limit_of
from ..stepping.stepper import Stepper
from .blas_threads import one_blas_thread
from .linearisation import Linearised, linearise_at

_COMMUTING = 1e-5  # K and C share modes if a common eigenvector leaves a residual below this, relative to their norms
_COMPLEX = 1e-2  # slow modes of a projected system can have such imaginary parts, relative to its norm
_RIGID = 1e-7  # rates below this fraction of the largest are errors of the differences: a rigid-body mode
_RIGID_PROJECTED = 1e-6  # as _RIGID, for a projected system, whose differences have more round-off
_ROUND_OFF = 1e-8  # round-off in the eigenvalues of the step of one oscillator
_COUPLED_ROUND_OFF = 1e-6  # round-off in the eigenvalues of the step of many coupled degrees of freedom
_NEAR = 1e-7  # relative accuracy of the search for the limit of coupled modes
_NEAR_PROJECTED = 5e-4  # as _NEAR, for a projected system, which is less accurate
_SAME = 1e-3  # eigenvalues closer than this are equal: round-off is less, the difference of two methods is more
_STEPPED = 22  # directions of each of three kinds, for an explicit method: all directions up to 64 degrees of freedom
_SOLVED = 12  # as _STEPPED, for an implicit method, which needs a solve for each unit state
_VALUES = 320  # largest size of the matrix of a step on the three kinds; its eigenvalues then take some 20 ms
_SOLVED_TOGETHER = 32  # degrees of freedom in one solve, whose cost grows with their cube
_STEADY = ("eig3", "cd", "rk4")  # methods to suggest if the requested method has no stable step
_SHORTEST, _LONGEST = 1e-3, 100.0  # first and last step of the search, in radians of the fastest and the slowest mode
_COUPLED_SHORTEST = 0.03  # longest first step of the search for coupled modes
_FIRST_PART = 0.25  # the first step is at most this fraction of the limit with critical damping
_SHORTER = 0.8  # factor to a step at which growth as a power of h is still visible
_FINE, _COARSE = 1.02, 1.3  # ratio of consecutive steps of the search: for separate and for coupled modes
_BEYOND = np.array([1.00001, 1.0005, 1.002, 1.01])  # where a short interval of unstable steps may begin at a limit

_TRIED = 10  # steps from a state in which a step must keep the constraints
_LEAST_KEPT, _NEAR_KEPT = 0.01, 1.02  # least part of a stable step that is tried, and the accuracy of this search

AT_STATE = "at this state, and not where the system becomes stiffer"
KEEPING = "at this state, where no state was found that keeps the constraints after a longer step"
IN_MOTION = "in the motion, by an estimate from the energy at the start of how close two points can come"


@dataclass(frozen=True)
class CriticalStep:
    """The longest stable step at a state, as `critical_step` finds it.

    Attributes
    ----------
    h : float
        The step to take, in the unit of time of rhs: `limit` times the safety factor.
    omega_max : float
        Undamped angular frequency of the mode that limits the step, in radians per unit of time; 0.0 if the mode has no
        restoring force.
    xi : float
        Damping ratio of this mode: negative if the system excites it, infinite if it has no restoring force.
    evaluations : int
        Number of evaluations of the right-hand side in the search.
    limit : float
        The longest stable step. Beyond it the linearised system is unstable, or a step fails: the iteration for an
        implicit method or for the constraints does not converge.
    holds : str
        A description of where the step is stable.
    """

    h: float
    omega_max: float
    xi: float
    evaluations: int
    limit: float
    holds: str = AT_STATE


class NoCriticalStepError(ValueError):
    """There is no longest stable step: every step is stable, or no step is stable."""


class NoStableStepError(NoCriticalStepError):
    """The method is unstable at every step."""


@with_suggestions()
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
        Factor from `limit` to `h`, above 0 and up to 1. A nonlinear system can have higher frequencies at later states.
        A stable step is not always accurate: `eig3.plan` finds a step for a given accuracy.

    Returns
    -------
    CriticalStep

    Raises
    ------
    TypeError, ValueError
        If `eig3.integrate` would refuse the arguments, if rhs is not finite close to the state, or if a method with
        velocity="none" is given a rhs that reads v.
    NoCriticalStepError
        A ValueError, if nothing at this state limits the step, or if the method is unstable at every step, as RK2, AB2
        and EIG of the grades 6, 7, 10 and 11 without damping. If the growth is slow, the message gives the longest step
        with a growth below 1e-5 a step.

    Notes
    -----
    K = -df/du and C = -df/dv are computed by differences of rhs, at a kink on the stiffer side. Up to 64 degrees of
    freedom K and C are full matrices, and the limit of a smooth rhs is accurate to about 1e-6. For larger systems they
    are projected on 60 to 90 directions of Arnoldi's iteration, and the limit is up to about 0.1 % too long.

    If K and C have common modes, each mode is an oscillator u'' + c u' + k u = 0, and a growth below 1e-8 a step counts
    as round-off. Otherwise, the limit of a Runge-Kutta or Adams method still depends only on the complex rates of the
    modes. For EIG-3, EIG of any grade and central difference, the kernel takes one step of the whole system from each
    unit state, and the limit is computed from the eigenvalues of the matrix of these steps, with a round-off of 1e-6.
    An implicit method takes these steps on at most the 36 fastest directions, EIG of grade 5 on 45, and of grade 13 on
    21; with more degrees of freedom, the limit is accurate to about 5e-4.

    With constraints, ten steps from the state must also find states that keep them: the limit is otherwise shorter, to
    2 %, as for a rigid body that turns by more than half a radian in a step of EIG-3.

    A stable step does not prevent physical growth, as from an unstable position. Repeated contacts of a spring with a
    gap or a kink may add energy below the limit, until a contact has some ten steps.
    """
    method, t = check_method(method), check_time(t, "t")
    if isinstance(safety, bool) or not (isinstance(safety, numbers.Real) and 0 < safety <= 1):
        raise ValueError(f"safety must be a number above 0 and up to 1, not {safety!r}.")
    if constraints_of(rhs):
        method.with_constraints()  # refuses a method without a step for them
    start = Stepper(rhs, u0, v0, h=1.0, t0=t, params=params, method="rk4")  # checks the arguments
    found = of_linear(linearise_at(start, method), method, float(safety))
    if not constraints_of(rhs):
        return found
    return _that_keeps_constraints(found, Stepper(rhs, u0, v0, h=1.0, t0=t, params=params, method=method))


def _that_keeps_constraints(found: CriticalStep, start: Stepper) -> CriticalStep:
    """Return the step, or a shorter step with which a run from the state keeps the constraints."""

    def is_kept(part: float) -> bool:
        return all(_keeps_constraints(start.restarted(part * h)) for h in (found.limit, found.h))

    if is_kept(1.0):
        return found
    low, high = _LEAST_KEPT, 1.0
    while high > _NEAR_KEPT * low:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if is_kept(middle) else (low, middle)
    is_found = low > _LEAST_KEPT  # no step helps in a singular position
    return replace(found, h=low * found.h, limit=low * found.limit, holds=KEEPING) if is_found else found


def _keeps_constraints(trial: Stepper) -> bool:
    try:
        trial.advance(_TRIED)
    except Exception:  # rhs failed
        return False
    return trial.is_finite


def with_encounters(find: Callable[[], CriticalStep], encounter: Callable[[], CriticalStep]) -> CriticalStep:
    """Return the step that is stable at the start, from `find`, and in later collisions, from `encounter`."""
    found: list[CriticalStep] = []
    for search in (find, encounter):
        try:
            found.append(search())
        except NoStableStepError:
            raise
        except NoCriticalStepError as error:  # nothing limits the step here
            none = error
    if not found:
        raise none
    shortest = min(found, key=lambda step: step.limit)
    return replace(shortest, evaluations=found[0].evaluations, holds=IN_MOTION)


def of_encounters(encounters: tuple[np.ndarray, np.ndarray], method: Method, safety: float = 0.9) -> CriticalStep:
    """Return the critical step of the collisions u'' + c u' + k u = 0, from the arrays k and c."""
    k, c = (np.append(0.0, x) for x in encounters)
    return of_linear(Linearised(np.diag(k), np.diag(c), 0), method, safety)


def of_linear(system: Linearised, method: Method, safety: float = 1.0) -> CriticalStep:
    """Return the critical step of a linear system."""
    if method.ignores_velocity and system.C.any():
        raise velocity_refused(method)
    limit, omega, xi = longest_stable_step(method, system)
    if math.isinf(limit):
        raise NoCriticalStepError(
            "nothing that oscillates or decays limits the step at this state; choose h for accuracy, and for the "
            "states that follow."
        )
    if limit == 0:
        raise NoStableStepError(
            f"{method!r} is unstable at every step for this system, with a mode of omega = {omega:.4g} and xi = "
            f"{xi:.2g}; {_growth_of(method, system)}a method that has a stable step for it{_such_as(system)}."
        )
    return CriticalStep(safety * limit, omega, xi, system.evaluations, limit)


def _growth_of(method: Method, system: Linearised) -> str:
    """Describe the growth at short steps, and the longest step with a negligible growth."""
    h, _, _ = longest_stable_step(method, system, NEGLIGIBLE_GROWTH)
    if h == 0:
        return "choose "
    rate = "" if system.C.any() else growth_in_words(method.without_velocity())
    shown = f" (by {rate}, where Omega = omega h)" if rate else ""
    least = f"by less than {NEGLIGIBLE} a step up to h = {h:.4g}{shown}"
    return f"it grows weakly, {least}; take such a step for a short run, and for a long run "


def _such_as(system: Linearised) -> str:
    """Name methods that have a stable step; EIG-5 if EIG-3 has none, as with gyroscopic forces alone."""

    def has_step(name: str) -> bool:
        method = check_method(name)
        is_possible = method.takes_constraints or not system.has_constraints
        return is_possible and longest_stable_step(method, system)[0] > 0

    others = [name for name in _STEADY if has_step(name)]
    if "eig3" not in others and has_step("eig5"):
        others = ["eig5", *others]
    return f", such as {', '.join(map(repr, others))}" if others else ""


@one_blas_thread
def longest_stable_step(method: Method, system: Linearised, growth: float = 0.0) -> tuple[float, float, float]:
    """The limit, and the frequency and damping ratio of the mode that sets it.

    The limit is 0 if the method is unstable at every step, and infinite if nothing limits the step. With a `growth`,
    steps with at most this growth a step count as stable.
    """
    if not system.rates().any():
        return math.inf, 0.0, 0.0
    method, system, modes = _decoupled(method, system)
    limit, k, c = _coupled_limit(method, system, growth) if modes is None else _modal_limit(method, *modes, growth)
    return limit, *_frequency(k, c)


def _decoupled(method: Method, system: Linearised) -> tuple[Method, Linearised, tuple[np.ndarray, np.ndarray] | None]:
    """Return a method with an equal step, and k and c of the modes; or else None and a projected system."""
    if not system.C.any():
        method = method.without_velocity()  # an equal step, without a solve
    modes = _modes(system)
    if modes is None and not method.is_implicit and _sees_rates(method):
        k, c = _oscillators_of(system.rates())
        modes = _without_errors(system, k, c, k.max(), math.sqrt(k.max()))
    return method, system if modes else system.fastest(_directions(method)), modes


@one_blas_thread
def growth_by_step(method: Method, system: Linearised, h: float) -> float:
    """Return the numerical growth in one step h, which takes much less time than the longest stable step."""
    method, system, modes = _decoupled(method, system)
    if modes:
        return float(_growth_of_modes(method, *modes, np.array([h])).max())
    return float(_growth(_step_matrix(method, system, h), h, system.rates()))


def _directions(method: Method) -> int:
    """Number of directions of each of three kinds for the step of a system without common modes."""
    return _SOLVED if method.is_implicit else min(_STEPPED, _VALUES // (3 * state_size(method)))


def _frequency(k: complex, c: complex) -> tuple[float, float]:
    """Undamped frequency and damping ratio of a mode u'' + c u' + k u = 0; c is imaginary in a gyroscopic mode."""
    omega = math.sqrt(max(0.0, k.real))
    if abs(c.imag) > _COMMUTING * abs(c):
        rate = max(np.roots([1.0, c, k]), key=abs)
        omega, xi = abs(rate), -rate.real / abs(rate)
    else:
        xi = c.real / (2 * omega) if omega > 0 else math.inf
    return float(omega), 0.0 if abs(xi) < _COMMUTING else float(xi)


def _modes(system: Linearised) -> tuple[np.ndarray, np.ndarray] | None:
    """Return k and c of each common mode u'' + c u' + k u = 0 of K and C; None if they do not share modes."""
    K, C = system.K, system.C
    norm_k, norm_c = (float(np.linalg.norm(x, 2)) for x in (K, C))
    fastest = max(math.sqrt(norm_k), norm_c)
    norm_k, norm_c = norm_k or 1.0, norm_c or 1.0
    # The weight is arbitrary: it must only give different modes different sums.
    shapes = np.linalg.eig(K / norm_k + 0.7310585786 * C / norm_c)[1]
    k, c = (np.einsum("ij,ij->j", shapes.conj(), x @ shapes) for x in (K, C))
    left_k = np.abs(K @ shapes - k * shapes).max() / norm_k
    left_c = np.abs(C @ shapes - c * shapes).max() / norm_c
    imaginary = max(np.abs(k.imag).max() / norm_k, np.abs(c.imag).max() / norm_c)
    if max(left_k, left_c) > _COMMUTING or imaginary > (_COMMUTING if system.is_complete else _COMPLEX):
        return None
    return _without_errors(system, k.real, c.real, norm_k, fastest)


def _without_errors(
    system: Linearised, k: np.ndarray, c: np.ndarray, norm_k: float, fastest: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return k and c of modes, with zeros for what is an error of the differences: also where it seems to grow."""
    rigid = _RIGID if system.is_complete else _RIGID_PROJECTED
    return np.where(np.abs(k) < rigid * norm_k, 0.0, k), np.where(np.abs(c) < rigid * fastest, 0.0, c)


def _modal_limit(method: Method, k: np.ndarray, c: np.ndarray, allowed: float) -> tuple[float, float, float]:
    """The limit over all modes, and k and c of the mode that sets it."""
    scale = float(np.maximum(np.sqrt(np.abs(k)), np.abs(c)).max())
    k, c = k / scale / scale, c / scale
    moving = (k != 0) | (c != 0)
    k, c = k[moving], c[moving]
    growth = functools.partial(_growth_of_modes, method, k, c)
    slowest = float(np.where(k != 0, np.sqrt(np.abs(k)), np.abs(c)).min())
    steps = _geometric(_SHORTEST, _LONGEST / slowest, _FINE)
    if not c.any() and k.max() > 0:  # BM6 is unstable only in a short interval
        steps = np.union1d(steps, limit_of(method) / math.sqrt(k.max()) * _BEYOND)
        steps = steps[(steps > 0) & np.isfinite(steps)]
    blocks = np.array_split(steps, len(steps) // 50 + 1)

    def largest(h: np.ndarray) -> np.ndarray:
        return growth(h).max(axis=1)

    if allowed:
        limit, _ = first_above(largest, allowed, blocks)
    else:
        limit = first_exit(largest, _ROUND_OFF, blocks)
    if math.isinf(limit):
        return limit, 0.0, 0.0
    grown = growth(limit * _BEYOND if limit > 0 else np.array([0.1]))
    first = np.argmax(grown.max(axis=1) > 2 * _ROUND_OFF)  # at later steps, another mode may grow faster
    limiting = int(np.argmax(grown[first]))
    return limit / scale, float(k[limiting]) * scale * scale, float(c[limiting]) * scale


def _growth_of_modes(method: Method, k: np.ndarray, c: np.ndarray, h: np.ndarray) -> np.ndarray:
    """The numerical growth in one step, shape (steps, modes)."""
    root = np.sqrt((c * c / 4 - k).astype(complex))
    rates, h = np.stack([-c / 2 + root, -c / 2 - root], axis=-1), h[:, None]
    return _growth(oscillator_matrices(method, h * h * k, h * c), h, rates)


def _geometric(first: float, last: float, ratio: float) -> np.ndarray:
    return first * ratio ** np.arange(math.ceil(math.log(last / first) / math.log(ratio)) + 1)


def _growth(matrices: np.ndarray, h: Any, rates: np.ndarray) -> np.ndarray:
    """The numerical growth in one step, beyond the physical growth of the system with these rates.

    The matrix may have as many roots outside the unit circle as the system has growing rates. These roots may grow at
    up to twice the fastest of the rates.
    """
    sizes = np.abs(eigenvalues(matrices))
    growing = (rates.real > _RIGID / 2 * np.abs(rates).max()).sum(axis=-1)  # the real part of a pair is -c / 2
    fastest = np.where(growing > 0, rates.real.max(axis=-1), 0.0)
    with np.errstate(over="ignore"):
        beyond = sizes.max(axis=-1) - np.exp(2 * h * fastest)
    allowed = np.arange(sizes.shape[-1]) < growing[..., None]
    others = np.where(allowed, 0.0, -np.sort(-sizes, axis=-1)).max(axis=-1) - 1
    return np.where(np.isfinite(sizes).all(axis=-1), np.maximum(beyond, others), np.inf)


def _oscillators_of(rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """k and c of oscillators with these rates: one for each conjugate pair or, with a double root, for a real rate."""
    upper = rates[rates.imag >= 0]
    return np.abs(upper) ** 2, -2 * upper.real


@functools.cache
def _sees_rates(method: Method) -> bool:
    """Whether the step of the method depends only on the rates of a system, as for every method of first-order systems.

    The test system has stiffness, damping and gyroscopic forces of similar size, without common modes.
    """
    system = Linearised(np.array([[1.0, 0.0], [0.0, 0.5]]), np.array([[0.3, 0.5], [-0.4, 0.6]]), 0)
    k, c = _oscillators_of(system.rates())
    by_rates = eigenvalues(oscillator_matrices(method, k, c)).ravel()
    apart = np.abs(eigenvalues(_step_matrix(method, system, 1.0))[:, None] - by_rates)
    return bool(apart.min(axis=1).max() < _SAME and apart.min(axis=0).max() < _SAME)


def _coupled_limit(method: Method, system: Linearised, allowed: float) -> tuple[float, complex, complex]:
    """The limit of modes that do not decouple, from the eigenvalues of the method's step of the whole system."""
    rates = system.rates()

    def is_stable(h: float, tolerance: float = max(allowed, _COUPLED_ROUND_OFF)) -> bool:
        return bool(_growth(_step_matrix(method, system, h), h, rates) <= tolerance)

    low = high = 0.0
    for high in _steps(method, system, float(np.abs(rates).max())):
        if not is_stable(high):
            break
        low = high
    else:
        return math.inf, 0.0, 0.0
    near = _NEAR if system.is_complete else _NEAR_PROJECTED
    while low > 0 and high > (1 + near) * low:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if is_stable(middle) else (low, middle)
    # As in `first_exit`: a method that grows at every step also exceeds the tolerance, but not steeply. Several steps
    # are tried, because the system can be stable again just beyond a limit.
    steep = [h for h in (_BEYOND * high).tolist() if not is_stable(h, 2 * _COUPLED_ROUND_OFF)]
    shape = _limiting_shape(method, system, max(steep, default=high))
    k, c = _oscillator_like(system, shape)
    # With weak damping, the growth beyond a limit is not steep either. But then nothing grows at a shorter step.
    grows_at_every_step = not steep and not is_stable(_SHORTER * high, _COUPLED_ROUND_OFF / 100)
    return 0.0 if grows_at_every_step and not allowed else low, k, c


def _limiting_shape(method: Method, system: Linearised, h: float) -> np.ndarray:
    """Return the displacements, of norm 1, of the mode that is unstable at the step h."""
    matrix = _step_matrix(method, system, h)
    if np.isfinite(matrix).all():
        values, vectors = np.linalg.eig(matrix)
        # A numerical instability alternates or oscillates from step to step. Physical growth does not.
        limiting = np.argmax(np.where(np.abs(values) > 1, np.abs(values - 1), 0.0))
        shape = vectors[: len(system.K), limiting]
    else:  # the solve for v fails, because h C is too large
        values, vectors = np.linalg.eig(system.C)
        shape = vectors[:, np.argmax(np.abs(values))]
    return shape / np.linalg.norm(shape)


def _oscillator_like(system: Linearised, shape: np.ndarray) -> tuple[complex, complex]:
    """Return k and c of the mode with the displacements that are most like a shape, which is not exactly a mode."""
    rates, vectors = system.modes()
    shapes = vectors[: len(shape)] / np.linalg.norm(vectors[: len(shape)], axis=0)
    rate = rates[np.argmax(np.abs(shape.conj() @ shapes))]
    if rate.imag:
        return abs(rate) ** 2, -2 * rate.real
    return complex(shape.conj() @ system.K @ shape), complex(shape.conj() @ system.C @ shape)


def _steps(method: Method, system: Linearised, fastest: float) -> list[float]:
    """The steps at which to test for an instability, from the shortest to the longest.

    They include some steps just above the undamped limit of the stiffest mode. A solution of central difference that
    alternates from step to step has zero velocity, and gyroscopic forces do not act on it: there one mode becomes
    unstable. At the undamped limit of a second mode, gyroscopic forces can stabilise both again.
    """
    stiffness = np.abs(np.linalg.eigvals(system.K))
    stiffest = math.sqrt(stiffness.max())
    restored = stiffness[stiffness > _RIGID * stiffness.max()]
    slowest = math.sqrt(restored.min()) if restored.size else fastest
    # A method of high order has a short limit with damping.
    damped = limit_of(method, 0.0 if method.ignores_velocity else 1.0) or math.inf
    shortest = min(_COUPLED_SHORTEST, _FIRST_PART * damped)
    steps = _geometric(shortest / fastest, _LONGEST / slowest, _COARSE)
    if stiffest > 0:
        beyond = limit_of(method.without_velocity()) / stiffest * _BEYOND
        steps = np.concatenate([steps, beyond[(beyond > steps[0]) & (beyond < steps[-1])]])
    return sorted(steps.tolist())


def _step_matrix(method: Method, system: Linearised, h: float) -> np.ndarray:
    """The matrix of one step of the whole system on (u, h v, past ...), column by column from the unit states."""
    m, rows = len(system.K), state_size(method)
    size = m * rows
    params = np.concatenate([[m], h * h * system.K.ravel(), h * system.C.ravel()])
    units = np.eye(size).reshape(size, rows, m)
    each = max(1, _SOLVED_TOGETHER // m) if method.is_implicit else size
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
