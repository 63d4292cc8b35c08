"""Write few constraints as unrolled Python source without loops, which runs in the lanes of an ensemble.

`eig3.kernels.constraints` has the formulas, and `eig3.kernels.constraint_lanes` the loops around the lines. The numbers
of the constraints are in their table in p, at constant places; nothing is written there. In the source, the arm k has
the components dk_x and dk_y, and in another state or as a rate ek_x and ek_y; gk_i_x is a component of the gradient of
the row k with respect to the mass i, and wk_i_x this times the inverse mass; sk_m is S, and then L; rk is the inverse
of D; and lk is a value, and then the multiplier.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from ..kernels.constraint_lanes import CONVERGED, LOST, UnrolledConstraints
from ..kernels.constraints import CLOSE, EPS, LENGTH, SINGULAR
from .assembly import Assembly

if TYPE_CHECKING:
    from .constraint_table import ConstraintTable, Packed

_LAST, _BEFORE = "r[0]", "r[1]"
_OTHERS = 2  # numbers of r before S

#: The largest numbers of rows of constraints (and of points of bodies) and of degrees of freedom for unrolled lines:
#: with more, compilation takes longer than most ensembles. Their states with a rate have room in ``batch()``.
_FEW, _FEW_DEGREES, _FEW_RATES = 8, 24, 96


def is_few(assembly: Assembly) -> bool:
    """Return whether a scene has constraints, and few enough to be unrolled."""
    system = assembly.constraints
    if system is None or system.kinds or assembly.pair_forces:
        return False
    is_small = assembly.size <= _FEW_DEGREES and assembly.n - assembly.own <= _FEW and assembly.n_rates <= _FEW_RATES
    return len(system.names) <= _FEW and is_small


class UnrolledText:
    """A few constraints in the source."""

    def __init__(self, table: ConstraintTable, packed: Packed, place: int) -> None:
        self._axes, self._place = "xyz"[: table.dimension], place
        self._areas, self._at, self._order = packed.areas, packed.begins, packed.order
        self._structure = packed.structure
        self._n, self._rows, self._arms = len(table.weights), range(len(table.rows)), range(len(table.arms))
        places = [*((i, j) for i in self._rows for j in range(self._low(i), i)), *((i, i) for i in self._rows)]
        self._numbers = {place: f"r[{_OTHERS + k}]" for k, place in enumerate(places)}
        self._read: dict[str, str] = {}  # the names of the entries of u and p that were read

    def unrolled(self, forces: Any) -> UnrolledConstraints:
        """Return the lines, for a function of the accelerations without constraints."""
        return UnrolledConstraints(
            forces=forces,
            react=self._text(self._constrain),
            stand=self._text(self._stand),
            approach=self._text(self._approach),
            level=self._text(self._level),
            room=_OTHERS + len(self._numbers),
            structure=self._structure,
        )

    def reactions(self) -> list[str]:
        """Return the lines that write the reactions to `out`."""
        reactions = (f"out[{self._order[k]}] = l{k}" for k in self._rows)
        return ["a = batch()", "forces(t, u, v, p, a[: len(u)])", *self._lines(self._react), *reactions]

    def _lines(self, write: Callable[[], Iterator[str]]) -> list[str]:
        """Return lines that first read all their entries of u and p: they compile in less time."""
        self._read = {}
        lines = [*write()]
        return [*(f"{name} = {entry}" for entry, name in self._read.items()), *lines]

    def _text(self, write: Callable[[], Iterator[str]]) -> str:
        return "\n".join(self._lines(write))

    def _constrain(self) -> Iterator[str]:
        yield from self._react()
        yield from self._push("a", "+")

    def _react(self) -> Iterator[str]:
        """Find the multipliers; they are NaN where the constraints are dependent."""
        yield from self._factors()
        yield from self._sums("e", "v", False)
        for k in self._rows:
            both = self._dot(f"e{self._areas.first_arms[k]}", f"e{self._areas.second_arms[k]}")
            yield f"l{k} = -2 * {self._number('scales', k)} * {both} - {self._along(k, 'a')}"
        yield from self._solve()
        for k in self._rows:
            yield f"l{k} = l{k} if is_sound else nan"

    def _stand(self) -> Iterator[str]:
        yield from self._factors()
        for (i, j), number in self._numbers.items():
            yield f"{number} = {f's{i}_{j}' if i > j else f'r{i}'}"
        yield f"{_LAST}, {_BEFORE} = inf if is_sound else {LOST}, inf"

    def _approach(self) -> Iterator[str]:
        yield f"last, length = {_LAST}, {self._once('p', self._place + LENGTH)}"
        yield from self._inclines()
        yield from self._moved()
        yield "worst = 0.0"
        for k in self._rows:
            both = self._dot(f"e{self._areas.first_arms[k]}", f"e{self._areas.second_arms[k]}")
            yield f"l{k} = {self._number('scales', k)} * ({both} - {self._number('targets', k)})"
            yield f"size = abs(l{k})"
            yield "worst = max(worst, size if size == size else inf)"
        yield f"is_there = worst <= {float(EPS)!r} * length"
        yield f"is_close = worst <= {CLOSE} * length"
        yield f"falls = (worst < 0.5 * last) | (not is_close) & (worst < 0.5 * {_BEFORE})"
        yield "goes_on = (last > 0) & falls & (not is_there)"
        yield f"ended = {CONVERGED} if is_there | is_close else {LOST}"
        yield f"{_LAST}, {_BEFORE} = worst if goes_on else (ended if last > 0 else last), last"
        for (i, j), number in self._numbers.items():
            yield f"{f's{i}_{j}' if i > j else f'r{i}'} = {number}"
        yield from self._solve()
        for k in self._rows:
            yield f"l{k} = l{k} if goes_on else 0.0"
        yield from self._push("x", "-")
        yield "going += 1 if goes_on else 0"

    def _level(self) -> Iterator[str]:
        yield from self._factors()
        for k in self._rows:
            yield f"l{k} = {self._along(k, 'v')}"
        yield from self._solve()
        yield from self._push("v", "-")

    # The parts of these functions

    def _inclines(self) -> Iterator[str]:
        """The gradients in u."""
        yield from self._sums("d", "u", True)
        for k in self._rows:
            for i, ends in self._ends(k).items():
                weight = self._number("weights", i)
                for axis in self._axes:
                    terms = [f"{self._number('parts', e)} * d{arm}_{axis}" for e, arm in ends]
                    yield f"g{k}_{i}_{axis} = {' + '.join(terms)}"
                    yield f"w{k}_{i}_{axis} = {weight} * g{k}_{i}_{axis}"

    def _factors(self) -> Iterator[str]:
        """The gradients in u, and S, factorised as L D L^T; r are the inverses of D."""
        yield from self._inclines()
        yield "is_sound = True"
        for i in self._rows:
            for j in range(self._low(i), i + 1):
                terms = [self._dot(f"w{i}_{mass}", f"g{j}_{mass}") for mass in self._ends(i) if mass in self._ends(j)]
                yield f"s{i}_{j} = {' + '.join(terms) or '0.0'}"
            for j in range(self._low(i), i):
                for k in range(max(self._low(i), self._low(j)), j):
                    yield f"s{i}_{j} -= s{i}_{k} * s{j}_{k}"
            yield f"pivot = s{i}_{i}"
            for j in range(self._low(i), i):
                yield f"part = s{i}_{j}"
                yield f"s{i}_{j} = part * r{j}"
                yield f"pivot -= part * s{i}_{j}"
            yield f"is_regular = pivot > {SINGULAR} * s{i}_{i}"
            yield f"r{i} = 1 / pivot if is_regular else 0.0"
            yield "is_sound = is_sound & is_regular"

    def _solve(self) -> Iterator[str]:
        """Replace l by the solution of S."""
        for i in self._rows:
            for j in range(self._low(i), i):
                yield f"l{i} -= s{i}_{j} * l{j}"
        for i in self._rows:
            yield f"l{i} *= r{i}"
        for i in reversed(self._rows):
            for j in range(self._low(i), i):
                yield f"l{j} -= s{i}_{j} * l{i}"

    def _push(self, x: str, sign: str) -> Iterator[str]:
        for k in self._rows:
            for i in self._ends(k):
                for axis in self._axes:
                    yield f"{self._entry(x, axis, i)} {sign}= w{k}_{i}_{axis} * l{k}"

    def _along(self, k: int, x: str) -> str:
        terms = [f"g{k}_{i}_{axis} * {self._entry(x, axis, i)}" for i in self._ends(k) for axis in self._axes]
        return f"({' + '.join(terms)})"

    def _moved(self) -> Iterator[str]:
        """The arms in u + x."""
        for i in range(self._n):
            for axis in self._axes:
                yield f"{axis}_of_{i} = {self._entry('u', axis, i)} + {self._entry('x', axis, i)}"
        yield from self._arms_of("e", lambda axis, i: f"{axis}_of_{i}", True)

    def _sums(self, name: str, x: str, fixed: bool) -> Iterator[str]:
        return self._arms_of(name, lambda axis, i: self._entry(x, axis, i), fixed)

    def _arms_of(self, name: str, entry: Callable[[str, int], str], fixed: bool) -> Iterator[str]:
        c = self._areas
        for k in self._arms:
            points = range(c.begins[k], c.begins[k + 1])
            for component, axis in enumerate(self._axes):
                terms = [self._number("fixed", k * len(self._axes) + component)] * fixed
                terms += [f"{self._number('factors', q)} * {entry(axis, c.points[q])}" for q in points]
                yield f"{name}{k}_{axis} = {' + '.join(terms) or '0.0'}"

    def _dot(self, x: str, y: str) -> str:
        return f"({' + '.join(f'{x}_{axis} * {y}_{axis}' for axis in self._axes)})"

    def _low(self, i: int) -> int:
        return int(self._areas.lows[i])

    def _ends(self, k: int) -> dict[int, list[tuple[int, int]]]:
        """The masses of a row, each with its entries and their arms."""
        c, found = self._areas, dict[int, list[tuple[int, int]]]()
        for e in range(c.entries[k], c.entries[k + 1]):
            found.setdefault(int(c.entry_points[e]), []).append((e, int(c.entry_arms[e])))
        return found

    def _entry(self, x: str, axis: str, i: int) -> str:
        k = self._axes.index(axis) * self._n + i
        return self._once(x, k) if x == "u" else f"{x}[{k}]"

    def _number(self, area: str, k: int) -> str:
        return self._once("p", getattr(self._at, area) + k)

    def _once(self, array: str, k: int) -> str:
        """Return the name of an entry that is read once before the lines."""
        return self._read.setdefault(f"{array}[{k}]", f"{array}_{k}")
