"""The methods of `eig3 bench stability`: parameter sets of EIG-3, limits in closed form, rates of growth."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from eig3.kernels.methods.eig import sigma
from eig3.methods import AB2, AB3, BM6, EIG, EIG3, RK2, RK3, RK4, RK5, RK8, CentralDifference, Method
from eig3.stability import alternating_limit, growth_in_words


@dataclass(frozen=True)
class MethodLimit:
    """A method and its limit of omega h, if known as a formula and as a function of xi.

    Runs do not find a limit beyond which the motion grows too slowly.
    """

    label: str
    method: Method
    formula: str = "-"
    closed_form: Callable[[float], float] | None = None
    by_runs: bool = True


def alternating(method: EIG3, xi: float) -> float:
    """The omega h at which an eigenvalue of EIG-3 is -1: (alpha - beta) Omega^2/2 + (1 + 2 beta) xi Omega = 1."""
    half, damping = method.alpha - method.beta, (1 + 2 * method.beta) * xi
    return (math.sqrt(damping * damping + 2 * half) - damping) / half


def weak_growth(method: EIG3, Omega: float) -> float:
    """The growth per step of EIG-3 with beta = 1/2, up to O(Omega^6)."""
    return (1 - method.alpha) * Omega**4 / 4


WEAK_GRADES = (6, 7, 10, 11)


def family_growth(grade: int, Omega: float) -> float:
    """The leading term of the growth per step of EIG(grade): the first that Stoermer's series leaves out."""
    p = grade - 1
    s, following = sigma(p + 2)[p:]
    sign = (-1) ** ((p + 1) // 2 + 1)
    return sign * (float(s / 2) * Omega ** (p + 1) if p % 2 else float((p * s / 2 - following) / 2) * Omega ** (p + 2))


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
    *(
        MethodLimit(f"EIG-{grade}", EIG(grade), "2/sqrt(S)", partial(alternating_limit, grade))
        for grade in (4, 5, 9, 12, 13)
    ),
    *(MethodLimit(method.label, method, by_runs=False) for method in (EIG(8), RK5(), BM6())),
    MethodLimit("RK8", RK8()),
)
ARTICLE_DAMPED = (
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
FAMILY_DAMPED = (
    *(
        MethodLimit(f"EIG-{grade}", EIG(grade), "root at -1, S and K", partial(alternating_limit, grade))
        for grade in range(4, 14)
    ),
    *(MethodLimit(method.label, method) for method in (RK5(), RK8())),
)
DAMPED = (*ARTICLE_DAMPED, *FAMILY_DAMPED)
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


def weakly_growing() -> dict[str, tuple[Method, str, Callable[[float], float]]]:
    """Methods that grow with every step, but so slowly that this is negligible in most runs; as in `GROWING`."""
    return {
        f"EIG-{grade}": (EIG(grade), growth_in_words(EIG(grade, velocity="none")), partial(family_growth, grade))
        for grade in WEAK_GRADES
    }
