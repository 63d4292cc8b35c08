"""Find out whether stability, and not the accuracy, decides about the steps of a run: whether its motion is stiff.

A motion is stiff for a method if disturbances of it decay within a step, while a step that is a little longer would let
them grow numerically. This is judged at some states of the run by the largest rates of the linearised system, which
take some fifty evaluations each. A fast vibration is not counted: with little damping, its motion may be wanted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from ..methods import Method
from ..stability import eigenvalues, oscillator_matrices
from .linear import fast_rates

#: A shorter run takes less time than one with an implicit method would.
MANY_STEPS = 2000
#: Number of states to look at.
STATES = 16
_MOST = 0.75  # part of them in which the motion must be stiff
_LONGER = 1.25  # factor to a step with which a stiff motion would grow,
_GROWTH = 1.1  # by more than this in a step
_DAMPED = 0.7  # damping ratio from which on a mode decays within its period
_LEAST = 0.5  # no method of the library is unstable for a smaller rate times a step that decays


def stiffness(method: Method, f: Callable, states: Iterable[tuple[float, Any, Any, float]], limited: str) -> str:
    """Describe a motion that is stiff; empty if it is not.

    Parameters
    ----------
    method : Method
        The record that takes the steps.
    f : callable
        ``f(t, u, v)``, the acceleration.
    states : iterable of (t, u, v, h)
        States, each with the step there.
    limited : str
        What would decide about the steps otherwise.
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
    """Return the rate of the decay that limits the step at a state; 0.0 if none does."""
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
