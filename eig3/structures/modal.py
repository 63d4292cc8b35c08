"""The exact motion of a linear structure by modal superposition, for forces and ground motions given as records."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..functions.checks import check_count, reals
from ..functions.named import Parameters
from ..problem import Problem, UnknownMotion
from .factors import Factors
from .matrices import Mass
from .modes import natural_modes
from .structure import mass_of, matrix_of

_LARGEST = 1000  # degrees of freedom up to which all modes are computed, in some tenths of a second
_MIXED = 1e-8  # relative to the largest damping rate; a smaller coupling of two modes is neglected
_SERIES = 1e-2  # up to this x, a series of three terms for sinh(x) is exact
_TERMS = 18  # of a Taylor series of exp(x) that is exact up to x = 1
_TIMES = 4096  # times evaluated at once
_BY_MODES = "eig3.structures.modal_solution(problem, t) returns it"
_STRUCTURE = ("K", "m", "M", *Factors._fields, "modes", "rates")  # parameters that eig3.linear computes together


def modal_solution(problem: Problem, t: ArrayLike, modes: int | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return the exact motion of a problem of `eig3.linear`, by modal superposition.

    Each mode is a linear oscillator. Between two times of a record its force is linear, and its motion has a closed
    form: see Chopra, Dynamics of Structures, section 5.2.

    Parameters
    ----------
    problem : Problem
        A problem whose damping does not couple the modes, with forces given as records.
    t : array_like, shape (s,)
        Times, s, not before the start of the problem.
    modes : int, optional
        The number of the lowest modes; by default all modes. The other modes are left out, also of the initial values.

    Returns
    -------
    u, v : ndarray, shape (s, n)

    Raises
    ------
    TypeError, ValueError
        If an argument is not valid, or damping couples the modes.
    """
    if not isinstance(problem, Problem) or not {"size", "K"} <= set(getattr(problem._layout, "names", ())):
        raise TypeError("problem must be a problem of eig3.linear with a stiffness K.")
    rhs = getattr(problem.rhs.py_func, "inner", problem.rhs).py_func
    if "states" in problem.params._asdict():
        raise ValueError("the links of this problem have no modes: leave them out.")
    if rhs.__globals__.get("force") is not None:
        raise ValueError("the force of this problem is a function: the motion of its modes has no closed form.")
    count = None if modes is None else check_count(modes, "modes")
    return ModalMotion(problem.params, problem.u0, problem.v0, problem.t_span[0], count)(t)


def exact_motion(params: Any, u0: np.ndarray, v0: np.ndarray, t0: float) -> ModalMotion | UnknownMotion:
    """Return the exact motion if its cost is small. The forces must be records."""
    if "K" not in params.layout.names:
        return unknown("it has no K")
    if "C" in params.layout.names:
        return unknown(f"C may couple the modes: {_BY_MODES} if it does not")
    if params.size > _LARGEST:
        return unknown(f"it has more than {_LARGEST} degrees of freedom: {_BY_MODES}")
    return ModalMotion(params, u0, v0, t0)


def unknown(why: str) -> UnknownMotion:
    """Return the placeholder of an exact motion that is not known, with the reason."""
    return UnknownMotion(f"the exact motion of this structure is not known, because {why}.")


