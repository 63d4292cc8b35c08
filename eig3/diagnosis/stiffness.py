"""Detect stiff motions: stability, and not accuracy, limits the steps of the run.

A motion is stiff for a method if perturbations decay within a step, but would grow numerically with a slightly longer
step. The test uses the largest rates of the linearised system at some states of the run, with about fifty evaluations
each. Fast vibrations with little damping do not count, because they may be part of the wanted solution. If they are
not, because the motion is far slower, a fixed step may take fewer evaluations.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from ..methods import EIG3, Method
from ..stability import eigenvalues, limit, oscillator_matrices
from .linearisation import fast_rates

#: A shorter run is faster than a run with an implicit method.
MANY_STEPS = 2000
#: The search for a vibration takes a small part of the time of such a run.
VERY_MANY_STEPS = 20_000
#: Number of states in the test.
STATES = 16
_MOST = 0.75  # least fraction of stiff states
_LONGER = 1.25  # factor to a step with which a stiff motion would grow,
_GROWTH = 1.1  # by more than this in a step
_DAMPED = 0.7  # least damping ratio of a mode that decays within its period
_LEAST = 0.5  # no method is unstable for a smaller product of rate and step
_SLOW = 1e-3  # largest ratio of acceleration to way in a motion far slower than a vibration, in units of omega^2,
_SMOOTH = 0.1  # and in units of 1 / h^2, before the vibrations are searched
_EVEN = 2.0  # largest ratio of two steps that one vibration limits
_SAFETY, _GAIN = 0.9, 3.0  # of the fixed step that a note names, and the least factor by which it saves evaluations


def stiffness(method: Method, f: Callable, states: Iterable[tuple[float, Any, Any, float]], limited: str) -> str:
    """Describe a stiff motion; empty if it is not stiff.

    ``f(t, u, v)`` is the acceleration. Each of the states (t, u, v, h) comes with the step there. `limited` is the
    quantity that would otherwise limit the steps, such as rtol.
    """
    states = list(states)
    looked = [_stiff_rate(method, f, *state) for state in states]
    rates = [rate for rate in looked if rate]
    if not rates or len(rates) < _MOST * len(looked):
        return ""
    call, where = "fun, t_span, [*u0, *v0]", ", where fun(t, [*u, *v]) returns [*v, *a]"
    if np.ndim(states[0][1]) == 0:
        call, where = "lambda t, y: (y[1], rhs(t, *y, p)), t_span, (u0, v0)", ""
    return (
        f"The motion is stiff: in {len(rates)} of {len(looked)} states, stability limits the step of {method.label} "
        f"and {limited} does not, because disturbances decay at a rate of {np.median(rates):.2g}. An implicit method "
        f'may take far fewer steps: scipy.integrate.solve_ivp({call}, method="Radau"){where}.'
    )


def vibration(method: Method, f: Callable, states: Iterable[tuple[float, Any, Any, float]]) -> str:
    """Describe a vibration that limits all steps although the motion is far slower; empty if there is none.

    The arguments are as for `stiffness`.
    """
    states = list(states)
    h = np.array([h for *_, h in states])
    try:
        most = max(np.linalg.norm(f(t, u, v)) for t, u, v, _ in states)
        way = np.linalg.norm(np.ptp([u for _, u, *_ in states], axis=0)) / 2
        if not most * np.median(h) ** 2 < _SMOOTH * way:
            return ""
        with np.errstate(over="ignore", invalid="ignore"):
            if abs(_fastest(fast_rates(f, *states[-1]))) < _LEAST:
                return ""
            rates = np.array([_fastest(fast_rates(f, *state)) for state in states])
    except Exception:  # rhs may fail beyond the states of the motion
        return ""
    size, omega, xi = np.abs(rates), np.median(np.abs(rates) / h), np.median(-rates.real / np.abs(rates))
    if size.min() < _LEAST or size.max() > _EVEN * size.min() or not most < _SLOW * omega**2 * way:
        return ""
    step = _SAFETY * limit(EIG3(), max(0.0, float(xi))) / omega
    gain = (method.evaluations or 1) * step / np.median(h)
    if xi > _DAMPED or gain < _GAIN:
        return ""
    return (
        f"The fastest vibration, with omega = {omega:.3g}, limits the steps of {method.label}, and the motion is far "
        f"slower. If this vibration does not matter, EIG-3 with the fixed step h = {step:.2g} takes 1/{gain:.0f} of "
        "the evaluations, and check=True estimates its error."
    )


def _fastest(rates: np.ndarray) -> complex:
    return complex(rates[np.argmax(np.abs(rates))])


def _stiff_rate(method: Method, f: Callable, t: float, u: Any, v: Any, h: float) -> float:
    """Return the decay rate that limits the step at a state; 0.0 if there is none."""
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            rates = fast_rates(f, t, u, v, h)
    except Exception:  # rhs may fail beyond the states of the motion
        return 0.0
    size = np.abs(rates)
    decaying = rates[(size > _LEAST) & (-rates.real > _DAMPED * size)]
    if not len(decaying):
        return 0.0
    fastest = decaying[np.argmax(np.abs(decaying))]
    # The oscillator with this rate and its conjugate, or with this rate and 0.
    k, c = (abs(fastest) ** 2, -2 * fastest.real) if fastest.imag else (0.0, -fastest.real)
    matrix = oscillator_matrices(method, np.array([_LONGER**2 * k]), np.array([_LONGER * c]))
    return abs(fastest) / h if np.abs(eigenvalues(matrix)).max() > _GROWTH else 0.0
