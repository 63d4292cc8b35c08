"""Recompute the properties of the EIG methods of grade 3 to 13: order, stability limits, growth and energy drift."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from fractions import Fraction
from itertools import count
from math import factorial

from eig3.kernels.methods.eig import ordinates, sigma
from eig3.methods import EIG, EIG3
from eig3.stability import NEGLIGIBLE, limit, practical_limit

from . import text
from .article import TABLES
from .characteristic import gyroscope_growth, oscillator_growth

SUMMARY = "orders, limits and growth of the EIG methods of every grade"
GRADES = range(3, 14)
DAMPING = (0.0, 0.01, 0.05, 0.1, 0.3, 0.5, 1.0)
OSCILLATOR_AT = (0.05, 0.1, 0.2)  # omega h
GYROSCOPE_AT = (0.01, 0.05, 0.1)  # kappa h
DRIFT_TABLES = (2, 3, 4)
STEPS_OF_DRIFT = 4  # of each table, the longest first
NO_GROWTH = 1e-30  # a growth below this is the rounding of zero


def add_options(parser: argparse.ArgumentParser) -> None:
    """It has no options."""


def benchmark(*, write: Callable[[str], None] = print) -> None:
    """Print the tables, one after the other."""
    for page in (render_limits, render_growth, render_drift):
        write(page() + "\n")
        text.status("")


def order_and_constant(grade: int) -> tuple[int, Fraction]:
    """The order p, and C in the local error C h^(p+2) u^(p+2) of u. Both follow from the powers of t.

    For u = t^(k+2) / (k+2)! and h = 1, the error of the step from t = 0 is zero up to k = p - 1, and C for k = p.
    """
    weights = ordinates(sigma(grade - 1))

    def error(k: int) -> Fraction:
        exact = Fraction(1 + (-1) ** k, factorial(k + 2))  # u(1) - 2 u(0) + u(-1)
        return exact - sum((w * Fraction((-i) ** k, factorial(k)) for i, w in enumerate(weights)), Fraction(0))

    return next((k, error(k)) for k in count() if error(k))


def render_limits() -> str:
    header = ["grade", "order", "error constant", *(f"xi = {xi:g}" for xi in DAMPING)]
    rows = []
    for grade in GRADES:
        text.status(f"limits of grade {grade}")
        order, constant = order_and_constant(grade)
        undamped, *damped = (limit(EIG(grade), xi) for xi in DAMPING)
        first = f"{undamped:.4f}" if undamped else f"{practical_limit(EIG(grade)):.4f} *"
        rows.append([str(grade), str(order), str(constant), first, *(f"{x:.4f}" for x in damped)])
    return (
        "Largest stable omega h, against the physical damping ratio xi. With order p, the local error of u is the "
        f"error constant times h^(p+2) and the derivative of u of order p + 2.\n\n{text.table(header, rows)}\n\n"
        f"* This grade grows at every step; below the limit shown by at most {NEGLIGIBLE} a step."
    )


def render_growth() -> str:
    header = ["grade", *(f"oscillator, {x:g}" for x in OSCILLATOR_AT), *(f"gyroscope, {x:g}" for x in GYROSCOPE_AT)]
    rows = [[str(grade), *map(_growth, growths(grade))] for grade in GRADES]
    return (
        "Growth a step, |z| - 1, of the oscillator u'' = -omega^2 u at omega h, and of the gyroscope v' = i kappa v at "
        f"kappa h. A negative growth is numerical damping.\n\n{text.table(header, rows)}"
    )


def growths(grade: int) -> list[float]:
    oscillator = [oscillator_growth(grade, x) for x in OSCILLATOR_AT]
    return oscillator + [gyroscope_growth(grade, x) for x in GYROSCOPE_AT]


def _growth(value: float) -> str:
    return "0" if abs(value) < NO_GROWTH else f"{value:.1e}"


def render_drift() -> str:
    header = ["problem", "h (s)", "EIG3()", "EIG(3)", "EIG3() / EIG(3)"]
    rows = []
    for table in TABLES:
        if table.number in DRIFT_TABLES:
            for h in table.steps[:STEPS_OF_DRIFT]:
                own, synchronised = drifts(table.number, h)
                figures = (text.number(x) for x in (own, synchronised, own / synchronised))
                rows.append([f"Table {table.number}, {table.problem().name}", f"{h:g}", *figures])
    return (
        "Largest energy error (J) in the article's tables. EIG(3) has the positions of EIG3(), and reports a velocity "
        f"that is synchronised with them.\n\n{text.table(header, rows)}"
    )


def drifts(number: int, h: float) -> tuple[float, float]:
    """The energy drift of EIG3() and of EIG(3) in a table of the article, with a step of about h."""
    text.status(f"drift in table {number}, h = {h:g}")
    problem = next(table.problem() for table in TABLES if table.number == number)
    own, synchronised = (
        problem.integrate(h=h, method=method, save_every=None, invariants_every=1) for method in (EIG3(), EIG(3))
    )
    return own.drift["energy"], synchronised.drift["energy"]
