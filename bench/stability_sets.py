"""The methods of `eig3 bench stability`: parameter sets of EIG-3, limits in closed form, rates of growth."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from eig3 import problems
from eig3.methods import AB2, AB3, EIG3, RK2, RK3, RK4, CentralDifference, Method


@dataclass(frozen=True)
class MethodLimit:
    """A method and its limit of omega h, if known as a formula and as a function of xi."""

    label: str
    method: Method
    formula: str = "-"
    closed_form: Callable[[float], float] | None = None


def alternating(method: EIG3, xi: float) -> float:
    """The omega h at which an eigenvalue of EIG-3 is -1: (alpha - beta) Omega^2/2 + (1 + 2 beta) xi Omega = 1."""
    half, damping = method.alpha - method.beta, (1 + 2 * method.beta) * xi
    return (math.sqrt(damping * damping + 2 * half) - damping) / half


def weak_growth(method: EIG3, Omega: float) -> float:
    """The growth per step of EIG-3 with beta = 1/2, up to O(Omega^6)."""
    return (1 - method.alpha) * Omega**4 / 4


EIG3_SETS = {
    "EIG-3(1, 1/2)": EIG3(),
    "EIG-3(1.2, 1/2)": EIG3(1.2),
    "EIG-3(1.5, 1/2)": EIG3(1.5),
    "EIG-3(2, 1/2)": EIG3(2.0),
    "EIG-3(1.2, 0.6)": EIG3(1.2, 0.6),
    "EIG-3(2, 1)": EIG3(2.0, 1.0),
    "EIG-3(1, 0.6)": EIG3(1.0, 0.6),
}
UNSTABLE_SETS = {
    "EIG-3(0.8, 1/2)": EIG3(0.8),
    "EIG-3(1/2, 1/2)": EIG3(0.5),
    "EIG-3(1/3, 1/2)": EIG3(1 / 3),
    "EIG-3(0, 0)": EIG3(0.0, 0.0),
}
_IMPLICIT = CentralDifference(velocity="implicit", solver="newton")
UNDAMPED = (
    *(
        MethodLimit(label, method, "sqrt(2/(alpha - beta))", partial(alternating, method))
        for label, method in EIG3_SETS.items()
        if label != "EIG-3(1, 0.6)"
    ),
    MethodLimit("EIG-3(1, 0.6)", EIG3(1.0, 0.6), "1/sqrt(beta + 1/2)", lambda xi: 1 / math.sqrt(1.1)),
    MethodLimit("CD", _IMPLICIT, "2", lambda xi: 2.0),
    MethodLimit("RK3", RK3(), "sqrt(3)", lambda xi: math.sqrt(3)),
    MethodLimit("RK4", RK4(), "2 sqrt(2)", lambda xi: 2 * math.sqrt(2)),
    MethodLimit("AB3", AB3(), "12/(5 sqrt(11))", lambda xi: 12 / (5 * math.sqrt(11))),
)
DAMPED = (
    MethodLimit("EIG-3(1, 1/2)", EIG3(), "2 (sqrt(1 + 4 xi^2) - 2 xi)", partial(alternating, EIG3())),
    MethodLimit("EIG-3(1.2, 1/2)", EIG3(1.2), "(sqrt(1.4 + 4 xi^2) - 2 xi)/0.7", partial(alternating, EIG3(1.2))),
    MethodLimit("CD implicit", _IMPLICIT, "2", lambda xi: 2.0),
    MethodLimit(
        "CD lagged",
        CentralDifference(velocity="lagged"),
        "2 (sqrt(1 + xi^2) - xi)",
        lambda xi: 2 * (math.sqrt(1 + xi * xi) - xi),
    ),
    *(MethodLimit(method.label, method) for method in (RK2(), RK3(), RK4(), AB2(), AB3())),
)
#: Methods that grow with every step: the record, the leading term of the growth per step as a formula and a function.
GROWING: dict[str, tuple[Method, str, Callable[[float], float]]] = {
    "RK2": (RK2(), "Omega^4/8", lambda Omega: Omega**4 / 8),
    "AB2": (AB2(), "Omega^4/4", lambda Omega: Omega**4 / 4),
    **{
        label: (method, "(1 - alpha) Omega^4/4", partial(weak_growth, method))
        for label, method in UNSTABLE_SETS.items()
        if method.order == 2
    },
    "EIG-3(0, 0)": (EIG3(0.0, 0.0), "(1/2 - beta) Omega^2/2", lambda Omega: Omega**2 / 4),
}


def evaluations_per_step(method: Method, xi: float, Omega: float) -> float:
    """Evaluations of the right-hand side per step; measured in a run if an iteration decides."""
    if method.evaluations is not None:
        return method.evaluations
    stepper = problems.single_dof(omega=1.0, xi=xi).stepper(h=Omega, method=method)
    n_steps = stepper.advance(100)
    return (stepper.n_rhs - 1) / n_steps
