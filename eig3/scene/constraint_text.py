"""Write the functions of the constraints of a scene as lines of Python source.

In the source, c has the areas of the table of constraints, and row is the index of a row.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from ..kernels import constraints, neighbours
from ..kernels.compile.jit import code_address
from .assembly import Assembly
from .constraint import TINY, Constraint
from .source import Source, Symbols
from .text import Text
from .unrolled_text import UnrolledText, is_few

if TYPE_CHECKING:
    from .constraint_system import ConstraintSystem


class ConstraintText(Text):
    """The constraints of one scene in the source."""

    def __init__(self, assembly: Assembly, source: Source, system: ConstraintSystem) -> None:
        super().__init__(assembly, source)
        self._system, self._d, self._own = system, assembly.dimension, assembly.own
        self._work = assembly.size + assembly.n_rates
        self.place = source.size  # of their table in p
        packed = system.table.packed(self.place)
        source.add(packed.values)
        self._laws = [(source.symbols(law), rows) for law, rows in system.kinds]
        # the place in p of the table index of each row, in the order in which the rows were added
        self._order = source.add(np.argsort(packed.order))
        self.unrolled = UnrolledText(system.table, packed, self.place) if is_few(assembly) else None
        used = ["areas", "STAND", "CONSTRAIN", "REACT", "PROJECT", "CONSTRAINED_STEP", "strike"]
        used += ["PLACE", "sum_up"] * bool(self._laws)
        source.functions |= {"memory": neighbours.memory, "hold": constraints.LIBRARY[system.table.dimension]}
        source.functions |= {name: getattr(constraints, name) for name in used}
        source.functions["code_address"] = code_address
        if self.unrolled:
            source.functions |= {"batch": neighbours.batch, "nan": math.nan, "inf": math.inf}

    def functions(self) -> None:
        """Write all functions except the accelerations without constraints."""
        areas = f"c = areas(memory(p), {self.place})"
        if self._laws:
            with self._function("own(task, t, u, v, p)"):
                self._line(areas)
                self._own_rows()
        with self._function("rhs(t, u, v, p, a)"):
            self._line("forces(t, memory(u), memory(v), p, a)")
            self._line(self._hold("CONSTRAIN", "memory(u), memory(v), memory(a)"))
            self._effort("a")
        with self._function("projection(t, u, v, p)"):
            self._line(self._hold("PROJECT", "memory(u), memory(v), memory(v)"), "return 0.0")
        with self._function("constrained_step(t, h, u, v, drift, p)"):
            self._line(areas, "forces(t, u, v, p, c.forces[:len(u)])")
            self._effort("c.forces", self._hold("REACT", "u, v, c.forces"))
            self._line(self._hold("CONSTRAINED_STEP", "u, v, drift", "h"))
        with self._function("reactions(t, u, v, p, out)"):
            self._line(areas, "forces(t, memory(u), memory(v), p, c.forces[:len(u)])")
            self._line(self._hold("REACT", "memory(u), memory(v), c.forces"))
            with self._block("for row in range(len(out))"):
                self._line(f"out[row] = c.multipliers[index(p[{self._order} + row])]")
            for rows in (rows for law, rows in self._laws if "distance" in law.functions):
                with self._block(f"for k in range({int(rows[0])}, {int(rows[0]) + len(rows)})"):
                    self._line(
                        f"row = index(p[{self._order} + k])", "out[k] *= 2 * c.scales[row] * sqrt(c.targets[row])"
                    )
        if self.unrolled:
            with self._function("reactions_in_lanes(t, u, v, p, out)"):
                self._line(*self.unrolled.reactions())

    def _effort(self, a: str, *react: str) -> None:
        """Add the power of the constraints that depend on the time, in a run that integrates the work."""
        if self._follows_work and self._system.depends_on_time:
            with self._block(f"if len(u) > {self._work}"):
                self._line(f"c = areas(memory(p), {self.place})", *react)
                with self._block("for row in range(len(c.scales))"):
                    self._line(f"{a}[{self._work}] += c.multipliers[row] * c.target_rates[row]")

    def before_impulse(self) -> None:
        """Keep the velocity before an event that changes it."""
        self._line(f"c = areas(memory(p), {self.place})")
        with self._block(f"for k in range({self._d * self._own})"):
            self._line("c.before[k] = v[k]")

    def after_impulse(self, free: str = "-1.0") -> None:
        """Add the impulses of the constraints to the impulse of an event."""
        self._line(f"success = {self._hold('STAND', 'memory(u), v, v')}")
        self._line(f"strike(success, v, {free}, memory(p), {self.place}, {self._d})")

    def _hold(self, task: str, arrays: str, number: str = "0.0") -> str:
        """The call of the kernel function that does a task with the constraints."""
        own = "code_address(own)" if self._laws else "0"
        return f"hold({task}, {own}, t, {number}, {arrays}, memory(p), {self.place})"

    def _own_rows(
        self,
    ) -> None:
        """Write rows that the table cannot describe: targets that depend on the time, and constraints with `phi`."""
        table = self._system.table
        if table.own_arms:
            with self._block("if task != PLACE"):
                self._line(f"sum_up(u, c, {len(table.weights)}, {len(table.arms)}, True, c.arms, {self._d})")
        for law, rows in self._laws:
            self._line(*law.constants("distance", "target", "phi", "gradient"))
            with self._block(f"for s in range({len(rows)})"):
                self._line(f"row = index(p[{self._order + int(rows[0])} + s])")
                if "distance" in law.functions:
                    self._distance(law)
                else:
                    self._phi(law, int(rows[0]))

    def _distance(self, law: Symbols) -> None:
        self._line(f"length, rate, acceleration = {law.call('distance', 's', {'t': 't'})}")
        self._line("c.targets[row] = length * length")
        self._line("c.target_rates[row] = c.scales[row] * 2 * length * rate")
        self._line("c.target_curvatures[row] = 2 * (rate * rate + length * acceleration)")

    def _phi(self, law: Symbols, first: int) -> None:
        """Write the value and the gradient, or the curvature: the change of the gradient along the velocity."""
        assert isinstance(law.effect, Constraint)
        row, period = self._system.table.rows[first], law.effect.period
        if has_target := "target" in law.functions:
            self._line(f"target, rate, acceleration = {law.call('target', 's', {'t': 't'})}")
            self._line("c.target_rates[row] = rate")
        count, arm, slope = len(row.arms), row.arms[0], row.slopes[0]
        axes = range(self._d)
        with self._block("if task == PLACE"):
            for k in range(count):
                self._line(f"x{k} = {self._arm('c.arms', arm + k, count)}")
            self._line(f"c.values[row] = {self._call(law, 'phi', [f'x{k}' for k in range(count)])}")
            self._line(*["c.values[row] -= target"] * has_target)
            if period:
                self._line(f"c.values[row] -= {period!r} * rint(c.values[row] * {1 / period!r})")
            self._gradient(law, count)
            for k in range(count):
                self._line(*(f"c.arms[{self._arm_at(slope + k, count)} + {axis}] = g{k}_{axis}" for axis in axes))
        with self._block("else"):
            self._line("speed = 0.0")
            for k in range(count):
                self._line(f"w{k} = {self._arm('c.rates', arm + k, count)}")
                self._line(*(f"speed = max(speed, abs(w{k}[{axis}]))" for axis in axes))
            self._line(f"step = {float(1e-5 * self._system.table.length)!r} / speed if speed > 0 else 0.0")
            self._line("curvature = 0.0")
            with self._block("for sign in range(-1, 2, 2)"):
                for k in range(count):
                    self._line(f"x{k} = {self._arm('c.arms', arm + k, count, f' + sign * step * w{k}[{{}}]')}")
                self._gradient(law, count)
                along = " + ".join(f"g{k}_{axis} * w{k}[{axis}]" for k in range(count) for axis in axes)
                self._line(f"curvature += sign * ({along})")
            self._line("c.values[row] = curvature / (2 * step) if step > 0 else 0.0")
            self._line(*["c.values[row] -= acceleration"] * has_target)

    def _gradient(self, law: Symbols, count: int) -> None:
        """Write the gradient with respect to the points x0, x1, ..., by the law's function or by imaginary parts."""
        points, axes = range(count), range(self._d)
        if "gradient" in law.functions:
            names = ", ".join(f"g{k}_{axis}" for k in points for axis in axes)
            self._line(f"{names}, = {self._call(law, 'gradient', [f'x{k}' for k in points])}")
            return
        for place in ((k, axis) for k in points for axis in axes):
            moved = [_tuple(f"complex(x{j}[{b}], {TINY if (j, b) == place else 0.0!r})" for b in axes) for j in points]
            self._line(f"g{place[0]}_{place[1]} = complex({self._call(law, 'phi', moved)}).imag / {TINY!r}")

    def _call(self, law: Symbols, function: str, places: list[str]) -> str:
        return law.call(function, "s", {f"x{k}": place for k, place in enumerate(places)})

    def _arm(self, array: str, arm: int, count: int, more: str = "") -> str:
        """The tuple of an arm of the member s, with more in each component."""
        place = self._arm_at(arm, count)
        return _tuple(f"{array}[{place} + {axis}]{more.format(axis)}" for axis in range(self._d))

    def _arm_at(self, arm: int, count: int) -> str:
        """The place of an arm of the first member, and of the same arm of the member s."""
        return f"{arm * self._d} + {count * self._d} * s"


def _tuple(components: Iterable[str]) -> str:
    return f"({', '.join(components)},)"
