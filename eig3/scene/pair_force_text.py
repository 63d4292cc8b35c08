"""Write the loops over the pairs of a neighbour list as lines of Python source.

In the source, point and mate are the places of two points in the list, and i and j the indices of their masses. The
pairs are processed in batches. A first loop collects the pairs within the cutoff without a branch, because the branch
would be unpredictable. Further loops process the collected pairs, with the index q. The compiler vectorises the loop of
the forces if it can.

In a large scene, threads share the points: then the forces are in a separate function.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..kernels import neighbours
from ..kernels.neighbours import BATCH
from ..kernels.shared_forces import ACTING, BUILDING, LISTS, SCANNING, STAGES
from .assembly import Assembly
from .bonds import bonded_pairs
from .pair_force import PairForce, listed
from .placed import Placed
from .source import Source, entry
from .text import BlockText

_ABOVE = "above[point], stops[point]"  # the places of the mates of a point with larger numbers
_VECTOR = 32  # pairs: a multiple of the vector length, and a divisor of BATCH
_ALL_ABOVE = "above[begin], stops[stop - 1]"  # the places for several points


class PairForceText(BlockText):
    """A link between near points in the source.

    Attributes
    ----------
    listing : Listing
    """

    _functions: tuple[str, ...] = ("tension", "force_density")  # of the forces

    def __init__(self, assembly: Assembly, source: Source, pair_force: PairForce, number: int) -> None:
        super().__init__(assembly, source)
        self._law = source.symbols(
            Placed(pair_force.effect, {n: c for n, c in pair_force.columns.items() if len(c) == 1})
        )
        pairs = bonded_pairs(assembly.bonds, pair_force.exclude_bonded)
        u0 = assembly.cloud.in_order(assembly.cloud.positions).T.ravel()
        self.listing = listed(pair_force, source.size, assembly.cloud, u0, pairs)
        source.add(self.listing.values)
        cutoff = self.listing.own.get(pair_force.effect.cutoff_field)
        if cutoff is not None:  # the shares of two points
            source.cutoffs.append((cutoff, cutoff + self.listing.points, 2.0))
        self._pair_force = pair_force
        walls = assembly.supports.of_list(self.listing.fixed)
        self._walls, self._walls_at = walls.size, source.add(neighbours.as_floats(self._n + walls))
        self._speeds_at = source.add(np.zeros((len(self._axes), walls.size)))
        self._number = number  # the number of the list in the scene
        self._first = LISTS + number * STAGES
        used = ("memory", "floats", "integers", "batch", "REFRESH", "SCAN", "BUILD", "REACH")
        source.functions |= {name: getattr(neighbours, name) for name in used}
        source.functions["lists"] = neighbours.LISTS[assembly.dimension]

    def forces(self) -> None:
        if self._source.team is None:
            self._refreshed(*self._functions)
            self._act(lambda: self._on_both("", self._if_mass))
            return
        self._line(f"kept, place = memory(p), int64({self.listing.place})")
        self._at_present()
        velocity = "v" if self._reads_rate else "u"  # a rhs that names v counts as reading it
        given = f"t, memory(u), memory({velocity}), kept, memory(a), place"
        self._line(f"add_forces(share, lists, {self._number}, {given}, {self._source.team})")

    def stages(self) -> None:
        """Do a part of a stage that threads share: the lists of points, or the forces on the points."""
        for stage, task in ((SCANNING, "SCAN"), (BUILDING, "BUILD")) if self._source.team is not None else ():
            with self._block(f"if stage == {self._first + stage}"):
                self._line(f"lists({task}, {self._time}, u, p, int64({self.listing.place}), part, parts)")
        self._acting()

    def _acting(self) -> None:
        """Add the forces on the points of a part."""
        with self._block(f"if stage == {self._first + ACTING}"):
            self._of_part()
            self._part("parts == 1")

    def _of_part(self) -> None:
        """Read the place of the list and the points of the part."""
        self._line(f"kept, place = p, int64({self.listing.place})")
        self._line(f"low, end = bounds(int64({self.listing.masses}), part, parts)")
        self._views(*self._functions)

    def _part(self, only_up: str) -> None:
        """Add the forces on the points of a part: first from points before the part, then from points above.

        One loop does both, because the compiler might round two loops differently. `only_up` is the condition that
        only points above are needed.
        """
        listing = self.listing
        self._line(f"firsts = integers(kept, {listing.areas.first}, {listing.masses})")
        self._line(f"end_of_list = bounds(int64({listing.room}), part, parts)[1]")
        where = f"({_ALL_ABOVE}) if goes_up else (firsts[stop - 1], end_of_list)"
        if self._is_dense:
            before = "(firsts[point], firsts[point - 1] if point > low else end_of_list)"
            where = f"({_ABOVE}) if goes_up else {before}"
        with self._block(f"for goes_up in range(int({only_up}), 2)"):
            self._act(self._on_part, where)

    def _on_part(self) -> None:
        if not self._is_dense:
            self._on_both("point >= low", "mate < end")
            return
        with self._block("if goes_up"):
            self._on_both("", "mate < end")
        with self._block("else"):
            for axis in self._axes:
                self._line(f"{self._at('a', axis, 'i')} += f{axis} * {self._w('i')}")

    def _on_both(self, if_point: str, if_mate: str) -> None:
        """Add a force to the point, and to the mate, each on a condition."""
        with self._only_if(if_point):
            self._on_point()
        with self._only_if(if_mate):
            self._on_mate()

    def _act(self, act: Callable[[], None], where: str = "") -> None:
        """Compute the forces between near points in one loop, and add them in another loop."""

        def pull() -> None:
            self._length(self._reads_rate)
            self._line(f"pulls[q] = ({self._tension}) * inverse")

        def add() -> None:
            self._line("pull = pulls[q]", *(f"f{axis} = pull * d{axis}" for axis in self._axes))
            act()

        self._line("pulls = batch()")
        self._near([pull, add], where)

    def _on_point(self) -> None:
        """Add a force to the point, or to the sum of the point if points have many mates."""
        if self._is_dense:
            self._line(*(f"{axis}_sum += f{axis}" for axis in self._axes))
            return
        self._line(f"i = {self._mass('point')}")
        for axis in self._axes:
            self._line(f"{self._at('a', axis, 'i')} += f{axis} * {self._w('i')}")

    def _on_mate(self) -> None:
        """Add the opposite force to the mate."""
        self._line(f"j = {self._mass('mate')}")
        for axis in self._axes:
            self._line(f"{self._at('a', axis, 'j')} -= f{axis} * {self._w('j')}")

    def potential(self) -> None:
        if "potential" in self._law.functions:
            self._refreshed("potential")
            add = f"total += {self._law.call('potential', '', self._offered)}"
            self._near([lambda: self._line("r = sqrt(tiny + square)", add)])
        if constant := self._pair_force.effect.self_energy(self._pair_force.columns):
            self._line(f"total += p[{self._source.add(np.array(constant))}]")

    def power(self) -> None:
        loses = "potential" not in self._law.functions
        if loses or self._box.shears or self._walls:
            self._refreshed(*self._functions)
            self._near([lambda: self._add_power(loses)])

    def _add_power(self, loses: bool) -> None:
        self._length(True)
        self._line(f"force = {self._tension}", *["total -= force * rate"] * loses)
        self._add_power_from_outside(lambda axis: f"force * inverse * d{axis}")

    def _add_power_from_outside(self, force: Callable[[str], str]) -> None:
        """Add the power of images in a box that shears, and of walls that move, from the force on the point."""
        if self._box.shears:
            self._line(f"fx = {force('x')}", *self._box.power())
        if self._walls:
            with self._block(f"if mate >= {self.listing.masses}"):
                for c, axis in enumerate(self._axes):
                    self._line(f"total += ({force(axis)}) * {self._speed_of_wall(c, 'mate', self.listing.masses)}")

    def _at_present(self) -> None:
        """Write where the fixed points of the list are, and their velocities, if a motion moves one of them."""
        if not self._walls:
            return
        d, first = len(self._axes), self.listing.areas.x + len(self._axes) * self.listing.masses
        self._line(f"walls = integers(kept, {self._walls_at}, {self._walls})")
        with self._block(f"for k in range({self._walls})"):
            for name, array in (("place", "u"), ("speed", "v")):
                values = ", ".join(f"wall_{name}_{axis}" for axis in self._axes)
                self._line(f"{values}, = corner_{name}(t, {array}, p, index(walls[k]))")
            for c, axis in enumerate(self._axes):
                self._line(f"{entry('kept', first + c, f'{d} * k')} = wall_place_{axis}")
                self._line(f"{self._speed_of_wall(c, 'k')} = wall_speed_{axis}")

    def _speed_of_wall(self, c: int, wall: str, first: int = 0) -> str:
        return entry("kept", self._speeds_at + c * self._walls - first, wall)

    def _refreshed(self, *functions: str) -> None:
        """Refresh the list, and read the values that all pairs share."""
        self._line(f"kept, place = memory(p), int64({self.listing.place})")
        self._at_present()
        self._line(f"lists(REFRESH, {self._time}, memory(u), kept, place, place, place)")
        self._views(*functions)

    def _views(self, *functions: str) -> None:
        """Read the place of the list, and the values that all pairs share."""
        listing, areas = self.listing, self.listing.areas
        self._line(f"places = floats(kept, {areas.x}, {len(self._axes) * listing.points})")
        for name, area in (("above", areas.above), ("stops", areas.stop)):
            self._line(f"{name} = integers(kept, {area}, {listing.masses})")
        for name, area in (("mates", areas.mates), ("owners", areas.owners)):
            self._line(f"{name} = integers(kept, {area}, {listing.room})")
        self._line(*(f"{name} = batch()" for name in ("squares", "some", *self._ways.values())))
        self._line(f"near_points = integers(some, 0, {BATCH})")
        self._line(f"near_mates = integers(some, {BATCH // 2}, {BATCH})")
        if listing.begin < 0:
            self._line(f"indices = integers(kept, {areas.number}, {listing.masses})")
        self._line(*self._law.constants(*functions))

    @property
    def _time(self) -> str:
        return "t" if self._box.shears else "0.0"

    @property
    def _ways(self) -> dict[str, str]:
        """The components of the vector between two points that are kept, and the names of their batches."""
        ways = {f"d{axis}": f"{axis}_ways" for axis in self._axes}
        return ways | ({"turns": "y_turns"} if self._box.shears else {})

    def _near(self, loops: Sequence[Callable[[], None]], where: str = "") -> None:
        """Do loops over the pairs within the cutoff. The last of two adds forces, to sums for a point with many mates.

        `where` gives the places of the pairs in the list. If the pairs exceed the capacity of the list, it has the
        pairs of a few points at a time.
        """
        low, end = ("low", "end") if self._source.is_of_part else ("int64(0)", f"int64({self.listing.masses})")
        self._line(f"stop = index({low})")
        with self._block(f"while stop < {end}"):
            self._line(f"begin, stop = stop, index(lists(REACH, 0.0, kept, kept, place, stop, index({end})))")
            if not self._is_dense:
                self._batches(loops, where or _ALL_ABOVE)
                return
            sums = [f"{axis}_sum" for axis in self._axes if len(loops) > 1]
            with self._block("for point in range(begin, stop)"):
                self._line(f"i = {self._mass('point')}")
                self._here()
                self._line(*[f"{' = '.join(sums)} = 0.0"] * bool(sums))
                self._batches(loops, where or _ABOVE)
                self._line(*(f"{self._at('a', total[0], 'i')} += {total} * {self._w('i')}" for total in sums))

    def _batches(self, loops: Sequence[Callable[[], None]], where: str) -> None:
        """Collect the pairs within the cutoff from a part of the list, and do loops over them."""
        has_points = not self._is_dense
        kept = {"near_mates": "mate", "squares": "square"} | {batch: value for value, batch in self._ways.items()}
        kept |= {"near_points": "point"} if has_points else {}
        self._line(f"low_pair, high_pair = {where}")
        with self._block(f"for low_of_batch in range(low_pair, high_pair, {BATCH})"):
            self._line("near = int64(0)")
            with self._block(f"for e in range(low_of_batch, min(low_of_batch + {BATCH}, high_pair))"):
                self._pair()
                self._line(*(f"{batch}[near] = {value}" for batch, value in kept.items()))
                self._line(f"near += {self._is_near}")
            for number, loop in enumerate(loops):
                is_last = number == len(loops) - 1
                if not is_last:
                    self._padded([*kept])
                with self._block(f"for q in range({'near' if is_last else 'filled'})"):
                    self._line(*["point = index(near_points[q])"] * has_points)
                    self._line("mate, square = index(near_mates[q]), squares[q]")
                    self._line(*(f"{value} = {batch}[q]" for value, batch in self._ways.items()))
                    loop()

    def _padded(self, batches: Sequence[str]) -> None:
        """Repeat the last pair to fill whole vectors.

        Otherwise scalar code would compute the remainder and may round differently: a force would depend on the place
        of its pair in a batch.
        """
        self._line(f"filled = (near + {_VECTOR - 1}) & {-_VECTOR}")
        with self._block("for q in range(near, filled)"):
            self._line(*(f"{batch}[q] = {batch}[near - 1]" for batch in batches))

    def _here(self) -> None:
        self._line(*(f"{axis}_here = {self._place('point', axis)}" for axis in self._axes))

    def _pair(self) -> None:
        """Read a pair of the list, and compute the vector from the point to its mate, and its squared length.

        The point has the smaller number unless the loop is over the points.
        """
        self._line("mate = index(mates[e])")
        if not self._is_dense:
            self._line("point = index(owners[e])")
            if self._source.is_of_part:
                self._line("point, mate = min(point, mate), max(point, mate)")
            self._here()
        self._line(*(f"d{axis} = {self._place('mate', axis)} - {axis}_here" for axis in self._axes))
        self._line(*self._box.nearest())
        self._line(f"square = {' + '.join(f'd{axis} * d{axis}' for axis in self._axes)}")

    @property
    def _is_near(self) -> str:
        """The condition that two points are within the cutoff."""
        name = self._law.effect.cutoff_field
        cutoff = self._law.value(name, "") if name in self._law.columns else self._field(name)
        return f"square < {cutoff} * {cutoff}"

    def _length(self, reads_rate: bool) -> None:
        """Compute the distance of two points, and its rate."""
        self._line("r = sqrt(tiny + square)", "inverse = 1 / r")
        if reads_rate:
            self._line(f"i = {self._mass('point')}")
            self._line(f"{' = '.join(f'e{axis}' for axis in self._axes)} = 0.0")
            with self._only_if(self._if_mass):
                self._line(f"j = {self._mass('mate')}")
                self._line(*(f"e{axis} = {self._at('v', axis, 'j')}" for axis in self._axes))
            if self._walls:
                with self._block("else"):
                    for c, axis in enumerate(self._axes):
                        self._line(f"e{axis} = {self._speed_of_wall(c, 'mate', self.listing.masses)}")
            # with the point's velocity first, vector code and scalar code would round differently
            self._line(*(f"e{axis} -= {self._at('v', axis, 'i')}" for axis in self._axes))
            self._line(*self._box.rate())
            self._line(f"rate = ({' + '.join(f'd{axis} * e{axis}' for axis in self._axes)}) * inverse")

    @property
    def _if_mass(self) -> str:
        """The condition that the mate is a mass, if the pair_force has fixed points."""
        listing = self.listing
        return "" if listing.points == listing.masses else f"mate < {listing.masses}"

    @property
    def _is_dense(self) -> bool:
        """Whether the loop is over the points, and for each point over its mates, because points have many mates."""
        return self.listing.is_dense

    @property
    def _tension(self) -> str:
        law, offered = self._law, self._offered
        terms = [law.call("tension", "", offered)] if "tension" in law.functions else []
        terms += [f"{law.call('force_density', '', offered)} * r"] if "force_density" in law.functions else []
        return " + ".join(terms)

    @property
    def _reads_rate(self) -> bool:
        return self._law.reads("rate", "tension", "force_density")

    @property
    def _offered(self) -> dict[str, str]:
        offered = {"t": "t", "r": "r", "rate": "rate"}
        return offered | {name: self._field(name) for name in self.listing.own}

    def _field(self, name: str) -> str:
        place, operator = self.listing.own[name], self._pair_force.operator(name)
        return f"({entry('p', place, 'point')} {operator} {entry('p', place, 'mate')})"

    def _place(self, point: str, axis: str) -> str:
        d = len(self._axes)
        return entry("places", self._axes.index(axis), point if d == 1 else f"{d} * {point}")

    def _mass(self, place: str) -> str:
        begin = self.listing.begin
        return f"{begin} + {place}" if begin > 0 else place if begin == 0 else f"index(indices[{place}])"
