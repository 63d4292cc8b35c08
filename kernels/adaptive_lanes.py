"""Runs with tolerances of many trajectories at once, in the lanes of SIMD registers.

Each lane has its own time, step, error and acceptance, which are selected without branches. A trajectory that has ended
hands its lane to the next one at once, so that no lane waits. The formulas of the steps, of the error and of the control
are those of a single run, see `eig3.kernels.loops.variable`. What happens rarely is left to a single run: a step below
the resolution of the time, too many steps, a force that does not act yet, an event.

All values of a block are in one array: value j of the trajectory in a lane is at index first + j * lanes + lane, where
`first` is a constant for each row. LLVM then knows without checks that the rows do not overlap.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NamedTuple

import numba
from numba.types import float64, int64

from .compile.jit import KERNEL_OPTIONS, compiled
from .compile.numba_internals import (
    address_of as address_of_code,
    addresses_of_arrays,
    assume_no_overlap,
    call_without_checks,
    optimised_code,
    wide_vectors,
)
from .compile.source import define
from .lanes import _array_view, _obstacle, _shared
from .loops.beginning import RESOLUTION, beginning, least_size, least_sizes
from .loops.controller import LEAST_ERROR, exponent, growth, log2, shrinkage
from .loops.formulas import variable_formulas
from .loops.pair import A, U, U_MOST, V, V_MOST, Pair, total
from .protocol import (
    EVALUATIONS,
    SCALAR,
    STEP,
    STEP_BEFORE,
    TIME,
    U_SIZE,
    V_SIZE,
    Form,
    Span,
    address_of,
    matrix_type,
    vector_type,
)

#: How a trajectory ended: it has not yet, it reached the end of its span, or a single run has to take it.
RUNNING, REACHED, LEFT = range(3)

#: The columns of the results: the number of steps, of rejected steps and of evaluations, and how it ended.
TAKEN, REJECTED, EVALUATED, ENDED = range(4)

#: The entries of `Block.place`: the next trajectory, and the number of those that have not ended.
NEXT, LEFT_OVER = range(2)

#: A value of each lane: time, next step, step, step before, logarithm of the last error, sizes, what the error of this
#: step is relative to, whether the last trial was rejected, counts, whether a single run has to take it, and flags.
_OF_LANES = (
    *("time", "h", "step", "before", "error", "u_size", "v_size", "u_least", "v_least", "v_blur", "rejected"),
    *("taken", "trials", "bad", "square", "total", "ok", "u_new", "v_new"),
)

_OVERFLOWING = 1e150  # a single run says what is wrong with a larger motion


class Block(NamedTuple):
    """What the lanes keep from one call of the kernel to the next.

    Attributes
    ----------
    values : ndarray
        The values of the lanes.
    members : ndarray of int, shape (lanes,)
        The trajectory in each lane, or -1.
    place : ndarray of int
        See `NEXT`.
    one, tally : ndarray
        Room for the start of one trajectory.
    """

    values: Any
    members: Any
    place: Any
    one: Any
    tally: Any


class Starts(NamedTuple):
    """The trajectories: their starts and their parameters, with one row for each of them or one for all."""

    u: Any
    v: Any
    params: Any


class Ends(NamedTuple):
    """Where the results are written, with a row for each trajectory."""

    u: Any
    v: Any
    counts: Any


@dataclass(frozen=True)
class AdaptiveLayout:
    """The values of a block.

    Attributes
    ----------
    form : Form
    n, lanes : int
    k : int
        Number of parameters.
    shares_params : bool
    n_events : int
    """

    form: Form
    n: int
    lanes: int
    k: int
    shares_params: bool
    n_events: int

    def rows(self, pair: Pair) -> dict[str, int]:
        """Return the first index of each row."""
        begin, found = 0, {}
        sizes = [(name, self.n) for name in pair.row_names]
        sizes += [("p", 0 if self.shares_params else self.k)]
        sizes += [(name, 1) for name in _OF_LANES]
        sizes += [(f"{end}{e}", 1) for e in range(self.n_events) for end in ("low", "high")]
        for name, count in sizes:
            found[name] = begin
            begin += count * self.lanes
        found["end"] = begin
        return found


@dataclass(frozen=True, eq=False)
class AdaptiveLanes:
    """The kernel of a method and a right-hand side for a block of lanes.

    Attributes
    ----------
    call : callable
        ``call(rhs_address, count, t0, t_end, h_first, h_max, max_steps, rtol, atol, is_relative, block, starts, ends)``
        takes `count` steps in each lane, or fewer if all trajectories end.
    size : int
        Number of values of a block.
    times : slice
        The times of the lanes among them.
    obstacle : str
        Why LLVM did not vectorise it; empty if it did.
    compiled : Numba's compile result
    """

    call: Callable
    size: int
    times: slice
    obstacle: str
    compiled: Any


def compile_adaptive(
    function: Callable, layout: AdaptiveLayout, module: str, reads_time: bool, events: Sequence[Callable] = ()
) -> AdaptiveLanes:
    """Compile the kernel of a method for the plain Python functions of the user.

    Parameters
    ----------
    function : callable
        The right-hand side.
    layout : AdaptiveLayout
    module : str
        The file with the formulas of the method, which are those of a `Pair`.
    reads_time : bool
        Whether the right-hand side may read t.
    events : sequence of callable
        The functions of events: a trajectory in which one is not of one sign is left to a single run.
    """
    pair = variable_formulas(module)
    source = _Source(pair, layout, reads_time)
    begin, _ = beginning(layout.form)
    names: dict[str, Any] = {
        "__name__": __name__,
        "FUNCTION": numba.njit(inline="always", **KERNEL_OPTIONS)(function),
        "PARAMS": _shared(layout.k) if layout.shares_params else _rows_of(layout.k, layout.lanes, source.first["p"]),
        "BEGIN": begin,
        "RHS_AT": layout.form.at("rhs"),
        "Span": Span,
        "address_of": address_of,
        "least_size": least_size,
        "least_sizes": least_sizes,
        "math": math,
        "log2": log2,
        "exponent": exponent,
        "growth": growth,
        "shrinkage": shrinkage,
        **{f"EVENT_{e}": numba.njit(inline="always", **KERNEL_OPTIONS)(g) for e, g in enumerate(events)},
        **{f"VIEW_{row}": _rows_of(layout.n, layout.lanes, source.first[row]) for row in pair.row_names},
        **{f"WRITE_{row}": _rows_of(layout.n, layout.lanes, source.first[row], False) for row in pair.row_names},
    }
    defined = define(source.text(), "adaptive_lanes", names)
    kinds = [
        *(int64, int64, float64, float64, float64, float64, int64, float64, matrix_type, int64),
        numba.types.NamedTuple((vector_type, _integers, _integers, matrix_type, vector_type), Block),
        numba.types.NamedTuple((matrix_type, matrix_type, matrix_type), Starts),
        numba.types.NamedTuple((matrix_type, matrix_type, numba.types.Array(int64, 2, "C")), Ends),
    ]
    with warnings.catch_warnings(), wide_vectors(), addresses_of_arrays():
        warnings.simplefilter("ignore", numba.NumbaPerformanceWarning)  # the strides of lanes are here to stay
        jitted = numba.njit(**KERNEL_OPTIONS)(defined["adaptive"])
        result = compiled(assume_no_overlap(jitted), tuple(kinds))
    times = slice(source.first["time"], source.first["time"] + layout.lanes)
    obstacle = _obstacle(optimised_code(result))
    return AdaptiveLanes(call_without_checks(result), source.first["end"], times, obstacle, result)


_integers = numba.types.Array(int64, 1, "C")


def _rows_of(count: int, lanes: int, first: int, readonly: bool = True) -> Any:
    """Return a compiled ``view(values, lane)`` of the values of a lane in a row."""
    return _array_view(numba.types.Array(float64, 1, "A", readonly=readonly), count, lanes, first, 1)


class _Source:
    """The source of the kernel for one method and layout."""

    def __init__(self, pair: Pair, layout: AdaptiveLayout, reads_time: bool) -> None:
        self.pair, self.layout, self.reads_time = pair, layout, reads_time
        self.first = layout.rows(pair)

    def text(self) -> str:
        """Return the source of the function `adaptive`."""
        arguments = "rhs, count, t0, t_end, h_first, h_max, max_steps, rtol, atol, is_relative, block, starts, ends"
        lines = [f"def adaptive({arguments}):", *_indented(self._head())]
        lines += ["    for _ in range(count):", *_indented(self._events() + self._look(), 2)]
        steps = self._begin_step() + self._stages() + self._at_rest() + self._square() + self._accept() + self._end_step()
        return "\n".join([*lines, *_indented(steps, 2), "    return place[0] + place[1]", ""])

    def _of(self, text: str) -> str:
        """Return a text in which ``name[j]`` and ``name[l]`` are entries of the array of all values."""
        return re.sub(r"\b(\w+)\[([jl])\]", lambda m: f"s[{self.first[m[1]]} + {m[2]}]" if m[1] in self.first else m[0], text)

    def _lanes(self, *lines: str) -> list[str]:
        """Return a loop over the lanes."""
        return [f"for l in range({self.layout.lanes}):", *(self._of(f"    {line}") for line in lines)]

    def _degrees(self, *lines: str) -> list[str]:
        """Return a loop over the degrees of freedom d, and over the lanes."""
        lanes = self.layout.lanes
        inner = [f"    for l in range({lanes}):", f"        j = d * {lanes} + l"]
        return [f"for d in range({self.layout.n}):", *inner, *(self._of(f"        {line}") for line in lines)]

    def _head(self) -> list[str]:
        return [
            "s, members, place, one, tally = block",
            "begins_p = len(starts.params) > 1",
            "p = starts.params[0]",
            "share = least_size(rtol)",
            "s_p = p" if self.layout.shares_params else "s_p = s",
        ]

    def _call(self, c: float, u: str, v: str, a: str) -> list[str]:
        """Return the lines that evaluate the accelerations in the row a, at the fraction c of the step."""
        time = self._of(f"time[l] + {c!r} * step[l]" if c != 1.0 else "time[l] + step[l]")
        if self.layout.form is SCALAR:
            state = self._of(f"{u}[l], {v}[l]")
            return self._lanes(f"{a}[l] = FUNCTION({time}, {state}, PARAMS(s_p, l))")
        return self._lanes(f"FUNCTION({time}, VIEW_{u}(s, l), VIEW_{v}(s, l), PARAMS(s_p, l), WRITE_{a}(s, l))")

    def _stages(self) -> list[str]:
        pair, tableau, lines = self.pair, self.pair.tableau, []
        for i in range(1, pair.n_stages):
            entries = ", ".join(f"{row}[j]" for row in tableau.state)
            state = ", ".join(pair.state_text(i, tableau.stage(pair.A[i], pair.A)))
            lines += self._degrees("h = step[l]", f"{entries} = {state}")
            lines += self._call(pair.c[i], "u_stage", tableau.velocity, pair.accelerations[i])
        u, v = pair.state_text(pair.n_stages, tableau.end(pair.A[pair.n_stages], pair.A))
        lines += self._degrees("h = step[l]", f"u_end[j], v_end[j] = {u}, {v}")
        return lines + self._call(1.0, "u_end", "v_end", "a_end")

    def _square(self) -> list[str]:
        """Return the lines of the square of the error in each lane, as `Pair` computes it."""
        pair, names = self.pair, [f"most{k}" for k in range(len(self.pair.errors))]
        rows = ["u_new", "v_new"][: len(names)]  # which are not needed before the end of the step
        lines = self._lanes("total[l] = 0.0", *(f"{row}[l] = 0.0" for row in rows))
        inside = [
            "h = step[l]",
            "u_scale = 1 / (atol[0, d] + rtol * max(abs(u[j]), abs(u_end[j]), u_most[j], u_least[l]) + 1e-300)",
            "v_scale = 1 / (atol[1, d] + rtol * max(abs(v[j]), abs(v_end[j]), v_most[j], v_least[l]) + 1e-300)",
            "sum_of_parts = 0.0",
        ]
        for row, weights in zip(rows, pair.errors, strict=True):
            of_u, of_v = (pair.weighted(w) for w in pair.tableau.end([Fraction(x) for x in weights], pair.A))
            inside += [
                f"u_part = h * {total(of_u)} * u_scale",
                f"v_part = {total(of_v)} * v_scale",
                f"{row}[l] = max({row}[l], u_part * u_part, v_part * v_part)",
                "sum_of_parts += u_part + v_part",
            ]
        lines += self._degrees(*inside, "total[l] += sum_of_parts")
        value = "u_new[l]"
        if len(rows) == 2:
            value = "(u_new[l] * u_new[l] / both if both > 0 else 0.0)"
        return lines + self._lanes(
            *["both = u_new[l] + 0.01 * v_new[l]"] * (len(rows) == 2),
            "not_finite = total[l] - total[l]",
            f"value = step[l] * step[l] * {value}",
            "square[l] = value if not_finite == 0 else not_finite",
        )

    def _begin_step(self) -> list[str]:
        return self._lanes(
            "remaining = t_end - time[l]",
            "step[l] = remaining if h[l] >= remaining else h[l]",
            "x = step[l]",
            f"is_long = (x > 0) & (x >= {RESOLUTION!r} * abs(time[l] + x))",
            "bad[l] = bad[l] if is_long | (h[l] >= remaining) else 1.0",
            "u_least[l], v_least[l], v_blur[l] = share * u_size[l], share * v_size[l], 0.0",
        )

    def _at_rest(self) -> list[str]:
        """Return the lines for lanes in which nothing has moved, as `beginning.at_rest` has them."""
        lines = ["rests = 0", *self._lanes("rests += (u_size[l] == 0) | (v_size[l] == 0)")]
        inner = [
            f"for l in range({self.layout.lanes}):",
            "    if u_size[l] == 0 or v_size[l] == 0:",
            "        a_size = 0.0",
            f"        for d in range({self.layout.n}):",
            "            if atol[0, d] < math.inf:",
            f"                j = d * {self.layout.lanes} + l",
            "                a_size = max(a_size, abs(a0[j]), abs(a_end[j]))",
            "        u_least[l], v_least[l], v_blur[l] = least_sizes(",
            "            u_size[l], v_size[l], a_size, time[l] + step[l], t_end - t0, rtol)",
        ]
        return [*lines, "if rests > 0 and is_relative == 1:", *(self._of(f"    {line}") for line in inner)]

    def _accept(self) -> list[str]:
        order = self.pair.order
        lines = [
            "x = step[l]",
            "e = exponent(square[l])",
            "is_ok = (square[l] <= 1.0) & (x > 0)",
            f"grown = growth(e, error[l], log2(x / before[l]), {order})",
            "longer = min(x * (min(grown, 1.0) if rejected[l] > 0 else grown), h_max)",
            f"shorter = x * shrinkage(square[l], {order})",
            "reached = t_end if h[l] >= t_end - time[l] else time[l] + x",
            "h[l] = longer if is_ok else (shorter if x > 0 else h[l])",
            "time[l] = reached if is_ok else time[l]",
            f"error[l] = max(e, {LEAST_ERROR!r}) if is_ok else error[l]",
            "before[l] = x if is_ok else before[l]",
            "rejected[l] = 0.0 if is_ok else 1.0",
            "ok[l] = 1.0 if is_ok else 0.0",
            "taken[l] += ok[l]",
            "trials[l] += 1.0 if x > 0 else 0.0",
        ]
        if self.reads_time:  # the force may not act yet: a single run takes care of the step
            lines.append("bad[l] = 1.0 if is_ok & (square[l] == 0) else bad[l]")
        return self._lanes(*lines)

    def _end_step(self) -> list[str]:
        moved = [f"{x}[j] = {x_end}[j] if ok[l] > 0 else {x}[j]" for x, x_end in
                 (("u", "u_end"), ("v", "v_end"), ("a0", "a_end"))]
        sizes = [
            "counts = atol[0, d] < math.inf",
            "u_now, v_now = max(u_most[j], abs(u[j])), max(v_most[j], abs(v[j]))",
            "u_most[j], v_most[j] = (u_now if counts else u_most[j]), (v_now if counts else v_most[j])",
            "u_new[l], v_new[l] = max(u_new[l], u_most[j]), max(v_new[l], v_most[j])",
        ]
        lines = self._degrees(*moved) + ["if is_relative == 1:"]
        sized = self._lanes("u_new[l], v_new[l] = u_size[l], v_size[l]") + self._degrees(*sizes)
        sized += self._lanes(
            "is_new = (v_new[l] > v_blur[l]) & (ok[l] > 0)",
            "u_size[l], v_size[l] = (u_new[l] if is_new else u_size[l]), (v_new[l] if is_new else v_size[l])",
        )
        return lines + _indented(sized)

    def _events(self) -> list[str]:
        """Return the lines that follow the functions of the events."""
        lines = []
        for e in range(self.layout.n_events):
            state = "u[l], v[l]" if self.layout.form is SCALAR else "VIEW_u(s, l), VIEW_v(s, l)"
            lines += self._lanes(
                f"g = EVENT_{e}(time[l], {state}, PARAMS(s_p, l))",
                f"low{e}[l], high{e}[l] = min(low{e}[l], g), max(high{e}[l], g)",
                f"bad[l] = bad[l] if (low{e}[l] > 0) | (high{e}[l] < 0) else 1.0",
            )
        return lines

    def _look(self) -> list[str]:
        """Return the lines that end trajectories, and begin others in their lanes."""
        look = ["ended = 0", *self._lanes(
            "ended += (bad[l] > 0) | (time[l] >= t_end) | (taken[l] >= max_steps)",
        )]
        n, lanes = self.layout.n, self.layout.lanes
        inner = [
            f"for l in range({lanes}):",
            "    if not (bad[l] > 0 or time[l] >= t_end or taken[l] >= max_steps):",
            "        continue",
            "    m = members[l]",
            "    if m >= 0:",
            "        ends.counts[m, 0], ends.counts[m, 1] = int(taken[l]), int(trials[l] - taken[l])",
            f"        ends.counts[m, 2] += {self.pair.evaluations} * int(trials[l])",
            "        is_left = bad[l] > 0 or time[l] < t_end",
            f"        for d in range({n}):",
            f"            j = d * {lanes} + l",
            "            ends.u[m, d], ends.v[m, d] = u[j], v[j]",
            f"            is_left = is_left or not (abs(u[j]) < {_OVERFLOWING!r} and abs(v[j]) < {_OVERFLOWING!r})",
            f"        ends.counts[m, 3] = {LEFT} if is_left else {REACHED}",
            "        members[l] = -1",
            "        place[1] -= 1",
            "    bad[l], taken[l], trials[l], time[l], step[l] = 0.0, 0.0, 0.0, t_end, 0.0",
            "    while place[0] < len(starts.u) and members[l] < 0:",
            "        m = place[0]",
            "        place[0] += 1",
            *(f"        {line}" for line in self._load()),
        ]
        idle = ["if place[1] == 0:", "    break"]
        return [*look, "if ended > 0:", *(self._of(f"    {line}") for line in inner), *_indented(idle)]

    def _load(self) -> list[str]:
        """Return the lines that begin trajectory m in lane l, as a single run begins."""
        n, lanes = self.layout.n, self.layout.lanes
        own = [] if self.layout.shares_params else [
            f"    for q in range({self.layout.k}):",
            f"        s[{self.first['p']} + q * {lanes} + l] = starts.params[m, q]",
        ]
        state = "one[0, 0], one[1, 0]" if self.layout.form is SCALAR else "one[0], one[1]"
        rhs = "RHS_AT(rhs)(t0, one[0], one[1], mine, one[2])"
        return [
            "mine = starts.params[m if begins_p else 0]",
            f"for d in range({n}):",
            f"    one[{U}, d], one[{V}, d], one[{A}, d] = starts.u[m, d], starts.v[m, d], math.nan",
            f"    one[{U_MOST}, d], one[{V_MOST}, d] = 0.0, 0.0",
            rhs,
            "is_finite = True",
            f"for d in range({n}):",
            f"    is_finite = is_finite and math.isfinite(one[{A}, d])",
            "if not is_finite:",
            f"    ends.counts[m, 3] = {LEFT}",
            "    place[1] -= 1",
            "else:",
            "    tally[:] = 0.0",
            f"    tally[{TIME}], tally[{STEP}] = t0, min(h_first, h_max)",
            "    span = Span(t0, t_end, mine, 0, 0, 0, 0, h_max, rtol, atol, is_relative, 0, 0, tally, tally, one, one)",
            f"    BEGIN(rhs, address_of(span), tally, {self.pair.order}, one)",
            f"    time[l], h[l], before[l], error[l] = t0, tally[{STEP}], tally[{STEP_BEFORE}], 1.0",
            f"    u_size[l], v_size[l], rejected[l] = tally[{U_SIZE}], tally[{V_SIZE}], 0.0",
            f"    ends.counts[m, 2] = 1 + int(tally[{EVALUATIONS}])",
            *own,
            f"    for d in range({n}):",
            f"        j = d * {lanes} + l",
            f"        u[j], v[j], a0[j] = one[{U}, d], one[{V}, d], one[{A}, d]",
            f"        u_most[j], v_most[j] = one[{U_MOST}, d], one[{V_MOST}, d]",
            *(f"    low{e}[l] = high{e}[l] = EVENT_{e}(t0, {state}, mine)" for e in range(self.layout.n_events)),
            "    members[l] = m",
        ]


def _indented(lines: Sequence[str], times: int = 1) -> list[str]:
    return [f"{'    ' * times}{line}" for line in lines]
