"""Write the functions of a scene with rigid bodies, which call those that know all points as masses.

In the source, `everywhere` and `speeds` are u and v with the points that bodies carry.
"""

from __future__ import annotations

from collections.abc import Iterator

from .assembly import Assembly
from .constraint_text import ConstraintText
from .packing import Packing


class BodiesText:
    """The rigid bodies of one scene in the source."""

    def __init__(self, assembly: Assembly, packing: Packing, constraints: ConstraintText) -> None:
        self._d, self._own, self._count = assembly.dimension, assembly.own, assembly.n
        self._block, self._constraints = packing.carried, constraints
        self._follows_work, self._work = assembly.follows_work, assembly.size

    @property
    def suffix(self) -> str:
        """The ending of the names of functions that know all points as masses."""
        return "_of_all" if self._block else ""

    def forces(self) -> Iterator[str]:
        """Gather the accelerations of all points."""
        yield from self._spread("u", "v")
        yield self._array("acting", 2, "a")
        yield "forces_of_all(t, everywhere, speeds, p, acting)"
        yield self._gather("acting", "a")

    def value(self, call: str) -> Iterator[str]:
        """Return the value of a function of all points."""
        yield from self._spread("u", "v")
        yield f"return {call}"

    def reset(self, call: str) -> Iterator[str]:
        """Let an event change the velocities and the states, and the constraints take part in its impulse."""
        if self._follows_work:
            yield "energy_before = energy(t, u, v, p)"
        yield from self._spread("u", "v")
        yield self._array("before", 2, "v")
        yield "for k in range(len(before)):"
        yield "    before[k] = speeds[k]"
        yield call
        yield from self._constraints.before_impulse()
        yield f"free = change(before, speeds, {self._own}, {self._count}, weights, {self._d})"
        yield self._gather("speeds", "v")
        yield f"for k in range({self._d * self._own}):"
        yield "    v[k] += c.before[k]"
        yield f"for k in range(len(u) - {self._d * self._own}):"
        yield f"    u[{self._d * self._own} + k] = everywhere[{self._d * self._count} + k]"
        yield from self._constraints.after_impulse("free")
        if self._follows_work:
            yield f"if v.size > {self._work}:"
            yield f"    v[{self._work}] += energy(t, u, v, p) - energy_before"

    def _spread(self, *arrays: str) -> Iterator[str]:
        block = self._block
        assert block
        yield "kept = memory(p)"
        yield f"begins = integers(kept, {block.begins}, {block.count + 1})"
        yield f"parts = integers(kept, {block.parts}, {block.size})"
        yield f"factors = floats(kept, {block.factors}, {block.size})"
        yield f"weights = floats(kept, {block.weights}, {self._own})"
        for k, (array, everything) in enumerate(zip(arrays, ("everywhere", "speeds"), strict=False)):
            yield self._array(everything, k, array)
            yield f"spread({array}, {everything}, {self._own}, {self._count}, begins, parts, factors, {self._d})"

    def _gather(self, everything: str, x: str) -> str:
        given = f"{everything}, {x}, {self._own}, {self._count}, begins, parts, factors, weights, {self._d}"
        return f"gather({given})"

    def _array(self, name: str, k: int, like: str) -> str:
        block = self._block
        assert block
        more = self._d * (self._count - self._own)
        return f"{name} = floats(kept, {block.scratch + k * block.degrees}, len({like}) + {more})"
