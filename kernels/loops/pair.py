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
from typing import Any, SupportsFloat

from ..compile.jit import bound, element, outlined
from ..compile.source import after_sum, define
from .dense import QUINTIC_TERMS, quintic
from .tableau import Row, Tableau, product

#: The rows of a step of variable length: the state at its start and at its end, and the sizes of u and v of each degree
#: of freedom so far. Other rows follow.
U, V, A, U_END, V_END, A_END, U_MOST, V_MOST = range(8)


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
        The continuous extension: times and rows of further stages, and weights of all stages in the last terms of its
        polynomial. Without an extension, it is the polynomial of degree 5 through u, v and a at both ends.

    Attributes
    ----------
    rows : int
        Number of rows of a step.
    terms : int
        Number of coefficients of the dense output of u, and of that of v.
    work_rows : int
        Number of rows of `Watch.work` that a search needs: u and v within a step, and the dense output.
    tableau : Tableau
    c, A : list
        The times of the stages, of the end of the step and of further stages, and the rows of their matrix.
    n_stages : int
    accelerations, row_names : list of str
        The names of the rows with the accelerations of the stages, and of all rows.
    errors : sequence of sequences of float
    evaluations, dense_evaluations : int
        Evaluations of the right-hand side in a step, and in its dense output.
    """

    known_terms = 4  # the terms of the extension that follow from the states at both ends

    def __init__(
        self, tableau: Tableau, order: int, errors: Sequence[Sequence[float]], extension: tuple | None = None
    ) -> None:
        self.order, self.errors = order, errors
        self.tableau, self.n_stages = tableau, tableau.stages
        extra_c, extra_A, self.weights = extension or ((), (), ())
        self.terms = self.known_terms + len(self.weights) if extension else QUINTIC_TERMS
        self.work_rows = 2 + 2 * self.terms
        self.c = [*map(float, tableau.c), 1.0, *extra_c]
        width = self.n_stages + 1 + len(extra_c)
        matrix = [*tableau.A, tableau.b, *([Fraction(x) for x in row] for row in extra_A)]
        self.A = [[*row, *[Fraction(0)] * (width - len(row))] for row in matrix]
        self.accelerations = ["a0", *(f"a{i}" for i in range(1, self.n_stages)), "a_end"]
        self.accelerations += [f"a{i}" for i in range(self.n_stages + 1, width)]
        others = [name for name in self.accelerations if name not in ("a0", "a_end")]
        self.row_names = ["u", "v", "a0", "u_end", "v_end", "a_end", "u_most", "v_most", *tableau.state, *others]
        self.rows = len(self.row_names)
        self.evaluations, self.dense_evaluations = self.n_stages, len(extra_c)
        self._text = "\n".join([self._trial(), self._error(errors), self._dense()])

    @functools.cache  # noqa: B019  a pair lives as long as its module
    def functions(self) -> dict[str, Any]:
        """Return the elements `trial`, `square` and `dense`, and `dense_called`, which is not inlined."""
        names = {"__name__": __name__, "quintic": quintic}
        defined = define(self._text, "pair", names)
        inlined = {name: element(defined[name]) for name in ("trial", "square", "dense")}
        return {**inlined, "dense_called": outlined(defined["dense"])}

    @functools.cache  # noqa: B019  a pair lives as long as its module
    def of_lanes(self, n: int, lanes: int) -> dict[str, Any]:
        """Return the elements of `eig3.kernels.adaptive_lanes`: a step in each lane, its error, and its acceptance."""
        text = "\n".join([*self._trial_of_lanes(n, lanes), *self._square_of_lanes(n, lanes), ""])
        names = {"N": n, "LANES": lanes}
        defined = define(text, "lanes", {"__name__": __name__, "FORCE": element(bound(force_of_stage, names))})
        return {**{name: element(defined[name.lower()]) for name in ("TRIAL", "SQUARE")}, "MOVE": moved(names)}

    def _trial_of_lanes(self, n: int, lanes: int) -> list[str]:
        tableau = self.tableau
        lines = ["def trial(f, time, there, step, before, p, y):", self._unpacked()]

        def evaluated(c: float, u: str, v: str, a: str) -> list[str]:
            return [f"    FORCE(f, {c!r}, time, there, step, {u}, {v}, p, {a})"]

        for i in range(1, self.n_stages):
            entries = ", ".join(f"{row}[j]" for row in tableau.state)
            state = ", ".join(self.state_text(i, tableau.stage(self.A[i], self.A)))
            lines += _in_lanes(n, lanes, f"{entries} = {state}")
            lines += evaluated(self.c[i], "u_stage", tableau.velocity, self.accelerations[i])
        u, v = self.state_text(self.n_stages, tableau.end(self.A[self.n_stages], self.A))
        lines += _in_lanes(n, lanes, f"u_end[j], v_end[j] = {u}, {v}")
        return lines + evaluated(1.0, "u_end", "v_end", "a_end")

    def _square_of_lanes(self, n: int, lanes: int) -> list[str]:
        arguments = "step, rtol, atol, u_least, v_least, total, most, more, square, y"
        lines = [f"def square({arguments}):", self._unpacked(), f"    for lane in range({lanes}):"]
        lines.append("        total[lane], most[lane], more[lane] = 0.0, 0.0, 0.0")
        inside = [
            "u_scale = 1 / (atol[0, d] + rtol * max(abs(u[j]), abs(u_end[j]), u_most[j], u_least[lane]) + 1e-300)",
            "v_scale = 1 / (atol[1, d] + rtol * max(abs(v[j]), abs(v_end[j]), v_most[j], v_least[lane]) + 1e-300)",
        ]
        for row, weights in zip(("most", "more"), self.errors, strict=False):
            of_u, of_v = (self.weighted(w) for w in self.tableau.end([Fraction(x) for x in weights], self.A))
            inside += [f"u_part, v_part = h * {total(of_u)} * u_scale, {total(of_v)} * v_scale"]
            inside += [f"{row}[lane] = max({row}[lane], u_part * u_part, v_part * v_part)"]
            inside += ["total[lane] += u_part + v_part"]
        lines += [*_in_lanes(n, lanes, *inside), f"    for lane in range({lanes}):"]
        value = "most[lane]"
        if len(self.errors) == 2:
            lines.append("        both = most[lane] + 0.01 * more[lane]")
            value = "(most[lane] * most[lane] / both if both > 0 else 0.0)"
        lines.append("        blow_up = total[lane] - total[lane]  # NaN, which a maximum may leave out")
        return [*lines, f"        square[lane] = step[lane] * step[lane] * {value} if blow_up == 0 else blow_up"]

    def _unpacked(self) -> str:
        return f"    {', '.join(self.row_names)} = y"

    def weighted(self, weights: Sequence[SupportsFloat]) -> list[tuple[str, str]]:
        """Return the weights that are not zero, with the text of their accelerations."""
        return [(repr(float(w)), f"{a}[j]") for w, a in zip(weights, self.accelerations, strict=False) if w]

    def state_text(self, i: int, weights: Sequence[Row]) -> list[str]:
        """Return the text of u, and of v, at the time of the stage i."""
        squares, *rows = (self.weighted(row) for row in weights)
        position = f" + h * {total(squares)}" if squares else ""
        texts = [f"u[j] + h * ({self.c[i]!r} * v[j]{position})"]
        for *others, (factor, last) in rows:
            before = f"(v[j] + h * {total(others)})" if others else "v[j]"
            # One multiply-add has to wait for the last acceleration.
            texts.append(f"{before} + (h * {factor}) * {last}")
        return texts

    def _stage(self, i: int) -> list[str]:
        tableau = self.tableau
        entries = ", ".join(f"{row}[j]" for row in tableau.state)
        return [
            "    for j in range(n):",
            f"        {entries} = {', '.join(self.state_text(i, tableau.stage(self.A[i], self.A)))}",
            f"    f(t + {self.c[i]!r} * h, u_stage, {tableau.velocity}, p, {self.accelerations[i]})",
        ]

    def _trial(self) -> str:
        lines = ["def trial(f, t, h, h_before, p, n, y):", self._unpacked()]
        for i in range(1, self.n_stages):
            lines += self._stage(i)
        u, v = self.state_text(self.n_stages, self.tableau.end(self.A[self.n_stages], self.A))
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
            of_u, of_v = (self.weighted(row) for row in self.tableau.end([Fraction(x) for x in weights], self.A))
            lines += [
                f"        u_part = h * {total(of_u)} * u_scale",
                f"        v_part = {total(of_v)} * v_scale",
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
        if not self.weights:
            return "\n".join([*lines, "    quintic(h, n, u, v, a0, u_end, v_end, a_end, coefficients)", ""])
        for i in range(self.n_stages + 1, len(self.A)):
            lines += self._stage(i)
        return "\n".join([*lines, "    for j in range(n):", *self._polynomials(), ""])

    def _polynomials(self) -> list[str]:
        """Return the lines that write the coefficients for the degree of freedom j.

        The terms of the extension are products of the factors s, 1 - s, s, 1 - s, ...
        """
        lines = [*self._rise("u", "v"), *self._rise("v", "a0", "a_end")]
        for k, weights in enumerate(self.weights, start=3):
            exact = [Fraction(x) for x in weights]
            squares = total(self.weighted(product(exact, self.A)))
            lines += [
                f"        u{k} = h * ({float(sum(exact))!r} * v[j] + h * {squares})",
                f"        v{k} = h * {total(self.weighted(exact))}",
            ]
        return [*lines, *self._powers("u", 0), *self._powers("v", self.terms)]

    def _rise(self, x: str, slope: str, slope_end: str = "v_end") -> list[str]:
        """Return the lines of the first terms of u or v, which follow from the values and slopes at both ends."""
        return [
            f"        rise = {x}_end[j] - {x}[j]",
            f"        {x}0, {x}1, {x}2 = rise, h * {slope}[j] - rise, 2 * rise - h * ({slope}[j] + {slope_end}[j])",
        ]

    def _powers(self, x: str, place: int) -> list[str]:
        """Return the lines that write the coefficients of the powers of s, from the row `place` on."""
        lines = [f"        coefficients[{place}, j] = {x}[j]"]
        for power in range(1, self.terms):
            factors = ((_alternating(i, power), f"{x}{i}") for i in range(self.terms - 1))
            terms = [(repr(float(c)), value) for c, value in factors if c]
            lines.append(f"        coefficients[{place + power}, j] = {total(terms)}")
        return lines


def force_of_stage(f, c, time, there, step, u, v, p, a):  # type: ignore[no-untyped-def]
    """Evaluate the right-hand side after the fraction c of the step. The trial has less code without this loop."""
    for lane in range(LANES):  # noqa: F821
        there[lane] = time[lane] + c * step[lane]
    f(there, u, v, p, a)


def moved(names: dict[str, int]) -> Any:
    """Return the element that begins the next step in the lanes whose step was accepted."""
    return element(bound(move, names))


def move(ok, y):  # type: ignore[no-untyped-def]
    u, v, a, u_end, v_end, a_end = y[:6]
    for d in range(N):  # noqa: F821
        for lane in range(LANES):  # noqa: F821
            j = d * LANES + lane  # noqa: F821
            u[j] = u_end[j] if ok[lane] > 0 else u[j]
            v[j] = v_end[j] if ok[lane] > 0 else v[j]
            a[j] = a_end[j] if ok[lane] > 0 else a[j]


def _in_lanes(n: int, lanes: int, *lines: str) -> list[str]:
    """Return a loop over the degrees of freedom and the lanes, in which h is the step."""
    head = [f"    for d in range({n}):", f"        for lane in range({lanes}):", f"            j = d * {lanes} + lane"]
    return [*head, *(f"            {line}" for line in ("h = step[lane]", *lines))]


def total(terms: Sequence[tuple[str, str]]) -> str:
    """Return the text of the sum of products, of which the last is added last."""
    (factor, value), rest = terms[0], terms[1:]
    return f"({after_sum(f'{factor} * {value}', rest)})" if rest else f"({factor} * {value})"


def _alternating(i: int, power: int) -> int:
    """Return the coefficient of s^power in the product of i + 1 factors s, 1 - s, s, 1 - s, ..."""
    below, above = i // 2 + 1, (i + 1) // 2
    k = power - below
    return (-1) ** k * comb(above, k) if 0 <= k <= above else 0
