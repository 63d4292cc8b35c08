"""Write the functions of a scene with rigid bodies, which call those that know all points as masses.

In the source, `everywhere` and `speeds` are u and v with the points that bodies carry.
"""

from __future__ import annotations

from collections.abc import Iterator

from ..kernels.compile.source import Writer
from .assembly import Assembly
from .constraint_text import ConstraintText
from .packing import Packing, entry
from .text import Text, cross


class BodiesText(Text):
    """The rigid bodies of one scene in the source."""

    def __init__(self, assembly: Assembly, packing: Packing, out: Writer, constraints: ConstraintText) -> None:
        super().__init__(assembly, packing, out)
        self._d, self._own, self._count = assembly.dimension, assembly.own, assembly.n
        self._carried, self._constraints = packing.carried, constraints
        self._work = assembly.size
        self._is_straight = constraints.straight is not None
        self._plates = packing.plates

    @property
    def suffix(self) -> str:
        """The ending of the names of functions that know all points as masses."""
        return "_of_all" if self._carried else ""

    def forces(self) -> None:
        """Gather the accelerations of all points."""
        self._all_points()
        self._line(self._array("acting", 2, "a"), "forces_of_all(t, everywhere, speeds, p, acting)")
        self._gather("acting", "a")

    def plates(self) -> None:
        """Let the vectors along a plate take the force on that across it, which has hardly any mass.

        A force f on the vector e2 = e0 x e1 does the same work as e1 x f on e0 and f x e0 on e1.
        """
        place, vectors = self._plates
        count = len(vectors)
        if self._is_straight:
            for s, (i, j, k) in enumerate(vectors):
                self._plate(f"{i}", f"{j}", f"{k}", f"{s}")
        elif count:
            with self._block(f"for s in range({count})"):
                self._line(*(f"{name} = index({entry('p', place + q * count, 's')})" for q, name in enumerate("ijk")))
                self._plate("i", "j", "k", "s")

    def _plate(self, i: str, j: str, k: str, s: str) -> None:
        place, count = self._plates[0], len(self._plates[1])
        for name, array, vector in (("f", "a", k), ("d", "u", i), ("e", "u", j)):
            self._line(*(f"{name}{axis} = {entry(array, c * self._own, vector)}" for c, axis in enumerate("xyz")))
        for c, axis in enumerate("xyz"):
            for vector, part, force in ((i, 3, cross(axis, "e", "f")), (j, 4, cross(axis, "f", "d"))):
                share = entry("p", place + part * count, s)
                self._line(f"{entry('a', c * self._own, vector)} += {share} * ({force})")
            self._line(f"{entry('a', c * self._own, k)} = 0.0")

    def value(self, call: str) -> None:
        """Return the value of a function of all points."""
        self._all_points()
        self._line(f"return {call}")

    def reset(self, call: str) -> None:
        """Let an event change the velocities and the states, and the constraints take part in its impulse."""
        if self._follows_work:
            self._line("energy_before = energy(t, u, v, p)")
        self._tables()
        self._spread()
        self._line(self._array("before", 2, "v"))
        with self._block("for k in range(len(before))"):
            self._line("before[k] = speeds[k]")
        self._line(call)
        self._constraints.before_impulse()
        self._line(f"free = change(before, speeds, {self._own}, {self._count}, weights, {self._d})")
        self._gather("speeds", "v")
        with self._block(f"for k in range({self._d * self._own})"):
            self._line("v[k] += c.before[k]")
        with self._block(f"for k in range(len(u) - {self._d * self._own})"):
            self._line(f"u[{self._d * self._own} + k] = everywhere[{self._d * self._count} + k]")
        self._constraints.after_impulse("free")
        if self._follows_work:
            with self._block(f"if v.size > {self._work}"):
                self._line(f"v[{self._work}] += energy(t, u, v, p) - energy_before")

    def _all_points(self) -> None:
        """Compute the positions and velocities of all points."""
        if not self._is_straight:
            self._tables()
        self._spread()

    def _spread(self) -> None:
        for k, (array, everything) in enumerate((("u", "everywhere"), ("v", "speeds"))):
            self._line(self._array(everything, k, array))
            if self._is_straight:
                self._straight_spread(array, everything)
            else:
                given = f"{array}, {everything}, {self._own}, {self._count}, begins, parts, factors, {self._d}"
                self._line(f"spread({given})")

    def _tables(self) -> None:
        block = self._carried
        assert block
        self._line("kept = memory(p)")
        self._line(f"begins = integers(kept, {block.begins}, {block.count + 1})")
        self._line(f"parts = integers(kept, {block.parts}, {block.size})")
        self._line(f"factors = floats(kept, {block.factors}, {block.size})")
        self._line(f"weights = floats(kept, {block.weights}, {self._own})")

    def _gather(self, everything: str, x: str) -> None:
        if self._is_straight:
            self._straight_gather(everything, x)
        else:
            given = f"{everything}, {x}, {self._own}, {self._count}, begins, parts, factors, weights, {self._d}"
            self._line(f"gather({given})")

    def _array(self, name: str, k: int, like: str) -> str:
        block, more = self._carried, self._d * (self._count - self._own)
        assert block
        if self._is_straight:
            return f"{name} = batch()[: len({like}) + {more}]"
        return f"{name} = floats(kept, {block.scratch + k * block.degrees}, len({like}) + {more})"

    # The same as `eig3.kernels.bodies`, for few points

    def _straight_spread(self, x: str, everything: str) -> None:
        for axis in range(self._d):
            for i in range(self._own):
                self._line(f"{everything}[{axis * self._count + i}] = {x}[{axis * self._own + i}]")
            for s, parts in enumerate(self._parts()):
                total = " + ".join(f"p[{factor}] * {x}[{axis * self._own + i}]" for factor, i in parts)
                self._line(f"{everything}[{axis * self._count + self._own + s}] = {total}")
        with self._block(f"for k in range(len({x}) - {self._d * self._own})"):
            self._line(f"{everything}[{self._d * self._count} + k] = {x}[{self._d * self._own} + k]")

    def _straight_gather(self, everything: str, x: str) -> None:
        assert self._carried
        for axis in range(self._d):
            for i in range(self._own):
                self._line(f"{x}[{axis * self._own + i}] = {everything}[{axis * self._count + i}]")
            for s, parts in enumerate(self._parts()):
                force = f"{everything}[{axis * self._count + self._own + s}]"
                for factor, i in parts:
                    weight = f"p[{self._carried.weights + i}]"
                    self._line(f"{x}[{axis * self._own + i}] += p[{factor}] * {weight} * {force}")
        with self._block(f"for k in range(len({x}) - {self._d * self._own})"):
            self._line(f"{x}[{self._d * self._own} + k] = {everything}[{self._d * self._count} + k]")

    def _parts(self) -> Iterator[list[tuple[int, int]]]:
        """The carriers of each point, each with the place of its factor in p."""
        assert self._carried
        place = self._carried.factors
        for carriers in self._carried.carriers:
            yield list(enumerate(carriers, place))
            place += len(carriers)
