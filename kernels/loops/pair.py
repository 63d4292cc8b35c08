"""The steps of variable length of a Runge-Kutta pair: a trial step, the estimate of its error, and dense output.

The formulas are those of `eig3.kernels.loops.tableau`, with the step as a factor of the sums: coefficients that contain
powers of h would have to be computed anew for each step. With the weights e_i of the estimate, where the last stage is
the acceleration at the end of the step, the errors are

    error of v = h sum_i e_i a_i        error of u = h^2 sum_i (e A)_i a_i

The error of a step is the largest of these in relation to their tolerances. A mean over many degrees of freedom would
allow a single one an error far beyond.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from fractions import Fraction
from math import comb
from typing import Any

from ..compile.jit import element, outlined
from ..compile.source import after_sum, define
from .dense import TERMS, quintic
from .tableau import Tableau

#: The rows of a step of variable length: the state at its start and at its end, and the sizes of u and v of each degree
#: of freedom so far. Other rows follow.
U, V, A, U_END, V_END, A_END, U_MOST, V_MOST = range(8)
_STAGE = ("u_stage", "v_stage")


class Pair:
    """The formulas of a pair, as `eig3.kernels.loops.variable` uses them.

    Parameters
    ----------
    tableau : Tableau
    order : int
        The order of the estimate of the error, plus 1.
    errors : sequence of sequences of float
        The weights of the estimate. If there are two of them, of orders 5 and 3, they are combined as in DOP853.
    extension : tuple of sequences, optional
        The continuous extension: times and rows of further stages, and weights of all stages in the last four terms of
        its polynomial. Without an extension, it is the polynomial of degree 5 through u, v and a at both ends.
    """

    def __init__(
        self, tableau: Tableau, order: int, errors: Sequence[Sequence[float]], extension: tuple | None = None
    ) -> None:
        self.order = order
        self._stages = tableau.stages
        extra_c, extra_A, self._weights = extension or ((), (), ())
        self._c = [*map(float, tableau.c), 1.0, *extra_c]
        width = self._stages + 1 + len(extra_c)
        matrix = [*tableau.A, tableau.b, *([Fraction(x) for x in row] for row in extra_A)]
        self._A = [[*row, *[Fraction(0)] * (width - len(row))] for row in matrix]
        self._accelerations = ["a0", *(f"a{i}" for i in range(1, self._stages)), "a_end"]
        self._accelerations += [f"a{i}" for i in range(self._stages + 1, width)]
        others = [name for name in self._accelerations if name not in ("a0", "a_end")]
        self._rows = ["u", "v", "a0", "u_end", "v_end", "a_end", "u_most", "v_most", *_STAGE, *others]
        self.rows = len(self._rows)
        self.evaluations, self.dense_evaluations = self._stages, len(extra_c)
        self._text = "\n".join([self._trial(), self._error(errors), self._dense()])

    @functools.cache  # noqa: B019  a pair lives as long as its module
    def functions(self) -> dict[str, Any]:
        """Return the elements `trial`, `square` and `dense`."""
        names = {"__name__": __name__, "quintic": quintic}
        defined = define(self._text, "pair", names)
        inlined = {name: element(defined[name]) for name in ("trial", "square")}
        return {**inlined, "dense": outlined(defined["dense"])}

    def _unpacked(self) -> str:
        return f"    {', '.join(self._rows)} = y"

    def _weighted(self, weights: Sequence[Fraction]) -> list[tuple[str, str]]:
        return [(repr(float(w)), f"{a}[j]") for w, a in zip(weights, self._accelerations, strict=False) if w]

    def _times_matrix(self, row: Sequence[Fraction]) -> list[Fraction]:
        return [sum((x * a[j] for x, a in zip(row, self._A, strict=False)), Fraction(0)) for j in range(len(self._A))]

    def _state(self, i: int) -> tuple[str, str]:
        """Return the text of u and v at the stage i."""
        row = self._A[i]
        squares = self._weighted(self._times_matrix(row))
        position = f" + h * {_total(squares)}" if squares else ""
        *others, (factor, last) = self._weighted(row)
        before = f"(v[j] + h * {_total(others)})" if others else "v[j]"
        return (
            f"u[j] + h * ({self._c[i]!r} * v[j]{position})",
            f"{before} + (h * {factor}) * {last}",  # one multiply-add for v has to wait for the last acceleration
        )

    def _stage(self, i: int) -> list[str]:
        u, v = self._state(i)
        return [
            "    for j in range(n):",
            f"        u_stage[j], v_stage[j] = {u}, {v}",
            f"    f(t + {self._c[i]!r} * h, u_stage, v_stage, p, {self._accelerations[i]})",
        ]

    def _trial(self) -> str:
        lines = ["def trial(f, t, h, h_before, p, n, y):", self._unpacked()]
        for i in range(1, self._stages):
            lines += self._stage(i)
        u, v = self._state(self._stages)
        lines += ["    for j in range(n):", f"        u_end[j], v_end[j] = {u}, {v}"]
        return "\n".join([*lines, "    f(t + h, u_end, v_end, p, a_end)", ""])

    def _error(self, errors: Sequence[Sequence[float]]) -> str:
        lines = ["def square(h, h_before, n, y, rtol, atol, u_least, v_least):", self._unpacked()]
        lines += ["    total = 0.0", *(f"    most{k} = 0.0" for k in range(len(errors)))]
        lines += [
            "    for j in range(n):",
            "        u_scale = 1 / (atol[0, j] + rtol * max(abs(u[j]), abs(u_end[j]), u_most[j], u_least) + 1e-300)",
            "        v_scale = 1 / (atol[1, j] + rtol * max(abs(v[j]), abs(v_end[j]), v_most[j], v_least) + 1e-300)",
        ]
        for k, weights in enumerate(errors):
            exact = [Fraction(x) for x in weights]
            lines += [
                f"        u_part = h * {_total(self._weighted(self._times_matrix(exact)))} * u_scale",
                f"        v_part = {_total(self._weighted(exact))} * v_scale",
                f"        most{k} = max(most{k}, u_part * u_part, v_part * v_part)",
                "        total += u_part + v_part",
            ]
        if len(errors) == 1:
            value = "most0"
        else:
            lines.append("    both = most0 + 0.01 * most1")
            value = "(most0 * most0 / both if both > 0 else 0.0)"
        # A maximum may leave out NaN; the total does not.
        return "\n".join([*lines, f"    return h * h * {value} if total - total == 0 else total - total", ""])

    def _dense(self) -> str:
        lines = ["def dense(f, t, h, p, n, y, coefficients):", self._unpacked()]
        if not self._weights:
            return "\n".join([*lines, "    quintic(h, n, u, v, a0, u_end, v_end, a_end, coefficients)", ""])
        for i in range(self._stages + 1, len(self._A)):
            lines += self._stage(i)
        lines += [
            "    for j in range(n):",
            "        rise = u_end[j] - u[j]",
            "        u0, u1, u2 = rise, h * v[j] - rise, 2 * rise - h * (v[j] + v_end[j])",
            "        rise = v_end[j] - v[j]",
            "        v0, v1, v2 = rise, h * a0[j] - rise, 2 * rise - h * (a0[j] + a_end[j])",
        ]
        for k, weights in enumerate(self._weights, start=3):
            exact = [Fraction(x) for x in weights]
            squares = _total(self._weighted(self._times_matrix(exact)))
            lines += [
                f"        u{k} = h * ({float(sum(exact))!r} * v[j] + h * {squares})",
                f"        v{k} = h * {_total(self._weighted(exact))}",
            ]
        for letter, place in (("u", 0), ("v", TERMS)):
            lines.append(f"        coefficients[{place}, j] = {letter}[j]")
            for power in range(1, TERMS):
                terms = [(repr(float(x)), f"{letter}{i}") for i in range(TERMS - 1) if (x := _alternating(i, power))]
                lines.append(f"        coefficients[{place + power}, j] = {_total(terms)}")
        return "\n".join([*lines, ""])


def _total(terms: Sequence[tuple[str, str]]) -> str:
    """Return the text of the sum of products, of which the last is added last."""
    (factor, value), rest = terms[0], terms[1:]
    return f"({after_sum(f'{factor} * {value}', rest)})" if rest else f"({factor} * {value})"


def _alternating(i: int, power: int) -> int:
    """Return the coefficient of s^power in the product of i + 1 factors s, 1 - s, s, 1 - s, ..."""
    below, above = i // 2 + 1, (i + 1) // 2
    k = power - below
    return (-1) ** k * comb(above, k) if 0 <= k <= above else 0
