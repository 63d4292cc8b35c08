"""Find stability limits in closed form, by eigenvalues and by runs; draw the article's figures 1-7 and 9."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from eig3 import problems
from eig3.command_line import NO_PICTURES, Files, add_out
from eig3.methods import BM6, RKN12, Method
from eig3.stability import NEGLIGIBLE, explain, limit, practical_limit, spectral_radius
from eig3.stepping.stepper import Stepper

from . import pictures, stability_pictures, text
from .stability_sets import DAMPED, GROWING, UNDAMPED, MethodLimit, weakly_growing

SUMMARY = "stability limits, and the article's figures"
DAMPING = (0.01, 0.1, 0.5, 1.0)
GROWTH_AT = (0.1, 0.2, 0.4)  # omega h
WEAK_GROWTH_AT = (0.1, 0.15, 0.2)  # omega h: a root of grade 11 is -1 at 0.242
RESOLUTION = 5e-4  # relative accuracy of a limit found by runs; closer to it, growth is too slow to see in MOST_STEPS
MOST_STEPS = 2_000_000
_BISECTED = RESOLUTION / 10
_BRACKET = (5e-4, 8.0)  # omega h: every limit lies between these
_CHUNK = 20_000
_GROWN = 1e6  # a run has grown above this multiple of its start; close to the limit, a bounded run reaches 1e5
_DECAYED = 1e-100  # a state so small that no round-off is left from which an unstable mode could grow
_MOST_GROWING_STEPS = 20_000_000
_OVERGROWN = 1e100  # a growth so large that the phase at the end changes the rate by 1e-3 at most


def add_options(parser: argparse.ArgumentParser) -> None:
    add_out(parser, "write stability.md and pictures there")


def benchmark(*, out: Path | None = None, write: Callable[[str], None] = print) -> None:
    """Print the tables and an explanation of each method; with `out`, save them and the figures there."""
    pages = [f"# Stability\n\n{_HEADING}"]
    write(_HEADING)
    for page in (render_undamped, render_damped, render_growth, render_weak_growth, render_words):
        pages.append(page())
        text.status("")
        write("\n" + pages[-1])
    if out is not None:
        files = Files(out, "eig3 bench")
        pictures, note = draw(files)
        with files.writing("stability.md") as path:
            path.write_text("\n\n".join([*pages, *pictures]) + "\n")
        files.finish(write, note)


_HEADING = (
    "Limits of Omega = omega h on the oscillator u'' + 2 xi omega u' + omega^2 u = 0, found in three ways: in closed "
    "form if there is one; by the eigenvalues of the kernel's amplification matrix; and by runs of that kernel. The "
    f"runs bisect h between steps that stay bounded and steps that grow {_GROWN:,.0f} times in at most "
    f"{MOST_STEPS:,} steps, which finds a limit to {RESOLUTION:g} of it. A root of EIG of grade g is -1 where "
    "S Omega^2 + 4 xi (S + 2 K) Omega = 4, with S the sum of sigma_j 2^j over j < g - 1, and K the sum of kappa_j 2^j "
    "over j < g - 2. Beyond the limits of EIG-8 and RK5, and in BM6's short intervals of unstable steps, the motion "
    "grows too slowly for these runs."
)


def render_undamped() -> str:
    rows = [[case.label, *_limits(case, 0.0)] for case in UNDAMPED]
    return f"## Undamped\n\n{text.table(['method', *_COLUMNS], rows)}"


def render_damped() -> str:
    rows = [[case.label, f"{xi:g}", *_limits(case, xi)] for case in DAMPED for xi in DAMPING]
    return f"## With physical damping\n\n{text.table(['method', 'xi', *_COLUMNS], rows)}"


_COLUMNS = ["closed form", "value", "eigenvalue", "run"]


def _limits(case: MethodLimit, xi: float) -> list[str]:
    text.status(f"{case.label}, xi = {xi:g}")
    method = case.method if xi else case.method.without_velocity()
    value = "-" if case.closed_form is None else f"{case.closed_form(xi):.6f}"
    by_runs = text.number(limit_of_runs(method, xi), 4) if case.by_runs else "-"
    return [case.formula, value, f"{limit(method, xi):.6f}", by_runs]


def limit_of_runs(method: Method, xi: float) -> float:
    """The limit of omega h to `RESOLUTION`, relatively, by bisection with real runs."""
    problem = problems.single_dof(omega=1.0, xi=xi)
    low, high = _BRACKET
    while high > low * (1 + _BISECTED):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if grows(problem.stepper(h=middle, method=method)) else (middle, high)
    return (low + high) / 2


def grows(stepper: Stepper) -> bool:
    """Whether the run passes `_GROWN` times its start, or fails, within `MOST_STEPS`."""
    start = _size(stepper)
    for _ in range(MOST_STEPS // _CHUNK):
        taken = stepper.advance(_CHUNK)
        if _size(stepper) < _DECAYED:  # tested first, since a solve can fail among subnormal numbers
            return False
        if taken < _CHUNK or not _size(stepper) < _GROWN * start:  # "not <", so that NaN counts as grown
            return True
    return False


def _size(stepper: Stepper) -> float:
    return math.hypot(stepper.u, stepper.v)


def render_growth() -> str:
    return f"## No stable step: undamped growth per step, |z| - 1\n\n{_growth_table(GROWING, GROWTH_AT)}"


def render_weak_growth() -> str:
    growing = weakly_growing()
    practical = ", ".join(f"{practical_limit(method):.3f} ({label})" for label, (method, *_) in growing.items())
    return (
        "## Weak growth: undamped growth per step of EIG of the grades 6, 7, 10 and 11\n\n"
        f"{_growth_table(growing, WEAK_GROWTH_AT)}\n\n"
        f"The growth is below {NEGLIGIBLE} a step up to Omega = {practical}."
    )


def _growth_table(growing: Mapping[str, tuple], at: Sequence[float]) -> str:
    rows = [
        [
            label,
            formula,
            f"{Omega:g}",
            *(text.number(growth, 4) for growth in (leading(Omega), *_growths(method, Omega))),
        ]
        for label, (method, formula, leading) in growing.items()
        for Omega in at
    ]
    return text.table(["method", "leading term", "Omega", "its value", "eigenvalue", "run"], rows)


def _growths(method: Method, Omega: float) -> tuple[float, float]:
    free = method.without_velocity()
    return spectral_radius(free, Omega) - 1, growth_of_run(free, Omega)


def growth_of_run(method: Method, Omega: float) -> float:
    """The mean growth per step of a run up to `_OVERGROWN`, or of `_MOST_GROWING_STEPS`."""
    stepper = problems.single_dof(omega=1.0).stepper(h=Omega, method=method)
    start = _size(stepper)
    while _size(stepper) < _OVERGROWN and stepper.index < _MOST_GROWING_STEPS:
        stepper.advance(1000 + stepper.index // 10)
    return math.expm1(math.log(_size(stepper) / start) / stepper.index)


def render_words() -> str:
    methods = [*(case.method for case in DAMPED), BM6(), RKN12()]
    words = "\n\n".join(map(explain, methods))
    return f"## In words\n\n```text\n{words}\n```"


def draw(files: Files) -> tuple[Sequence[str], str]:
    """Save the figures, each as PNG and SVG; return them as Markdown, and what to add to the list of written files."""
    if not pictures.is_possible():
        return [], NO_PICTURES
    shown = ["## Figures"]
    for name, (figure, caption) in stability_pictures.PICTURES.items():
        text.status(f"picture {name}")
        drawn = figure()
        with files.writing(name) as path:
            stability_pictures.save(drawn, path)
        shown.append(f"![{name}]({name}.svg)\n\n{caption}")
    text.status("")
    return shown, "; each figure as PNG and SVG"
