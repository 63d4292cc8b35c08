"""Write the functions of a scene with rigid bodies, which call those that know all points as masses.

In the source, `everywhere` and `speeds` are u and v with the points that bodies carry.
"""

from __future__ import annotations

from collections.abc import Iterator

from .assembly import Assembly
from .constraint_text import ConstraintText
from .lines import cross, indented
from .packing import Packing, entry


class BodiesText:
    """The rigid bodies of one scene in the source."""

    def __init__(self, assembly: Assembly, packing: Packing, constraints: ConstraintText) -> None:
        self._d, self._own, self._count = assembly.dimension, assembly.own, assembly.n
        self._block, self._constraints = packing.carried, constraints
        self._follows_work, self._work = assembly.follows_work, assembly.size
        self._is_straight = constraints.straight is not None
        self._plates = packing.plates

    @property
    def suffix(self) -> str:
        """The ending of the names of functions that know all points as masses."""
        return "_of_all" if self._block else ""

    def forces(self) -> Iterator[str]:
        """Gather the accelerations of all points."""
        yield from () if self._is_straight else self._tables()
        yield from self._spread("u", "v")
        yield self._array("acting", 2, "a")
        yield "forces_of_all(t, everywhere, speeds, p, acting)"
        yield from self._gather("acting", "a")

    def plates(self) -> Iterator[str]:
        """Let the vectors along a plate take the force on that across it, which has hardly any mass.

        A force f on the vector e2 = e0 x e1 does the same work as e1 x f on e0 and f x e0 on e1.
        """
        place, vectors = self._plates
        count = len(vectors)
        if self._is_straight:
            for s, (i, j, k) in enumerate(vectors):
                yield from self._plate(f"{i}", f"{j}", f"{k}", f"{s}")
        elif count:
            yield f"for s in range({count}):"
            yield from (f"    {name} = index({entry('p', place + q * count, 's')})" for q, name in enumerate("ijk"))
            yield from indented(self._plate("i", "j", "k", "s"))

    def _plate(self, i: str, j: str, k: str, s: str) -> Iterator[str]:
        place, count = self._plates[0], len(self._plates[1])
        for name, array, vector in (("f", "a", k), ("d", "u", i), ("e", "u", j)):
            yield from (f"{name}{axis} = {entry(array, c * self._own, vector)}" for c, axis in enumerate("xyz"))
        for c, axis in enumerate("xyz"):
            for vector, part, force in ((i, 3, cross(axis, "e", "f")), (j, 4, cross(axis, "f", "d"))):
                yield f"{entry('a', c * self._own, vector)} += {entry('p', place + part * count, s)} * ({force})"
            yield f"{entry('a', c * self._own, k)} = 0.0"

    def value(self, call: str) -> Iterator[str]:
        """Return the value of a function of all points."""
        yield from () if self._is_straight else self._tables()
        yield from self._spread("u", "v")
        yield f"return {call}"

    def reset(self, call: str) -> Iterator[str]:
        """Let an event change the velocities and the states, and the constraints take part in its impulse."""
        if self._follows_work:
            yield "energy_before = energy(t, u, v, p)"
        yield from self._tables()
        yield from self._spread("u", "v")
        yield self._array("before", 2, "v")
        yield "for k in range(len(before)):"
        yield "    before[k] = speeds[k]"
        yield call
        yield from self._constraints.before_impulse()
        yield f"free = change(before, speeds, {self._own}, {self._count}, weights, {self._d})"
        yield from self._gather("speeds", "v")
        yield f"for k in range({self._d * self._own}):"
        yield "    v[k] += c.before[k]"
        yield f"for k in range(len(u) - {self._d * self._own}):"
        yield f"    u[{self._d * self._own} + k] = everywhere[{self._d * self._count} + k]"
        yield from self._constraints.after_impulse("free")
        if self._follows_work:
            yield f"if v.size > {self._work}:"
            yield f"    v[{self._work}] += energy(t, u, v, p) - energy_before"

    def _spread(self, *arrays: str) -> Iterator[str]:
        for k, (array, everything) in enumerate(zip(arrays, ("everywhere", "speeds"), strict=False)):
            yield self._array(everything, k, array)
            if self._is_straight:
                yield from self._straight_spread(array, everything)
            else:
                yield f"spread({array}, {everything}, {self._own}, {self._count}, begins, parts, factors, {self._d})"

    def _tables(self) -> Iterator[str]:
        block = self._block
        assert block
        yield "kept = memory(p)"
        yield f"begins = integers(kept, {block.begins}, {block.count + 1})"
        yield f"parts = integers(kept, {block.parts}, {block.size})"
        yield f"factors = floats(kept, {block.factors}, {block.size})"
        yield f"weights = floats(kept, {block.weights}, {self._own})"

    def _gather(self, everything: str, x: str) -> Iterator[str]:
        if self._is_straight:
            yield from self._straight_gather(everything, x)
        else:
            given = f"{everything}, {x}, {self._own}, {self._count}, begins, parts, factors, weights, {self._d}"
            yield f"gather({given})"

    def _array(self, name: str, k: int, like: str) -> str:
        block, more = self._block, self._d * (self._count - self._own)
        assert block
        if self._is_straight:
            return f"{name} = batch()[: len({like}) + {more}]"
        return f"{name} = floats(kept, {block.scratch + k * block.degrees}, len({like}) + {more})"

    # The same as `eig3.kernels.bodies`, for few points

    def _straight_spread(self, x: str, everything: str) -> Iterator[str]:
        for axis in range(self._d):
            for i in range(self._own):
                yield f"{everything}[{axis * self._count + i}] = {x}[{axis * self._own + i}]"
            for s, parts in enumerate(self._parts()):
                total = " + ".join(f"p[{factor}] * {x}[{axis * self._own + i}]" for factor, i in parts)
                yield f"{everything}[{axis * self._count + self._own + s}] = {total}"
        yield f"for k in range(len({x}) - {self._d * self._own}):"
        yield f"    {everything}[{self._d * self._count} + k] = {x}[{self._d * self._own} + k]"

    def _straight_gather(self, everything: str, x: str) -> Iterator[str]:
        assert self._block
        for axis in range(self._d):
            for i in range(self._own):
                yield f"{x}[{axis * self._own + i}] = {everything}[{axis * self._count + i}]"
            for s, parts in enumerate(self._parts()):
                force = f"{everything}[{axis * self._count + self._own + s}]"
                for factor, i in parts:
                    weight = f"p[{self._block.weights + i}]"
                    yield f"{x}[{axis * self._own + i}] += p[{factor}] * {weight} * {force}"
        yield f"for k in range(len({x}) - {self._d * self._own}):"
        yield f"    {x}[{self._d * self._own} + k] = {everything}[{self._d * self._count} + k]"

    def _parts(self) -> Iterator[list[tuple[int, int]]]:
        """The carriers of each point, each with the place of its factor in p."""
        assert self._block
        place = self._block.factors
        for carriers in self._block.carriers:
            yield list(enumerate(carriers, place))
            place += len(carriers)
