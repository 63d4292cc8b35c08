"""Detect stiff motions: stability, and not accuracy, limits the steps of the run.

A motion is stiff for a method if perturbations decay within a step, but would grow numerically with a slightly longer
step. The test uses the largest rates of the linearised system at some states of the run, with about fifty evaluations
each. Fast vibrations with little damping do not count, because they may be part of the wanted solution.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from ..methods import Method
from ..stability import eigenvalues, oscillator_matrices
from .linearisation import fast_rates

#: A shorter run is faster than a run with an implicit method.
MANY_STEPS = 2000
#: Number of states in the test.
STATES = 16
_MOST = 0.75  # least fraction of stiff states
_LONGER = 1.25  # factor to a step with which a stiff motion would grow,
_GROWTH = 1.1  # by more than this in a step
_DAMPED = 0.7  # least damping ratio of a mode that decays within its period
_LEAST = 0.5  # no method is unstable for a smaller product of decay rate and step


def stiffness(method: Method, f: Callable, states: Iterable[tuple[float, Any, Any, float]], limited: str) -> str:
    """Describe a stiff motion; empty if it is not stiff.

    Parameters
    ----------
    method : Method
        The method of the steps.
    f : callable
        ``f(t, u, v)``, the acceleration.
    states : iterable of (t, u, v, h)
        States, each with the step there.
    limited : str
        The quantity that would otherwise limit the steps, such as rtol.
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
