"""Write the functions of a scene with rigid bodies.

They call functions that treat all points as masses. In the source, `everywhere` and `speeds` are u and v of all
points, including the points that bodies carry.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..kernels import carried_points, neighbours
from .assembly import Assembly
from .constraint_text import ConstraintText
from .source import Source, entry
from .text import Text, cross
from .unrolled_text import is_few


class BodiesText(Text):
    """The rigid bodies of one scene in the source."""

    def __init__(self, assembly: Assembly, source: Source) -> None:
        super().__init__(assembly, source)
        self._d, self._own, self._count = assembly.dimension, assembly.own, assembly.n
        self._work, self._is_unrolled = assembly.size + assembly.n_rates, is_few(assembly)
        self.suffix = "_of_all" if self._count > self._own else ""
        if self.suffix:
            self._pack_carried(assembly)
        cloud = assembly.cloud
        vectors = np.array(cloud.bodies.plates, dtype=np.int64).reshape(-1, 3)
        masses, self._plates = cloud.masses[vectors].T, cloud.free[vectors]
        # the first vectors of all plates, then the second and the third vectors, which are normal to the plates; then
        # the mass of the third vector divided by the masses of the first and of the second
        self._plate_place = source.add(np.concatenate([self._plates.T, masses[2] / masses[:2]]))

    def _pack_carried(self, assembly: Assembly) -> None:
        """Put the table of the points that bodies carry into p, and arrays for all points."""
        cloud, source = assembly.cloud, self._source
        points = [cloud.bodies.carried[point] for point in sorted(cloud.bodies.carried)]
        if not self._is_unrolled:  # unrolled source must not depend on the positions of the points
            points = [(parts[factors != 0], factors[factors != 0]) for parts, factors in points]
        self._carriers = [cloud.free[parts] for parts, _ in points]  # the masses that carry each point
        self._sizes, self._degrees = [len(x) for x in self._carriers], assembly.degrees + assembly.n_rates + 1
        self._begins = source.add(neighbours.as_floats(np.concatenate([[0], np.cumsum(self._sizes)])))
        self._parts = source.add(neighbours.as_floats(np.concatenate(self._carriers)))
        self._factors = source.add(np.concatenate([factors for _, factors in points]))
        self._weights = source.add(1 / cloud.masses[cloud.is_own])
        self._scratch = source.add(np.zeros(3 * self._degrees))
        source.functions |= {name: getattr(neighbours, name) for name in ("memory", "floats", "integers")}
        source.functions |= {name: getattr(carried_points, name) for name in ("spread", "gather", "change")}

    def forces(self) -> None:
        """Gather the accelerations of all points."""
        self._all_points()
        self._line(self._array("acting", 2, "a"), "forces_of_all(t, everywhere, speeds, p, acting)")
        self._gather("acting", "a")

    def plates(self) -> None:
        """Apply the force on the normal of a plate, which has hardly any mass, to the vectors in the plate.

        A force f on the vector e2 = e0 x e1 does the same work as e1 x f on e0 and f x e0 on e1.
        """
        count = len(self._plates)
        if self._is_unrolled:
            for s, (i, j, k) in enumerate(self._plates.tolist()):
                self._plate(f"{i}", f"{j}", f"{k}", f"{s}")
        elif count:
            with self._block(f"for s in range({count})"):
                for q, name in enumerate("ijk"):
                    self._line(f"{name} = index({entry('p', self._plate_place + q * count, 's')})")
                self._plate("i", "j", "k", "s")

    def _plate(self, i: str, j: str, k: str, s: str) -> None:
        place, count = self._plate_place, len(self._plates)
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

    def reset(self, call: str, constraints: ConstraintText) -> None:
        """Let an event change the velocities and the states, with the impulses of the constraints."""
        if self._follows_work:
            self._line("energy_before = energy(t, u, v, p)")
        self._tables()
        self._spread()
        self._line(self._array("before", 2, "v"))
        with self._block("for k in range(len(before))"):
            self._line("before[k] = speeds[k]")
        self._line(call)
        constraints.before_impulse()
        self._line(f"free = change(before, speeds, {self._own}, {self._count}, weights, {self._d})")
        self._gather("speeds", "v")
        with self._block(f"for k in range({self._d * self._own})"):
            self._line("v[k] += c.before[k]")
        with self._block(f"for k in range(len(u) - {self._d * self._own})"):
            self._line(f"u[{self._d * self._own} + k] = everywhere[{self._d * self._count} + k]")
        constraints.after_impulse("free")
        if self._follows_work:
            with self._block(f"if v.size > {self._work}"):
                self._line(f"v[{self._work}] += energy(t, u, v, p) - energy_before")

    def _all_points(self) -> None:
        """Compute the positions and velocities of all points."""
        if not self._is_unrolled:
            self._tables()
        self._spread()

    def _spread(self) -> None:
        for k, (array, everything) in enumerate((("u", "everywhere"), ("v", "speeds"))):
            self._line(self._array(everything, k, array))
            if self._is_unrolled:
                self._unrolled_spread(array, everything)
            else:
                given = f"{array}, {everything}, {self._own}, {self._count}, begins, parts, factors, {self._d}"
                self._line(f"spread({given})")

    def _tables(self) -> None:
        self._line("kept = memory(p)")
        self._line(f"begins = integers(kept, {self._begins}, {len(self._sizes) + 1})")
        self._line(f"parts = integers(kept, {self._parts}, {sum(self._sizes)})")
        self._line(f"factors = floats(kept, {self._factors}, {sum(self._sizes)})")
        self._line(f"weights = floats(kept, {self._weights}, {self._own})")

    def _gather(self, everything: str, x: str) -> None:
        if self._is_unrolled:
            self._unrolled_gather(everything, x)
        else:
            given = f"{everything}, {x}, {self._own}, {self._count}, begins, parts, factors, weights, {self._d}"
            self._line(f"gather({given})")

    def _array(self, name: str, k: int, like: str) -> str:
        more = self._d * (self._count - self._own)
        if self._is_unrolled:
            return f"{name} = batch()[: len({like}) + {more}]"
        return f"{name} = floats(kept, {self._scratch + k * self._degrees}, len({like}) + {more})"

    # The same as `eig3.kernels.carried_points`, for few points

    def _unrolled_spread(self, x: str, everything: str) -> None:
        for axis in range(self._d):
            for i in range(self._own):
                self._line(f"{everything}[{axis * self._count + i}] = {x}[{axis * self._own + i}]")
            for s, parts in enumerate(self._factored()):
                total = " + ".join(f"p[{factor}] * {x}[{axis * self._own + i}]" for factor, i in parts)
                self._line(f"{everything}[{axis * self._count + self._own + s}] = {total}")
        with self._block(f"for k in range(len({x}) - {self._d * self._own})"):
            self._line(f"{everything}[{self._d * self._count} + k] = {x}[{self._d * self._own} + k]")

    def _unrolled_gather(self, everything: str, x: str) -> None:
        for axis in range(self._d):
            for i in range(self._own):
                self._line(f"{x}[{axis * self._own + i}] = {everything}[{axis * self._count + i}]")
            for s, parts in enumerate(self._factored()):
                force = f"{everything}[{axis * self._count + self._own + s}]"
                for factor, i in parts:
                    weight = f"p[{self._weights + i}]"
                    self._line(f"{x}[{axis * self._own + i}] += p[{factor}] * {weight} * {force}")
        with self._block(f"for k in range(len({x}) - {self._d * self._own})"):
            self._line(f"{x}[{self._d * self._own} + k] = {everything}[{self._d * self._count} + k]")

    def _factored(self) -> Iterator[list[tuple[int, int]]]:
        """The carriers of each point, each with the place of its factor in p."""
        place = self._factors
        for carriers in self._carriers:
            yield list(enumerate(carriers.tolist(), place))
            place += len(carriers)
