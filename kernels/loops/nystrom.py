"""Runge-Kutta-Nystroem methods, for forces f(t, u) that do not depend on the velocity.

    a_i     = f(t + c_i h, u + c_i h v + h^2 sum_j A_ij a_j)
    u_{n+1} = u + h v + h^2 sum_i b_i (1 - c_i) a_i        v_{n+1} = v + h sum_i b_i a_i

A stage has no velocity: the right-hand side gets the velocity at the start of the step.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

from .pair import Pair, Text, weighted_sum
from .tableau import Row, Tableau


class Nystrom(Tableau):
    """The formulas of one method, as in `eig3.kernels.loops.tableau`; A is the matrix of u, and not of v."""

    state = ("u_stage",)
    velocity = "v"

    def stage(self, row: Row, A: Sequence[Row]) -> list[Row]:
        return [row]

    def end(self, row: Row, A: Sequence[Row]) -> list[Row]:
        return [[w * (1 - Fraction(c)) for w, c in zip(row, self.c, strict=False)], row]

    def _brief(self) -> None:
        return None  # it starts no other method


class NystromPair(Pair):
    """The formulas of a pair. Its continuous extension also has the acceleration at both ends; v is its derivative."""

    known_terms = 6

    def _polynomials(self, out: Text) -> None:
        self._rise(out, "u", "v")
        out.line("u3 = h * h / 2 * a0[j] + u1 - u2", "u4 = h * h / 2 * a_end[j] + u1 + 2 * u2 - u3")
        for k, weights in enumerate(self.weights, start=5):
            out.line(f"u{k} = h * h * {weighted_sum(self.weighted(weights))}")
        self._powers(out, "u", 0)
        out.line("per_h = 1 / h")
        for k in range(1, self.terms):
            out.line(f"coefficients[{self.terms + k - 1}, j] = {k} * coefficients[{k}, j] * per_h")
        out.line(f"coefficients[{2 * self.terms - 1}, j] = 0.0")
