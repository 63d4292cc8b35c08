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
from ..compile.source import Constants, after_sum, define, loop


class Tableau:
    """The formulas of one method: the names that a method's file contains.

    Parameters
    ----------
    c : sequence of float
        The times of the stages, as fractions of the step.
    A : sequence of sequences of float
        The rows of the matrix below its diagonal, from the second stage on.
    b : sequence of float
        The weights of the stages.
    """

    def __init__(self, c: Sequence[float], A: Sequence[Sequence[float]], b: Sequence[float]) -> None:
        self.A = [[Fraction(x) for x in row] + [Fraction(0)] * (len(b) - len(row)) for row in [(), *A]]
        self.b = [Fraction(x) for x in b]
        self.c, self.stages = c, len(b)
        constants = Constants()
        text = self._step("step", constants) + self._step("step_of_one", constants, many=False) + constants.source()
        defined = define(text, "tableau", {"__name__": __name__})
        self.step, self.step_of_one = element(defined["step"]), element(defined["step_of_one"])
        self.constants = element(defined["constants"])
        self.rows, self.evaluations = 4 + self.stages, self.stages
        self.brief_step = self._brief()

    def _times_matrix(self, row: Sequence[Fraction]) -> list[Fraction]:
        """Return the product of a row and A, exactly."""
        return [sum((row[k] * self.A[k][j] for k in range(self.stages)), Fraction(0)) for j in range(self.stages)]

    def _state(self, c: float, row: Sequence[Fraction], constants: Constants) -> tuple[str, str]:
        """Return the text of u and v after the fraction c of the step, with the weights `row` of the accelerations."""

        def accelerations(weights: Sequence[Fraction], power: int) -> list[tuple[str, str]]:
            return [(constants(float(w), power), f"a{j}[j]") for j, w in enumerate(weights) if w]

        drift = constants(c, 1), "v[j]"
        return (
            after_sum("u[j]", [drift, *accelerations(self._times_matrix(row), 2)]),
            after_sum("v[j]", accelerations(row, 1)),
        )

    def _brief(self) -> Any:
        """Return the step that starts another method: it has loops over the stages, so that it compiles quickly."""
        A = np.array([*self.A, self.b], dtype=np.float64)
        A_bar = np.array([self._times_matrix(row) for row in [*self.A, self.b]], dtype=np.float64)
        return element(bound(brief_step, {"C": np.array([*self.c, 1.0]), "A": A, "A_BAR": A_bar}))

    def _time(self, i: int) -> str:
        return f"at.t + {float(self.c[i])!r} * at.h"

    def _step(self, name: str, constants: Constants, many: bool = True) -> str:
        accelerations = [f"a{i}" for i in range(self.stages)]
        lines = [f"def {name}(f, at, y, c, n):", f"u, v, u_stage, v_stage, {', '.join(accelerations)} = y"]
        lines.append("f(at.t, u, v, at.p, a0)")
        for i in range(1, self.stages):
            u, v = self._state(self.c[i], self.A[i], constants)
            lines += [*loop({"u_stage": u, "v_stage": v}, many), f"f({self._time(i)}, u_stage, v_stage, at.p, a{i})"]
        u, v = self._state(1.0, self.b, constants)
        return "\n    ".join([*lines, *loop({"u": u, "v": v}, many), "return y, True"]) + "\n\n"


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
