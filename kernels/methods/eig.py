"""EIG of grade g: order p = g - 1 with one evaluation a step, in the summed form.

With the mean velocity V_{n-1/2} = (u_n - u_{n-1}) / h of a step, and backward differences D a_n = a_n - a_{n-1}:

    V_{n+1/2} = V_{n-1/2} + h sum_{j<p} sigma_j D^j a_n
    u_{n+1}   = u_n + h V_{n+1/2}
    w_{n+1}   = V_{n+1/2} + h sum_{j<p-1} kappa_j D^j a_n
    a_{n+1}   = f(t_{n+1}, u_{n+1}, w_{n+1})
    v_{n+1}   = V_{n+1/2} + h sum_{j<p} omega_j D^j a_{n+1}

w predicts the velocity for f; it is left out if f does not read it. v is the velocity that is reported. sigma are
Stoermer's coefficients. kappa and omega integrate the interpolation polynomial of the accelerations, which is weighted
with the time since the start of the step: V is the mean of the velocity over the step, and differs from the velocity at
its end by this integral. RK8 takes the first p - 1 steps.

The members are Stoermer's formulas (E. Hairer, S. P. Norsett and G. Wanner, Solving Ordinary Differential Equations I,
section III.10), with a velocity. In grade 3, u is as in EIG-3(1, 1/2).
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from fractions import Fraction
from math import comb
from types import SimpleNamespace

from ..compile.jit import element
from ..compile.source import Constants, Writer, after_sum, define


def sigma(count: int) -> list[Fraction]:
    """Return Stoermer's coefficients, the coefficients of the power series (x / log(1 - x))^2 / (1 - x)."""
    logarithm = [Fraction(1, k + 1) for k in range(count)]  # of -log(1 - x) / x
    inverse: list[Fraction] = []
    for k in range(count):
        inverse.append(Fraction(k == 0) - sum((logarithm[i] * inverse[k - i] for i in range(1, k + 1)), Fraction(0)))
    square = [sum(inverse[i] * inverse[k - i] for i in range(k + 1)) for k in range(count)]
    return [Fraction(sum(square[: k + 1])) for k in range(count)]


def kappa(count: int) -> list[Fraction]:
    """Return the coefficients of w from the accelerations up to the start of the step."""
    return [_weighted_integral(j, 0) for j in range(count)]


def omega(count: int) -> list[Fraction]:
    """Return the coefficients of v from the accelerations up to the end of the step."""
    return [_weighted_integral(j, -1) for j in range(count)]


def _weighted_integral(j: int, shift: int) -> Fraction:
    """Return the integral of s binom(s + shift + j - 1, j) over s from 0 to 1."""
    polynomial = [Fraction(0), Fraction(1)]
    for i in range(j):
        shifted = [Fraction(0), *polynomial]
        polynomial = [
            (low + (shift + i) * high) / (i + 1) for low, high in zip(shifted, [*polynomial, Fraction(0)], strict=True)
        ]
    return sum((x / (k + 1) for k, x in enumerate(polynomial)), Fraction(0))


def ordinates(differences: Sequence[Fraction]) -> list[Fraction]:
    """Convert coefficients of differences D^j a_n to coefficients of a_{n-i}."""
    count = len(differences)
    return [(-1) ** i * sum(comb(j, i) * differences[j] for j in range(i, count)) for i in range(count)]


@functools.cache
def member(grade: int, predicts: bool) -> SimpleNamespace:
    """Return the names of a method's file for one grade; `predicts` says whether f reads the velocity."""
    p = grade - 1
    c = Constants()
    past = [f"a{i}" for i in range(p)]  # a_n, a_{n-1}, ...

    def weighted(weights: Sequence[Fraction], power: int) -> list[tuple[str, str]]:
        """Return the products of accelerations, the newest last."""
        return [(c(float(w), power), f"{a}[j]") for w, a in reversed([*zip(weights, past, strict=True)]) if w]

    def synchronised(V: str, sign: str = "+") -> str:
        return after_sum(V, weighted(ordinates(omega(p)), 1), sign)

    rows = ", ".join(past)
    first = ordinates(sigma(p))
    second = [x + y for x, y in zip(first, [*ordinates(kappa(p - 1)), Fraction(0)], strict=True)]
    u, V = after_sum("u[j]", [(c(1.0, 1), "V[j]"), *weighted(first, 2)]), after_sum("V[j]", weighted(first, 1))
    w = {"v": after_sum("V[j]", weighted(second, 1))} if predicts else {}

    out = Writer()
    for name, many in (("step", True), ("step_of_one", False)):
        with out.block(f"def {name}(f, at, y, c, n)"):
            out.line(f"u, v, V, {rows} = y")
            out.loop({"u": u, "V": V, **w}, many)
            out.line(f"f(at.t + at.h, u, v, at.p, {past[-1]})")
            out.line(f"return (u, v, V, {past[-1]}, {', '.join(past[:-1])}), True")
    with out.block("def complete(y, c, h, n)"):
        out.line(f"u, v, V, {rows} = y[:{3 + p}]")
        out.loop({"v": synchronised("V[j]")})
    with out.block("def start_step(f, at, y, c, n)"):
        out.line("c, scratch = c", f"u, v, V, {rows} = y")
        out.line("success = STARTER(f, at, u, v, scratch, n)", f"f(at.t + at.h, u, v, at.p, {past[-1]})")
        out.line(f"{rows} = {past[-1]}, {', '.join(past[:-1])}")
        out.loop({"V": synchronised("v[j]", "-")})
        out.line(f"return (u, v, V, {rows}), success")
    with out.block("def start(u, v, a, h)"):
        out.line(f"return 0 * u, a{', 0 * u' * (p - 1)}")
    c.write(out)
    defined = define(str(out), f"EIG-{grade}", {"__name__": __name__})

    return SimpleNamespace(
        ROWS=3 + p,
        PAST=1 + p,
        EVALUATIONS=1,
        TURN=p,
        START="rk8",
        START_STEPS=p - 1,
        start=defined["start"],
        start_step=defined["start_step"],
        **{name: element(defined[name]) for name in ("constants", "complete", "step", "step_of_one")},
    )
