"""Write the functions of the constraints of a scene as lines of Python source.

In the source, c are the areas of their table, and row is the number of a row in it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from .assembly import Assembly
from .constraint import TINY
from .lines import indented
from .packing import HeldBlock, Packing, Symbols
from .straight_text import StraightText


class ConstraintText:
    """The constraints of one scene in the source."""

    def __init__(self, assembly: Assembly, packing: Packing) -> None:
        self._d, self._follows_work, self._work = assembly.dimension, assembly.follows_work, assembly.size
        self._n, self._block = assembly.own, packing.held
        few = packing.held if packing.held and packing.held.is_few else None
        self.straight = StraightText(few, assembly.dimension) if few else None

    def functions(self) -> Iterator[tuple[str, Iterable[str]]]:
        """The heads and the bodies of the functions, all but the accelerations that do not know the constraints."""
        if self._block:
            if self._block.own:
                yield "own(task, t, u, v, p)", self._own(self._block)
            yield "rhs(t, u, v, p, a)", self._rhs(self._block)
            yield "projection(t, u, v, p)", self._project(self._block)
            yield "constrained_step(t, h, u, v, drift, p)", self._leap(self._block)
            yield "reactions(t, u, v, p, out)", self._reactions(self._block)
        if self.straight:
            yield "reactions_in_lanes(t, u, v, p, out)", self.straight.reactions()

    def _rhs(self, block: HeldBlock) -> Iterator[str]:
        yield "forces(t, memory(u), memory(v), p, a)"
        yield self._hold(block, "CONSTRAIN", "memory(u), memory(v), memory(a)")
        yield from self._effort(block, "a", ())

    def _effort(self, block: HeldBlock, a: str, react: Iterable[str]) -> Iterator[str]:
        """Add the power of the constraints that depend on the time, in a run that follows the work."""
        if self._follows_work and block.held.depends_on_time:
            yield f"if len(u) > {self._work}:"
            yield f"    c = areas(memory(p), {block.place})"
            yield from indented(react)
            yield "    for row in range(len(c.scales)):"
            yield f"        {a}[{self._work}] += c.multipliers[row] * c.target_rates[row]"

    def _project(self, block: HeldBlock) -> Iterator[str]:
        yield self._hold(block, "PROJECT", "memory(u), memory(v), memory(v)")
        yield "return 0.0"

    def _leap(self, block: HeldBlock) -> Iterator[str]:
        yield f"c = areas(memory(p), {block.place})"
        yield "forces(t, u, v, p, c.forces[:len(u)])"
        yield from self._effort(block, "c.forces", [self._hold(block, "REACT", "u, v, c.forces")])
        yield self._hold(block, "LEAP", "u, v, drift", "h")

    def _reactions(self, block: HeldBlock) -> Iterator[str]:
        yield f"c = areas(memory(p), {block.place})"
        yield "forces(t, memory(u), memory(v), p, c.forces[:len(u)])"
        yield self._hold(block, "REACT", "memory(u), memory(v), c.forces")
        yield "for row in range(len(out)):"
        yield f"    out[row] = c.multipliers[index(p[{block.order} + row])]"

    def before_impulse(self) -> Iterator[str]:
        """Keep the velocity before an event that changes it."""
        if self._block:
            yield f"c = areas(memory(p), {self._block.place})"
            yield f"for k in range({self._d * self._n}):"
            yield "    c.before[k] = v[k]"

    def after_impulse(self, free: str = "-1.0") -> Iterator[str]:
        """Let the constraints take part in the impulse of an event."""
        if self._block:
            yield f"success = {self._hold(self._block, 'STAND', 'memory(u), v, v')}"
            yield f"strike(success, v, {free}, memory(p), {self._block.place}, {self._d})"

    def _hold(self, block: HeldBlock, task: str, arrays: str, number: str = "0.0") -> str:
        """The call of the library that does a task with the constraints."""
        own = "own_address(own)" if block.own else "0"
        return f"hold({task}, {own}, t, {number}, {arrays}, memory(p), {block.place})"

    def _own(self, block: HeldBlock) -> Iterator[str]:
        """Write what the table does not know: targets that depend on the time, and constraints of their own."""
        yield f"c = areas(memory(p), {block.place})"
        table = block.held.table
        if table.own_arms:
            yield "if task != PLACE:"
            yield f"    sum_up(u, c, {len(table.weights)}, {len(table.arms)}, True, c.arms, {self._d})"
        for law, first, count in block.own:
            yield from law.constants("length", "target", "phi", "gradient")
            yield f"for s in range({count}):"
            yield f"    row = index(p[{block.order + first} + s])"
            yield from indented(self._length(law) if "length" in law.functions else self._phi(law, block, first))

    def _length(self, law: Symbols) -> Iterator[str]:
        yield f"length, rate, acceleration = {law.call('length', 's', {'t': 't'})}"
        yield "c.targets[row] = length * length"
        yield "c.target_rates[row] = c.scales[row] * 2 * length * rate"
        yield "c.target_curvatures[row] = 2 * (rate * rate + length * acceleration)"

    def _phi(self, law: Symbols, block: HeldBlock, first: int) -> Iterator[str]:
        """Write the value and the gradient, or the curvature: the change of the gradient along the velocity."""
        row, period = block.held.table.rows[first], block.held.period(first)
        if has_target := "target" in law.functions:
            yield f"target, rate, acceleration = {law.call('target', 's', {'t': 't'})}"
            yield "c.target_rates[row] = rate"
        count, arm, slope = len(row.arms), row.arms[0], row.slopes[0]
        yield "if task == PLACE:"
        for k in range(count):
            yield f"    x{k} = {self._vector('c.arms', arm + k, count)}"
        yield f"    c.values[row] = {self._call(law, 'phi', [f'x{k}' for k in range(count)])}"
        if has_target:
            yield "    c.values[row] -= target"
        if period:
            yield f"    c.values[row] -= {period!r} * rint(c.values[row] * {1 / period!r})"
        yield from indented(self._gradient(law, count))
        for k in range(count):
            for axis in range(self._d):
                yield f"    c.arms[{self._at(slope + k, count)} + {axis}] = g{k}_{axis}"
        yield "else:"
        yield "    speed = 0.0"
        for k in range(count):
            yield f"    w{k} = {self._vector('c.rates', arm + k, count)}"
            for axis in range(self._d):
                yield f"    speed = max(speed, abs(w{k}[{axis}]))"
        yield f"    step = {float(1e-5 * block.held.table.length)!r} / speed if speed > 0 else 0.0"
        yield "    curvature = 0.0"
        yield "    for sign in range(-1, 2, 2):"
        for k in range(count):
            parts = ", ".join(
                f"c.arms[{self._at(arm + k, count)} + {axis}] + sign * step * w{k}[{axis}]" for axis in range(self._d)
            )
            yield f"        x{k} = ({parts},)"
        yield from indented(indented(self._gradient(law, count)))
        along = " + ".join(f"g{k}_{axis} * w{k}[{axis}]" for k in range(count) for axis in range(self._d))
        yield f"        curvature += sign * ({along})"
        yield "    c.values[row] = curvature / (2 * step) if step > 0 else 0.0"
        if has_target:
            yield "    c.values[row] -= acceleration"

    def _gradient(self, law: Symbols, count: int) -> Iterator[str]:
        """Write the gradient with respect to the points x0, x1, ..., by the law's function or by imaginary parts."""
        places = [f"x{k}" for k in range(count)]
        names = ", ".join(f"g{k}_{axis}" for k in range(count) for axis in range(self._d))
        if "gradient" in law.functions:
            yield f"{names}, = {self._call(law, 'gradient', places)}"
            return
        for k in range(count):
            for axis in range(self._d):
                moved = [
                    "("
                    + ", ".join(
                        f"complex({place}[{b}], {TINY if (j, b) == (k, axis) else 0.0!r})" for b in range(self._d)
                    )
                    + ",)"
                    for j, place in enumerate(places)
                ]
                yield f"g{k}_{axis} = complex({self._call(law, 'phi', moved)}).imag / {TINY!r}"

    def _call(self, law: Symbols, function: str, places: list[str]) -> str:
        return law.call(function, "s", {f"x{k}": place for k, place in enumerate(places)})

    def _vector(self, array: str, arm: int, count: int) -> str:
        return "(" + ", ".join(f"{array}[{self._at(arm, count)} + {axis}]" for axis in range(self._d)) + ",)"

    def _at(self, arm: int, count: int) -> str:
        """The place of an arm of the first member, and of the same arm of the member s."""
        return f"{arm * self._d} + {count * self._d} * s"
