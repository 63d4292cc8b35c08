"""The steps of variable length of a Runge-Kutta pair: a trial step, the estimate of its error, and dense output.

The formulas are as in `eig3.kernels.loops.tableau`, with the step as a factor of the sums: coefficients that contain
powers of h would have to be computed anew for each step. With the weights e_i of the estimate, where the last stage is
the acceleration at the end of the step, the errors are

    error of v = h sum_i e_i a_i        error of u = h^2 sum_i (e A)_i a_i

The error of a step is the largest of these in relation to their tolerances. A mean over many degrees of freedom would
allow a single one an error far beyond.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from fractions import Fraction
from math import comb
from typing import Any, ClassVar, SupportsFloat

from ..compile.jit import bound, called, element
from ..compile.source import Writer, after_sum, define
from .dense import QUINTIC_TERMS, quintic
from .tableau import Row, Tableau, product

#: The rows of a step of variable length: the state at its start and at its end, and the sizes of u and v of each degree
#: of freedom so far. Other rows follow.
U, V, A, U_END, V_END, A_END, U_MOST, V_MOST = range(8)


@element
def combined(most, more):  # type: ignore[no-untyped-def]
    """Return the square of the error from the squares of estimates of orders 5 and 3, as in DOP853."""
    both = most + 0.01 * more
    return most * most / both if both > 0 else 0.0


_NAMES = {"__name__": __name__, "combined": combined}


class Text(Writer):
    """Writes functions of a state whose entries j belong to one system, or, with lanes, to a system in each lane.

    `trial`, `square` and `advance` are the arguments of these functions. `result` is what `square` does with its
    result, and `if_accepted` in which lanes `advance` changes a row. `own`, `d` and `before` are the index of what each
    lane has separately, the number of a degree of freedom, and the step before.
    """

    def __init__(self, n: int = 0, lanes: int = 0) -> None:
        super().__init__()
        self._n, self._lanes = n, lanes
        self.trial = "f, time, there, step, before, p, y" if lanes else "f, t, h, h_before, p, n, y"
        given = "rtol, atol, u_least, v_least"
        self.square = f"step, {given}, total, most, more, square, y" if lanes else f"h, n, y, {given}"
        self.result = "square[lane] =" if lanes else "return"
        self.advance, self.if_accepted = ("ok, y", " if ok[lane] > 0 else {row}[j]") if lanes else ("y, n", "")
        self.own, self.d, self.before = ("[lane]", "d", "before[lane]") if lanes else ("", "j", "h_before")

    @contextmanager
    def each(self) -> Iterator[None]:
        """Write a loop over the lanes."""
        with self.block(f"for lane in range({self._lanes})") if self._lanes else nullcontext():
            yield

    @contextmanager
    def entries(self, with_step: bool = True) -> Iterator[None]:
        """Write a loop over the entries."""
        with self.block(f"for {self.d} in range({self._n or 'n'})"), self.each():
            if self._lanes:
                self.line(f"j = d * {self._lanes} + lane", *["h = step[lane]"] * with_step)
            yield

    def force(self, c: float, u: str, v: str, a: str) -> None:
        """Evaluate the right-hand side after the fraction c of the step."""
        at = f"FORCE(f, {c!r}, time, there, step" if self._lanes else f"f(t + {c!r} * h"
        self.line(f"{at}, {u}, {v}, p, {a})")


class Steps:
    """The formulas of steps of variable length, as `eig3.kernels.loops.variable` uses them.

    Attributes
    ----------
    order : int
        The order of the estimate of the error, plus 1.
    row_names : sequence of str
        The names of all rows.
    norm : str
        The square of the error, from the largest squares of the errors of the entries.
    carried : dict of str
        The rows with which the next step begins, and the rows of this step whose values they get.
    terms : int
        Number of coefficients of the dense output of u, and of v.
    evaluations, dense_evaluations : int
        Evaluations of the right-hand side in a step, and in its dense output.
    """

    order: int
    row_names: Sequence[str]
    norm = "h * h * {most}"
    carried: ClassVar[Mapping[str, str]] = {"u": "u_end", "v": "v_end", "a0": "a_end"}
    terms = QUINTIC_TERMS
    evaluations, dense_evaluations = 1, 0

    @property
    def rows(self) -> int:
        """Number of rows of a step."""
        return len(self.row_names)

    @property
    def work_rows(self) -> int:
        """Number of rows of `Watch.work` that a search needs: u and v within a step, and the dense output."""
        return 2 + 2 * self.terms

    @functools.cache  # noqa: B019  they live as long as their module
    def functions(self) -> dict[str, Any]:
        """Return the elements `trial`, `square`, `advance` and `dense`, and `dense_called`, which is not inlined."""
        out = self._text(Text())
        with out.block("def dense(f, t, h, p, n, y, coefficients)"):
            out.line(self._unpacked)
            self._dense(out)
        defined = define(str(out), "pair", {**_NAMES, "quintic": quintic})
        inlined = {name: element(defined[name]) for name in ("trial", "square", "advance", "dense")}
        return {**inlined, "dense_called": called(inlined["dense"])}

    @functools.cache  # noqa: B019  they live as long as their module
    def of_lanes(self, n: int, lanes: int) -> dict[str, Any]:
        """Return the elements of `eig3.kernels.adaptive_lanes`: a step in each lane, its error, and its acceptance."""
        names = {"N": n, "LANES": lanes}
        text = str(self._text(Text(n, lanes)))
        defined = define(text, "lanes", {**_NAMES, "FORCE": element(bound(force_of_stage, names))})
        return {name: element(defined[name.lower()]) for name in ("TRIAL", "SQUARE", "ADVANCE")}

    @property
    def _unpacked(self) -> str:
        return f"{', '.join(self.row_names)} = y"

    def _text(self, out: Text) -> Text:
        """Write a trial step, the square of its error in relation to the tolerances, and the move to the next step."""
        total, most, more = (f"{name}{out.own}" for name in ("total", "most", "more"))
        with out.block(f"def trial({out.trial})"):
            out.line(self._unpacked)
            self._trial(out)
        with out.block(f"def square({out.square})"):
            out.line(self._unpacked)
            with out.each():
                out.line(f"{total}, {most}, {more} = 0.0, 0.0, 0.0")
            with out.entries():
                self._errors(out, total, most, more)
            with out.each():
                out.line(*["h = step[lane]"] * bool(out.own))
                out.line(f"blow_up = {total} - {total}  # NaN, which a maximum may leave out")
                out.line(f"{out.result} {self.norm.format(most=most, more=more)} if blow_up == 0 else blow_up")
        with out.block(f"def advance({out.advance})"):
            out.line(self._unpacked)
            with out.entries(with_step=False):
                for row, end in self.carried.items():
                    out.line(f"{row}[j] = {end}[j]{out.if_accepted.format(row=row)}")
        return out

    def _trial(self, out: Text) -> None:
        """Write how the rows of the end follow from the rows of the start."""
        raise NotImplementedError

    def _errors(self, out: Text, total: str, most: str, more: str) -> None:
        """Add the errors of the entry j to `total`, and let `most` and `more` be the largest squares."""
        raise NotImplementedError

    def _dense(self, out: Text) -> None:
        """Write the coefficients of the dense output."""
        out.line("quintic(h, n, u, v, a0, u_end, v_end, a_end, coefficients)")


class Pair(Steps):
    """The formulas of a pair.

    If there are two estimates of the error with weights in `errors`, of orders 5 and 3, they are combined as in DOP853.
    The `extension` has the times and rows of further stages, and the weights of all stages in the last terms of its
    polynomial. Without an extension, it is the polynomial of degree 5 through u, v and a at both ends.

    c and A have the times of the stages, of the end of the step and of further stages, and the rows of their matrix.
    `accelerations` are the names of the rows with the accelerations of the stages.
    """

    known_terms = 4  # the terms of the extension that follow from the states at both ends

    def __init__(
        self, tableau: Tableau, order: int, errors: Sequence[Sequence[float]], extension: tuple | None = None
    ) -> None:
        self.order, self.errors = order, errors
        if len(errors) == 2:
            self.norm = "h * h * combined({most}, {more})"
        self.tableau, self.n_stages = tableau, tableau.stages
        extra_c, extra_A, self.weights = extension or ((), (), ())
        self.terms = self.known_terms + len(self.weights) if extension else QUINTIC_TERMS
        self.c = [*map(float, tableau.c), 1.0, *extra_c]
        width = self.n_stages + 1 + len(extra_c)
        matrix = [*tableau.A, tableau.b, *([Fraction(x) for x in row] for row in extra_A)]
        self.A = [[*row, *[Fraction(0)] * (width - len(row))] for row in matrix]
        self.accelerations = ["a0", *(f"a{i}" for i in range(1, self.n_stages)), "a_end"]
        self.accelerations += [f"a{i}" for i in range(self.n_stages + 1, width)]
        others = [name for name in self.accelerations if name not in ("a0", "a_end")]
        self.row_names = ["u", "v", "a0", "u_end", "v_end", "a_end", "u_most", "v_most", *tableau.state, *others]
        self.evaluations, self.dense_evaluations = self.n_stages, len(extra_c)

    def weighted(self, weights: Sequence[SupportsFloat]) -> list[tuple[str, str]]:
        """Return the weights that are not zero, with the text of their accelerations."""
        return [(repr(float(w)), f"{a}[j]") for w, a in zip(weights, self.accelerations, strict=False) if w]

    def _state(self, i: int, weights: Sequence[Row]) -> list[str]:
        """Return the text of u, and of v, at the time of the stage i."""
        squares, *rows = (self.weighted(row) for row in weights)
        position = f" + h * {weighted_sum(squares)}" if squares else ""
        texts = [f"u[j] + h * ({self.c[i]!r} * v[j]{position})"]
        for *others, (factor, last) in rows:
            before = f"(v[j] + h * {weighted_sum(others)})" if others else "v[j]"
            # One multiply-add has to wait for the last acceleration.
            texts.append(f"{before} + (h * {factor}) * {last}")
        return texts

    def _stage(self, out: Text, i: int) -> None:
        tableau = self.tableau
        with out.entries():
            entries = ", ".join(f"{row}[j]" for row in tableau.state)
            out.line(f"{entries} = {', '.join(self._state(i, tableau.stage(self.A[i], self.A)))}")
        out.force(self.c[i], "u_stage", tableau.velocity, self.accelerations[i])

    def _trial(self, out: Text) -> None:
        for i in range(1, self.n_stages):
            self._stage(out, i)
        with out.entries():
            end = self._state(self.n_stages, self.tableau.end(self.A[self.n_stages], self.A))
            out.line(f"u_end[j], v_end[j] = {', '.join(end)}")
        out.force(1.0, "u_end", "v_end", "a_end")

    def _errors(self, out: Text, total: str, most: str, more: str) -> None:
        for k, x in enumerate("uv"):
            size = f"max(abs({x}[j]), abs({x}_end[j]), {x}_most[j], {x}_least{out.own})"
            out.line(f"{x}_scale = 1 / (atol[{k}, {out.d}] + rtol * {size} + 1e-300)")
        for largest, weights in zip((most, more), self.errors, strict=False):
            rows = self.tableau.end([Fraction(x) for x in weights], self.A)
            of_u, of_v = (weighted_sum(self.weighted(row)) for row in rows)
            out.line(f"u_part, v_part = h * {of_u} * u_scale, {of_v} * v_scale")
            out.line(f"{largest} = max({largest}, u_part * u_part, v_part * v_part)")
            out.line(f"{total} += u_part + v_part")

    def _dense(self, out: Text) -> None:
        if not self.weights:
            super()._dense(out)
            return
        for i in range(self.n_stages + 1, len(self.A)):
            self._stage(out, i)
        with out.entries():
            self._polynomials(out)

    def _polynomials(self, out: Text) -> None:
        """Write the coefficients for the degree of freedom j.

        The terms of the extension are products of the factors s, 1 - s, s, 1 - s, ...
        """
        self._rise(out, "u", "v")
        self._rise(out, "v", "a0", "a_end")
        for k, weights in enumerate(self.weights, start=3):
            exact = [Fraction(x) for x in weights]
            squares = weighted_sum(self.weighted(product(exact, self.A)))
            out.line(f"u{k} = h * ({float(sum(exact))!r} * v[j] + h * {squares})")
            out.line(f"v{k} = h * {weighted_sum(self.weighted(exact))}")
        self._powers(out, "u", 0)
        self._powers(out, "v", self.terms)

    def _rise(self, out: Text, x: str, slope: str, slope_end: str = "v_end") -> None:
        """Write the first terms of u or v, which follow from the values and slopes at both ends."""
        out.line(f"rise = {x}_end[j] - {x}[j]")
        out.line(f"{x}0, {x}1, {x}2 = rise, h * {slope}[j] - rise, 2 * rise - h * ({slope}[j] + {slope_end}[j])")

    def _powers(self, out: Text, x: str, place: int) -> None:
        """Write the coefficients of the powers of s, from the row `place` on."""
        out.line(f"coefficients[{place}, j] = {x}[j]")
        for power in range(1, self.terms):
            factors = ((_alternating(i, power), f"{x}{i}") for i in range(self.terms - 1))
            terms = [(repr(float(c)), value) for c, value in factors if c]
            out.line(f"coefficients[{place + power}, j] = {weighted_sum(terms)}")


def force_of_stage(f, c, time, there, step, u, v, p, a):  # type: ignore[no-untyped-def]
    """Evaluate the right-hand side after the fraction c of the step. The trial has less code without this loop."""
    for lane in range(LANES):  # noqa: F821
        there[lane] = time[lane] + c * step[lane]
    f(there, u, v, p, a)


def weighted_sum(terms: Sequence[tuple[str, str]]) -> str:
    """Return the text of the sum of products, of which the last is added last."""
    (factor, value), rest = terms[0], terms[1:]
    return f"({after_sum(f'{factor} * {value}', rest)})" if rest else f"({factor} * {value})"


def _alternating(i: int, power: int) -> int:
    """Return the coefficient of s^power in the product of i + 1 factors s, 1 - s, s, 1 - s, ..."""
    below, above = i // 2 + 1, (i + 1) // 2
    k = power - below
    return (-1) ** k * comb(above, k) if 0 <= k <= above else 0
