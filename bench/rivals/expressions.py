"""The problems as formulas, for packages that compile them from their own symbols.

`symbols` has the functions of the package, and `time`: the module heyoka, or a namespace with the functions of JAX.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial


def _spring_pendulum(symbols, u, v, p):
    m, l0, k, g = p
    return [
        u[0] * v[1] * v[1] - k / m * (u[0] - l0) + g * symbols.cos(u[1]),
        -(2.0 * v[0] * v[1] + g * symbols.sin(u[1])) / u[0],
    ]


def _henon_heiles(symbols, u, v, p):
    x, y = u
    return [-x - 2.0 * x * y, -y - x * x + y * y]


def _rotor(symbols, u, v, p):
    x, y = u
    square, beta, speed = p
    stiffness = square * (1.0 + beta * (x * x + y * y)) - speed * speed
    return [2.0 * speed * v[1] - stiffness * x, -2.0 * speed * v[0] - stiffness * y]


def _kepler(symbols, u, v, p):
    pull = p[0] * (u[0] * u[0] + u[1] * u[1]) ** -1.5
    return [-pull * u[0], -pull * u[1]]


def _double_pendulum(symbols, u, v, p):
    m1, m2, l1, l2, g = p
    m, sine, cosine = m1 + m2, symbols.sin(u[0] - u[1]), symbols.cos(u[0] - u[1])
    sine1, sine2 = symbols.sin(u[0]), symbols.sin(u[1])
    pull1, pull2 = l1 * v[0] * v[0], l2 * v[1] * v[1]
    inertia = m1 + m2 * sine * sine
    return [
        -(m2 * sine * (pull1 * cosine + pull2) + g * (m * sine1 - m2 * sine2 * cosine)) / (l1 * inertia),
        (sine * (m * pull1 + m2 * pull2 * cosine) + m * g * (sine1 * cosine - sine2)) / (l2 * inertia),
    ]


def _duffing(symbols, u, v, p):
    a, b, delta, gamma, omega = p
    return [gamma * symbols.cos(omega * symbols.time) - u[0] * (a + b * u[0] * u[0]) - delta * v[0]]


def _arenstorf(symbols, u, v, p):
    (x, y), mu = u, p[0]
    to_earth, to_moon = x + mu, x - (1 - mu)
    earth = (1 - mu) * (to_earth * to_earth + y * y) ** -1.5
    moon = mu * (to_moon * to_moon + y * y) ** -1.5
    return [x + 2.0 * v[1] - earth * to_earth - moon * to_moon, y - 2.0 * v[0] - (earth + moon) * y]


def _hertz_impact(symbols, u, v, p):
    """With heyoka, the event that switches the force on and off writes parameter 0."""
    if not hasattr(symbols, "par"):
        pressed = symbols.maximum(-u[0], 0.0)
        return [p[0] * pressed * symbols.sqrt(pressed)]
    touches = symbols.gt(symbols.par[0], 0.5)
    indentation = symbols.select(touches, -u[0], 1.0)
    return [symbols.select(touches, p[0] * indentation * symbols.sqrt(indentation), 0.0)]


def _second_differences(u):
    return [(u[j - 1] if j else 0.0) - 2.0 * u[j] + (u[j + 1] if j < len(u) - 1 else 0.0) for j in range(len(u))]


def _attractions(symbols, u, v, masses, dimension):
    """The accelerations of bodies that attract each other; each pair is computed once."""
    parts = [[] for _ in u]
    for i in range(len(masses)):
        for k in range(i):
            places = [(dimension * i + axis, dimension * k + axis) for axis in range(dimension)]
            ways = [u[second] - u[first] for first, second in places]
            pull = symbols.sum([way * way for way in ways]) ** -1.5
            for way, (first, second) in zip(ways, places, strict=True):
                parts[first].append(masses[k] * (pull * way))
                parts[second].append(-masses[i] * (pull * way))
    return [symbols.sum(part) for part in parts]


def _damped_bar(symbols, u, v, p):
    pairs = zip(_second_differences(u), _second_differences(v), strict=True)
    return [p[0] * bent + p[1] * rate for bent, rate in pairs]


def _hardening_chain(symbols, u, v, p):
    stretches = [u[0], *(u[j + 1] - u[j] for j in range(len(u) - 1))]
    forces = [p[0] * stretch * (1.0 + p[1] * stretch * stretch) for stretch in stretches]
    return [(forces[j + 1] if j < len(u) - 1 else 0.0) - forces[j] for j in range(len(u))]


#: ``(symbols, u, v, params) -> accelerations``, by the name of the problem.
EXPRESSIONS: dict[str, Callable] = {
    "single_dof": lambda symbols, u, v, p: [-p[0] * p[0] * u[0]],
    "hardening_spring": lambda symbols, u, v, p: [-p[0] * u[0] * (1.0 + p[1] * u[0] * u[0])],
    "softening_spring": lambda symbols, u, v, p: [-p[0] * symbols.tanh(u[0])],
    "spring_pendulum": _spring_pendulum,
    "henon_heiles": _henon_heiles,
    "rotor": _rotor,
    "kepler": _kepler,
    "double_pendulum": _double_pendulum,
    "duffing": _duffing,
    "van_der_pol": lambda symbols, u, v, p: [p[0] * (1.0 - u[0] * u[0]) * v[0] - u[0]],
    "arenstorf": _arenstorf,
    "hertz_impact": _hertz_impact,
    "bouncing_ball": lambda symbols, u, v, p: [symbols.expression(-p[0])],
    "elastic_bar": lambda symbols, u, v, p: [p[0] * bent for bent in _second_differences(u)],
    "damped_bar": _damped_bar,
    "hardening_chain": _hardening_chain,
    "figure_eight": partial(_attractions, dimension=2),
    "outer_solar_system": partial(_attractions, dimension=3),
}
