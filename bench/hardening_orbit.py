"""The periodic motion of the hardening spring in closed form, and the energy that a method takes out of it."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from eig3.kernels.methods.eig import ordinates, sigma
from eig3.methods import Method
from eig3.problems import hardening_spring

S1, S2, AMPLITUDE = 100.0, 10.0, 1.5  # as in the article

_HARMONICS = np.arange(1, 32, 2)
_PHASES = 64  # at which a step is taken; the mean over a period then converges to round-off
_INCREMENTS = 60  # of the time, in which the energy is integrated


def harmonics(amplitude: float) -> tuple[float, np.ndarray]:
    """The frequency omega and the coefficients c_j of u = sum c_j cos(j omega t), j = 1, 3, ...

    u is the elliptic function cn, whose parameter m is S2 A^2 / (2 (1 + S2 A^2)).
    """
    square = S2 * amplitude**2
    m = square / (2 * (1 + square))
    K, K_complement = (math.pi / (2 * _mean(math.sqrt(x))) for x in (1 - m, m))
    omega = math.sqrt(S1 * (1 + square)) * math.pi / (2 * K)
    nome = math.exp(-math.pi * K_complement / K)
    c = 2 * math.pi * amplitude / (math.sqrt(m) * K) * nome ** (_HARMONICS / 2) / (1 + nome**_HARMONICS)
    return omega, c


def _mean(x: float) -> float:
    """The arithmetic-geometric mean of 1 and x."""
    a, b = 1.0, x
    while a - b > 1e-15:
        a, b = (a + b) / 2, math.sqrt(a * b)
    return a


def eig_power(grade: int, h: float) -> Callable[[float], float]:
    """The mean power of EIG of a grade, as a function of the amplitude.

    u_{n+1} - 2 u_n + u_{n-1} = h^2 sum b_i a_{n-i} is D^2 u = K(h D) a with D = d/dt and
    K(x) = x^2 sum b_i exp(-i x) / (2 cosh x - 2). So D^2 u = a + (1 - 1/K) D^2 u: the method adds a force to the exact
    equation, whose mean power is a sum over the harmonics.
    """
    weights = np.array([float(b) for b in ordinates(sigma(grade - 1))])

    def power(amplitude: float) -> float:
        omega, c = harmonics(amplitude)
        x = 1j * _HARMONICS * omega * h
        K = x**2 * (np.exp(-np.outer(x, np.arange(weights.size))) @ weights) / (2 * np.cosh(x) - 2)
        return float(((_HARMONICS * omega) ** 3 * c**2 / 2 * (1 / K).imag).sum())

    return power


def one_step_power(method: Method, h: float) -> Callable[[float], float]:
    """The mean power of a one-step method, as a function of the amplitude: steps from states of the exact motion."""

    def power(amplitude: float) -> float:
        omega, c = harmonics(amplitude)
        angles = np.outer(2 * math.pi / _PHASES * np.arange(_PHASES), _HARMONICS)
        u, v = np.cos(angles) @ c, -np.sin(angles) @ (omega * _HARMONICS * c)
        gained = 0.0
        for u0, v0 in zip(u.tolist(), v.tolist(), strict=True):
            stepper = hardening_spring(S1, S2, u0, v0).stepper(h=h, method=method)
            stepper.advance(1)
            gained += energy(stepper.u, stepper.v) - energy(u0, v0)
        return gained / _PHASES / h

    return power


def energy_after(power: Callable[[float], float], duration: float) -> float:
    """The energy after a time, from the power at each amplitude: dA/dt = power(A) / (dE/dA), by the midpoint rule."""

    def rate(amplitude: float) -> float:
        return power(amplitude) / (S1 * amplitude * (1 + S2 * amplitude**2))

    amplitude, dt = AMPLITUDE, duration / _INCREMENTS
    for _ in range(_INCREMENTS):
        amplitude += dt * rate(amplitude + dt / 2 * rate(amplitude))
    return energy(amplitude, 0.0)


def energy(u: float, v: float) -> float:
    return v**2 / 2 + S1 * u**2 / 2 + S1 * S2 * u**4 / 4
