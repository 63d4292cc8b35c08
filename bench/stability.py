"""`eig3 bench stability`: every method's limits in closed form, by eigenvalues and by runs; the article's figures."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from eig3 import problems
from eig3.methods import AB2, AB3, EIG3, RK2, RK3, RK4, CentralDifference, Method
from eig3.stability import explain, limit, spectral_radius
from eig3.stepper import Stepper

from . import text

DAMPING = (0.01, 0.1, 0.5, 1.0)
GROWTH_AT = (0.1, 0.2, 0.4)  # omega h
RESOLUTION = 1e-4  # of a limit found by runs: nearer to it nothing grows enough in MOST_STEPS
MOST_STEPS = 6_000_000
_BISECTED = RESOLUTION / 10
_BRACKET = (0.05, 4.0)  # omega h: every limit looked for lies between
_CHUNK = 20_000
_GROWN = 1e6  # times the start: so near to a limit, what is bounded may come to 1e5 on the way
_DECAYED = 1e-100  # nothing is left, not even the round-off from which a growing mode would have risen
_OVERGROWN = 1e100  # so far that the phase at the end is 1e-3 of the rate at most


@dataclass(frozen=True)
class Case:
    """A method, and its limit of omega h as a formula and as a function of xi where there is one."""

    label: str
    method: Method
    formula: str = "-"
    closed_form: Callable[[float], float] | None = None


def alternating(method: EIG3, xi: float) -> float:
    """The omega h where an eigenvalue of EIG-3 is -1: (alpha - beta) Omega^2/2 + (1 + 2 beta) xi Omega = 1."""
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
UNDAMPED = (
    *(
        Case(label, method, "sqrt(2/(alpha - beta))", partial(alternating, method))
        for label, method in EIG3_SETS.items()
        if label != "EIG-3(1, 0.6)"
    ),
    Case("EIG-3(1, 0.6)", EIG3(1.0, 0.6), "1/sqrt(beta + 1/2)", lambda xi: 1 / math.sqrt(1.1)),
    Case("CD", CentralDifference(), "2", lambda xi: 2.0),
    Case("RK3", RK3(), "sqrt(3)", lambda xi: math.sqrt(3)),
    Case("RK4", RK4(), "2 sqrt(2)", lambda xi: 2 * math.sqrt(2)),
    Case("AB3", AB3(), "12/(5 sqrt(11))", lambda xi: 12 / (5 * math.sqrt(11))),
)
DAMPED = (
    Case("EIG-3(1, 1/2)", EIG3(), "2 (sqrt(1 + 4 xi^2) - 2 xi)", partial(alternating, EIG3())),
    Case("EIG-3(1.2, 1/2)", EIG3(1.2), "(sqrt(1.4 + 4 xi^2) - 2 xi)/0.7", partial(alternating, EIG3(1.2))),
    Case("CD implicit", CentralDifference(), "2", lambda xi: 2.0),
    Case(
        "CD lagged",
        CentralDifference(velocity="lagged"),
        "2 (sqrt(1 + xi^2) - xi)",
        lambda xi: 2 * (math.sqrt(1 + xi * xi) - xi),
    ),
    *(Case(method.label, method) for method in (RK2(), RK3(), RK4(), AB2(), AB3())),
)
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


def run(*, out: Path | None = None, write: Callable[[str], None] = print) -> None:
    """Print the tables and what theory says of each method; with `out`, keep them there and draw the figures."""
    pages = [f"# Stability\n\n{_HEADING}"]
    write(_HEADING)
    for page in (render_undamped, render_damped, render_growth, render_words):
        pages.append(page())
        text.status("")
        write("\n" + pages[-1])
    if out is not None:
        pictures, said = draw(out)
        (out / "stability.md").write_text("\n\n".join([*pages, *pictures]) + "\n")
        write(f"\nWritten to {out}: stability.md{said}")


_HEADING = (
    "Limits of Omega = omega h on the oscillator u'' + 2 xi omega u' + omega^2 u = 0: in closed form where there is "
    "one; by the eigenvalues of the kernel's own amplification matrix; and by runs of that kernel, h bisected between "
    f"what stays bounded and what grows {_GROWN:,.0f} times in at most {MOST_STEPS:,} steps, which tells a limit to "
    f"{RESOLUTION:g}."
)


def render_undamped() -> str:
    rows = [[case.label, *_limits(case, 0.0)] for case in UNDAMPED]
    return f"## Undamped\n\n{text.table(['method', *_COLUMNS], rows)}"


def render_damped() -> str:
    rows = [[case.label, f"{xi:g}", *_limits(case, xi)] for case in DAMPED for xi in DAMPING]
    return f"## With physical damping\n\n{text.table(['method', 'xi', *_COLUMNS], rows)}"


_COLUMNS = ["closed form", "value", "eigenvalue", "run"]


def _limits(case: Case, xi: float) -> list[str]:
    text.status(f"{case.label}, xi = {xi:g}")
    method = case.method if xi else case.method.without_velocity()
    value = "-" if case.closed_form is None else f"{case.closed_form(xi):.6f}"
    return [case.formula, value, f"{limit(method, xi):.6f}", f"{limit_of_runs(method, xi):.4f}"]


def limit_of_runs(method: Method, xi: float) -> float:
    """The limit of omega h to `RESOLUTION`, by bisection of the steps of real runs."""
    problem = problems.single_dof(omega=1.0, xi=xi)
    low, high = _BRACKET
    while high - low > _BISECTED:
        middle = (low + high) / 2
        low, high = (low, middle) if grows(problem.stepper(h=middle, method=method)) else (middle, high)
    return (low + high) / 2


def grows(stepper: Stepper) -> bool:
    """Whether the run passes `_GROWN` times its start, or fails, within `MOST_STEPS`."""
    start = _size(stepper)
    for _ in range(MOST_STEPS // _CHUNK):
        taken = stepper.advance(_CHUNK)
        if _size(stepper) < _DECAYED:  # before what follows: a solve may fail among subnormal numbers
            return False
        if taken < _CHUNK or not _size(stepper) < _GROWN * start:  # NaN has grown too
            return True
    return False


def _size(stepper: Stepper) -> float:
    return math.hypot(stepper.u, stepper.v)


def render_growth() -> str:
    rows = [
        [
            label,
            formula,
            f"{Omega:g}",
            *(text.number(growth, 4) for growth in (leading(Omega), *_growths(method, Omega))),
        ]
        for label, (method, formula, leading) in GROWING.items()
        for Omega in GROWTH_AT
    ]
    header = ["method", "leading term", "Omega", "its value", "eigenvalue", "run"]
    return f"## No stable step: undamped growth per step, |z| - 1\n\n{text.table(header, rows)}"


def _growths(method: Method, Omega: float) -> tuple[float, float]:
    free = method.without_velocity()
    return spectral_radius(free, Omega) - 1, growth_of_run(free, Omega)


def growth_of_run(method: Method, Omega: float) -> float:
    """The mean growth per step of a run up to `_OVERGROWN`."""
    stepper = problems.single_dof(omega=1.0).stepper(h=Omega, method=method)
    start = _size(stepper)
    while _size(stepper) < _OVERGROWN:
        stepper.advance(1000)
    return math.expm1(math.log(_size(stepper) / start) / stepper.index)


def render_words() -> str:
    words = "\n\n".join(explain(case.method) for case in DAMPED)
    return f"## In words\n\n```text\n{words}\n```"


def evaluations_per_step(method: Method, xi: float, Omega: float) -> float:
    """As the record says; measured over a run where an iteration decides."""
    if method.evaluations is not None:
        return method.evaluations
    stepper = problems.single_dof(omega=1.0, xi=xi).stepper(h=Omega, method=method)
    n_steps = stepper.advance(100)
    return (stepper.n_rhs - 1) / n_steps


def draw(out: Path) -> tuple[Sequence[str], str]:
    """The figures, each as PNG and SVG; returns what shows them in Markdown, and what to say of them."""
    try:
        from .stability_pictures import PICTURES, save
    except ImportError:
        return [], text.NO_PICTURES
    shown = ["## Figures"]
    for name, (figure, caption) in PICTURES.items():
        text.status(f"picture {name}")
        save(figure(), out / name)
        shown.append(f"![{name}]({name}.svg)\n\n{caption}")
    text.status("")
    return shown, f" and {len(PICTURES)} pictures, each as PNG and SVG"
