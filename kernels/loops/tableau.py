# ruff: noqa: F821
"""Explicit Runge-Kutta methods from their tableaux, with the stage velocities eliminated.

    a_i     = f(t + c_i h, u + c_i h v + h^2 sum_j abar_ij a_j, v + h sum_j a_ij a_j)
    u_{n+1} = u + h v + h^2 sum_i bbar_i a_i        v_{n+1} = v + h sum_i b_i a_i
    abar = A A        bbar = b A

The steps are written as source without the terms that are zero. In each sum, the stage that was evaluated last is the
last term: the sum of the others need not wait for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from ..compile.jit import bound, element
from ..compile.source import Constants, Writer, after_sum, define

Row = Sequence[Fraction]


#: A sum of products that is smaller than this part of them is zero: the tableaux have 15 digits or more.
_ROUND_OFF = Fraction(1, 10**14)


def product(row: Row, A: Sequence[Row]) -> list[Fraction]:
    """Return the product of a row and a square matrix, exactly but for the entries that are round-off of zero."""
    entries = []
    for j in range(len(A)):
        products = [x * a[j] for x, a in zip(row, A, strict=False)]
        entry = sum(products, Fraction(0))
        entries.append(entry if abs(entry) > _ROUND_OFF * sum(map(abs, products)) else Fraction(0))
    return entries


class Tableau:
    """The formulas of one method: the names that a method's file contains.

    c are the times of the stages, as fractions of the step. A has the rows of the matrix below its diagonal, from the
    second stage on, and b the weights of the stages.
    """

    #: The rows that a stage writes, and the row that it hands to the right-hand side as v.
    state: tuple[str, ...] = ("u_stage", "v_stage")
    velocity = "v_stage"

    def __init__(self, c: Sequence[float], A: Sequence[Sequence[float]], b: Sequence[float]) -> None:
        self.A = [[Fraction(x) for x in row] + [Fraction(0)] * (len(b) - len(row)) for row in [(), *A]]
        self.b = [Fraction(x) for x in b]
        self.c, self.stages = c, len(b)
        out, constants = Writer(), Constants()
        self._write_step(out, "step", constants)
        self._write_step(out, "step_of_one", constants, many=False)
        constants.write(out)
        defined = define(str(out), "tableau", {"__name__": __name__})
        self.step, self.step_of_one = element(defined["step"]), element(defined["step_of_one"])
        self.constants = element(defined["constants"])
        self.rows, self.evaluations = 2 + len(self.state) + self.stages, self.stages
        self.brief_step = self._brief()

    def stage(self, row: Row, A: Sequence[Row]) -> list[Row]:
        """Return the weights of the accelerations in the rows `state` of a stage, from its row of the matrix A."""
        return [product(row, A), row]

    def end(self, row: Row, A: Sequence[Row]) -> list[Row]:
        """Return the weights of the accelerations in u and v at the end of a step, from those in v."""
        return [product(row, A), row]

    def _state(self, c: float, weights: Sequence[Row], constants: Constants) -> list[str]:
        """Return the text of u, and of v, after the fraction c of the step."""
        sums = [
            [(constants(float(w), power), f"a{j}[j]") for j, w in enumerate(row) if w]
            for row, power in zip(weights, (2, 1), strict=False)
        ]
        sums[0].insert(0, (constants(c, 1), "v[j]"))
        return [after_sum(start, terms) for start, terms in zip(("u[j]", "v[j]"), sums, strict=False)]

    def _brief(self) -> Any:
        """Return the step that starts another method: it has loops over the stages, so that it compiles quickly."""
        A = np.array([*self.A, self.b], dtype=np.float64)
        A_bar = np.array([product(row, self.A) for row in [*self.A, self.b]], dtype=np.float64)
        return element(bound(brief_step, {"C": np.array([*self.c, 1.0]), "A": A, "A_BAR": A_bar}))

    def _write_step(self, out: Writer, name: str, constants: Constants, many: bool = True) -> None:
        accelerations = [f"a{i}" for i in range(self.stages)]
        with out.block(f"def {name}(f, at, y, c, n)"):
            out.line(f"{', '.join(['u', 'v', *self.state, *accelerations])} = y", "f(at.t, u, v, at.p, a0)")
            for i in range(1, self.stages):
                texts = self._state(self.c[i], self.stage(self.A[i], self.A), constants)
                out.loop(dict(zip(self.state, texts, strict=True)), many)
                out.line(f"f(at.t + {float(self.c[i])!r} * at.h, u_stage, {self.velocity}, at.p, a{i})")
            end = self._state(1.0, self.end(self.b, self.A), constants)
            out.loop(dict(zip(("u", "v"), end, strict=True)), many)
            out.line("return y, True")


def brief_step(f, at, u, v, scratch, n):  # type: ignore[no-untyped-def]
    u_stage, v_stage, a = scratch[0], scratch[1], scratch[2:]
    for i in range(len(C)):
        for j in range(n):
            u_sum, v_sum = 0.0, 0.0
            for k in range(i):
                u_sum += A_BAR[i, k] * a[k, j]
                v_sum += A[i, k] * a[k, j]
            u_stage[j] = u[j] + at.h * (C[i] * v[j] + at.h * u_sum)
            v_stage[j] = v[j] + at.h * v_sum
        if i < len(C) - 1:
            f(at.t + C[i] * at.h, u_stage, v_stage, at.p, a[i])
    for j in range(n):
        u[j], v[j] = u_stage[j], v_stage[j]
    return True