class ModalMotion:
    """The motion of a linear structure: a function of an array of times, which returns u and v.

    Parameters
    ----------
    params : Parameters
        The parameters of a problem of `eig3.linear`.
    u0, v0 : ndarray, shape (n,)
    t0 : float
    modes : int, optional
        Number of modes; by default all.
    """

    def __init__(self, params: Any, u0: Any, v0: Any, t0: float, modes: int | None = None) -> None:
        self._params, self._start, self._t0, self._count = params._asdict(), (u0, v0), t0, modes

    def again(self, params: Any, u0: Any, v0: Any, t0: float) -> ModalMotion | UnknownMotion:
        """Return the motion for other initial values and loads."""
        own, other = (
            Parameters({name: each[name] for name in _STRUCTURE if name in each})
            for each in (self._params, params._asdict())
        )
        if own == other:
            return ModalMotion(params, u0, v0, t0)
        return unknown("K, its mass or its modes have changed: make the changed problem with eig3.linear")

    def __call__(self, t: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        times = np.atleast_1d(reals(t, "t"))
        if not (np.isfinite(times).all() and (times >= self._t0).all()):
            raise ValueError(f"t must be finite times from the start {self._t0:g} on.")
        u, v = np.empty((2, times.size, self._params["size"]))
        knots, q, rate, force, slope = self._at_knots
        for begin in range(0, times.size, _TIMES):
            some = slice(begin, begin + _TIMES)
            k = np.searchsorted(knots, times[some], side="right") - 1
            state = self._moved(times[some] - knots[k], q[k], rate[k], force[k], slope[k])
            u[some], v[some] = (x @ self._shapes.T for x in state)
        return u, v

    @cached_property
    def _modes(self) -> tuple[np.ndarray, np.ndarray]:
        count = self._params["size"] if self._count is None else self._count
        return natural_modes(self._mass, matrix_of(self._params["K"]), count)

    @property
    def _shapes(self) -> np.ndarray:
        return self._modes[1]

    @cached_property
    def _mass(self) -> Mass:
        return mass_of(self._params)

    @cached_property
    def _rates(self) -> np.ndarray:
        """The damping rates, 2 xi omega, of the modes."""
        (omega, shapes), has = self._modes, self._params
        rates = np.zeros_like(omega)
        if "b" in has:
            rates += has["a"] + has["b"] * omega**2
        if "rates" in has:
            own = np.einsum("ji,ji->j", has["modes"], has["rates"])[: rates.size]
            rates[: own.size] += own
        if "C" in has:
            full = shapes.T @ (matrix_of(has["C"]) @ shapes)
            mixed = np.abs(full - np.diag(np.diag(full))).max()
            if mixed > _MIXED * np.abs(full).max():
                raise ValueError("C couples the modes, which then have no closed form: integrate the problem.")
            rates += np.diag(full)
        return rates

    @cached_property
    def _at_knots(self) -> tuple[np.ndarray, ...]:
        """The times between which forces are linear; there, modal coordinates and rates, forces and slopes."""
        records = self._records()
        knots = np.unique(np.concatenate([[self._t0], *(t[t > self._t0] for t, *_ in records)]))
        force, slope = np.zeros((2, knots.size, self._shapes.shape[1]))
        for times, values, parts in records:
            inside = np.flatnonzero((knots[:-1] >= times[0]) & (knots[1:] <= times[-1]))
            low, high = (
                np.stack([np.interp(knots[k], times, column) for column in values.T], axis=1)
                for k in (inside, inside + 1)
            )
            force[inside] += low @ parts
            slope[inside] += (high - low) / np.diff(knots)[inside, None] @ parts
        q, rate = np.empty((2, *force.shape))
        q[0], rate[0] = (self._shapes.T @ (self._mass.matrix @ x) for x in self._start)
        for k, step in enumerate(np.diff(knots)):
            q[k + 1], rate[k + 1] = (
                x[0] for x in self._moved(np.array([step]), q[k : k + 1], rate[k : k + 1], force[k], slope[k])
            )
        return knots, q, rate, force, slope

    def _records(self) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Return the records: times, values, and the force of each value on each mode, shape (values, modes)."""
        has, found = self._params, []
        if "ground" in has:
            parts = -has["ground_scale"] * (self._mass.matrix @ has["influence"]) @ self._shapes
            found.append((has["ground_times"], has["ground"][:, None], parts[None]))
        if "forces" in has:
            found.append((has["force_times"], has["forces"], has["force_scale"] * self._shapes[has["degrees"]]))
        return found

    def _moved(self, tau: np.ndarray, q: Any, rate: Any, force: Any, slope: Any) -> tuple[np.ndarray, np.ndarray]:
        """Return the coordinates and their rates after the times tau of a linear force, in closed form.

        It is the sum of the particular solution, which is linear in time, and of the free motion from the difference of
        the initial values.
        """
        omega, c, tau = self._modes[0], self._rates, tau[:, None]
        rigid = omega == 0
        w = np.where(rigid, 1.0, omega**2)
        velocity = slope / w
        place = (force - c * velocity) / w
        free = _free(np.where(rigid, 1.0, omega), c, tau, q - place, rate - velocity)
        u, v = free[0] + place + velocity * tau, free[1] + velocity
        if rigid.any():
            u, v = (np.where(rigid, a, b) for a, b in zip(_pushed(c, tau, q, rate, force, slope), (u, v), strict=True))
        return u, v


def _free(omega: np.ndarray, c: np.ndarray, tau: np.ndarray, q: Any, rate: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the free motion of oscillators, including critical damping and overdamping."""
    root = np.sqrt((0.5 * c) ** 2 - omega**2 + 0j)
    plus, minus = (np.exp((-0.5 * c + sign * root) * tau) for sign in (1, -1))
    cosine = (0.5 * (plus + minus)).real
    x = root * tau
    is_small = np.abs(x) < _SERIES  # near critical damping, the difference of plus and minus would lose digits
    series = tau * np.exp(-0.5 * c * tau) * (1 + x**2 / 6 * (1 + x**2 / 20)).real
    sine = np.where(is_small, series, ((plus - minus) / np.where(is_small, 1, 2 * root)).real)
    u = (cosine + 0.5 * c * sine) * q + sine * rate
    return u, -(omega**2) * sine * q + (cosine - 0.5 * c * sine) * rate


def _pushed(c: np.ndarray, tau: np.ndarray, q: Any, rate: Any, force: Any, slope: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the motion of masses without springs, with and without damping."""
    decay, first, second, third = _phi_functions(-c * tau)
    v = decay * rate + tau * (first * force + tau * second * slope)
    return q + tau * (first * rate + tau * (second * force + tau * third * slope)), v


def _phi_functions(x: np.ndarray) -> list[np.ndarray]:
    """Return phi_0(x) = exp(x) to phi_3(x) of exponential integrators: phi_k+1(x) = (phi_k(x) - 1 / k!) / x.

    The differences would lose digits at a small x, where the Taylor series has them all.
    """
    is_small, w = np.abs(x) < 1, np.where(x == 0, 1.0, x)
    small = np.where(is_small, x, 0.0)
    found = [np.exp(x)]
    for k in range(1, 4):
        series = sum(small**i / math.factorial(i + k) for i in range(_TERMS))
        found.append(np.where(is_small, series, (found[-1] - 1 / math.factorial(k - 1)) / w))
    return found
