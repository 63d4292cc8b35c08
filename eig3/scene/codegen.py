"""Write the code of a scene as Python source, with a loop for each group of effects, and compile it with Numba.

Source has three advantages over closures. Users can read the code with `inspect.getsource`. Effects on the same points
share common values, such as a distance. Scenes of the same structure share one compiled function, because parameters
are not part of the source.

In the source, i and j are indices of masses, and w is an inverse mass.

The events of a group are two functions: one whose zeros are the events, and one that changes the state. Their first
argument is the number of the member, as a float.
"""

from __future__ import annotations

import functools
import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

import numpy as np

from ..functions.callbacks import jit
from ..functions.companions import Angles, Constraints, Cutoffs, HistoryVariables
from ..functions.events import EffectEvent, Event
from ..functions.families import Family
from ..functions.records import Records
from ..kernels import team
from ..kernels.compile.jit import code_address, with_symbol
from ..kernels.compile.source import define
from ..kernels.constraints import FUNCTION_OF_SCENE
from ..kernels.neighbours import bounds, memory
from ..kernels.protocol import index
from ..kernels.shared_forces import OWN, add_forces, advance_springs, set_forces
from ..stepping.team import Shares
from .assembly import STATE, Assembly
from .bodies_text import BodiesText
from .constraint_text import ConstraintText
from .effect import FORCES, JUMPING, RESETS, Effect
from .frictional_contact import FrictionalContact
from .grains_text import GrainsText
from .group_text import MassesText
from .lattice_sum import LatticeSum
from .lattice_sum_text import LatticeSumText
from .links_text import LinksText
from .mesh_text import MeshText, SupportsText
from .pair_force_text import PairForceText
from .source import Source, Symbols, tables
from .text import BlockText, Text, added

#: Least numbers of near points, and of cells, for threads. Links are not shared between threads: the force of a link
#: takes less time than another core needs to fetch its ends, which the thread of the run has just moved.
_SHARED, _SHARED_CELLS = 2000, 5000

# added under a root to avoid a division by 0 where points coincide; too small to change other values
_TINY = 2.0**-1000

G = TypeVar("G", MassesText, LinksText)


@jit
def unchanged(t, u, v, p):  # type: ignore[no-untyped-def]
    """Keep the state: the reset of a force that changes its form. The event makes the method restart."""


def _meeting(assembly: Assembly) -> np.ndarray:
    """Return the coordinates of the masses on which forces with a cutoff, or impacts, act."""
    masses = []
    for group in assembly.links:
        if any(law.effect.cutoff_field for law in group.laws):
            masses += [group.first] if group.second is None else [group.first, group.second]
    for pair_force in assembly.pair_forces:
        free = assembly.cloud.free[np.concatenate([pair_force.first, pair_force.second])]
        masses.append(free[free >= 0])
    first = assembly.n * np.arange(assembly.dimension)
    return np.add.outer(first, np.unique(np.concatenate(masses))).ravel()


def compiled(assembly: Assembly, threads: int | None = None) -> dict[str, Any]:
    """Return the arguments of `Problem` from a scene's code: rhs, energy, events, outputs and params.

    Scenes that differ only in parameters get the same functions. The code of a large scene uses `threads`, if given.
    """
    source = Source(assembly)
    writing = _Functions(assembly, source, threads)
    writing.parts()
    if assembly.follows_work:
        writing.power()
    writing.rhs()
    if assembly.follows_work or assembly.is_conservative:
        writing.energy()
    if writing.grains:
        writing.history()
    writing.events()
    writing.angles()
    text, names = source.named()
    functions = _functions(text, tuple(names.items()))
    if source.team is not None:
        functions["rhs"].py_func.shares = Shares(functions["share"], source.team, assembly.n)
    if source.records:
        functions["rhs"].py_func.records = Records(functools.partial(tables, tuple(source.records)), lasts=True)
    is_of_points = assembly.dimension > 1 and not assembly.cloud.bodies.vectors  # on a line, none passes another
    if source.cutoffs and is_of_points:
        degrees = assembly.n * assembly.dimension
        functions["rhs"].py_func.cutoffs = Cutoffs(degrees, tuple(source.cutoffs), _meeting(assembly))
    if writing.jumping:
        functions["rhs"].py_func.angles = writing.angles_of(functions)
    functions["rhs"].py_func.reads_time = assembly.depends_on_time  # the code passes t on, and grains read differences
    functions["rhs"].py_func.left_out = np.array(source.left_out, dtype=int)
    if assembly.constraints:
        functions["rhs"].py_func.constraints = writing.constraints_of(functions)
    if writing.grains:
        places = tuple(text.springs for text in writing.grains)
        functions["rhs"].py_func.history = HistoryVariables(functions["begin"], functions["advance"], places)
    if assembly.rates:
        for name in functions.keys() & {"rhs", "energy", "reactions"}:
            functions[name].py_func.reads_z = True  # it takes first-order unknowns in the form of kernels
    reactions = assembly.constraints
    units = tuple(reactions.units) if reactions else ()
    return {
        "rhs": functions["rhs"],
        "energy": functions.get("energy"),
        "events": writing.events_of(functions, assembly.events),
        "outputs": {"reactions": (functions["reactions"], reactions.rows)} if reactions else {},
        "output_units": {"reactions": units[0] if len({*units}) == 1 else units} if reactions else {},
        "params": source.params,
    }


@functools.lru_cache(maxsize=256)
def _functions(text: str, names: tuple[tuple[str, Any], ...]) -> dict[str, Any]:
    known = {"__name__": __name__, "sqrt": math.sqrt, "rint": np.rint, "tiny": _TINY, "index": index, "jit": jit}
    known["int64"] = np.int64  # turns a literal into a number: Numba compiles a function again for each literal
    functions = define(text, "scene", {**known, **dict(names)})
    for name, signature in (("own", FUNCTION_OF_SCENE), ("share", team.SHARE)):
        if name in functions:
            with_symbol(functions[name], signature)
    return functions


@functools.lru_cache(maxsize=256)
def _members(function: Any, count: int) -> list[Any]:
    return Family(function, count).members


class _Functions(Text):
    """Writes the functions of one scene.

    Attributes
    ----------
    grains : list of GrainsText
    """

    def __init__(self, assembly: Assembly, source: Source, threads: int | None) -> None:
        super().__init__(assembly, source)
        self._coordinates = assembly.coordinates
        self._n_states = assembly.degrees
        self._work = self._n_states + assembly.n_rates  # the index of the degree of freedom whose velocity is the work
        on_masses = [MassesText(assembly, source, group) for group in assembly.on_masses]
        links = [LinksText(assembly, source, group) for group in assembly.links]
        self._on_masses, self._links = _acting(on_masses), _acting(links)
        self._moving = {number for links in self._links for number in links.group.motions}  # the motions of supports
        self._meshes = [MeshText(assembly, source, mesh) for mesh in assembly.meshes]
        self._with_states: list[Any] = [*on_masses, *links, *self._meshes]  # the groups that can have states and events
        self._supports = SupportsText(assembly, source) if assembly.supports.positions.size else None
        pair_forces = sorted(
            assembly.pair_forces, key=lambda pair_force: isinstance(pair_force.effect, FrictionalContact)
        )
        near: list[PairForceText] = [
            _text_of(pair_force.effect)(assembly, source, pair_force, number)
            for number, pair_force in enumerate(pair_forces)
        ]
        self._near, self.grains = near, [text for text in near if isinstance(text, GrainsText)]
        self._blocks: list[BlockText] = [*self._on_masses, *self._links, *self._meshes, *near]
        self._bodies_text = BodiesText(assembly, source)
        self._constraints = ConstraintText(assembly, source, assembly.constraints) if assembly.constraints else None
        self._shares_cells = threads is not None and sum(mesh.size for mesh in self._meshes) >= _SHARED_CELLS
        is_large = threads is not None and any(text.listing.masses >= _SHARED for text in near)
        if is_large or self._shares_cells:
            source.team = source.add(np.array([0, 0, threads]))
            source.functions |= {"set_forces": set_forces, "add_forces": add_forces}
            source.functions |= {"advance_springs": advance_springs, "memory": memory}
        self._has_stages = source.team is not None or bool(self.grains)
        if self._has_stages:
            source.functions |= {"bounds": bounds, "share_at": team.share_at, "code_address": code_address}
        self._suffix = self._bodies_text.suffix
        self._rhs_name = f"forces{self._suffix}" if assembly.constraints else "rhs"
        self._own_masses = assembly.own
        vectors = [assembly.cloud.free[i] for i in assembly.cloud.bodies.vectors if assembly.cloud.is_own[i]]
        self._turning = np.add.outer(assembly.own * np.arange(assembly.dimension), vectors).astype(int).ravel()
        self._occurring: list[Symbols] = []  # the laws with events, by the number in the names of their functions
        self.jumping = [mesh for mesh in self._meshes if mesh.having(JUMPING)]

    # The functions

    def constraints_of(self, functions: dict[str, Any]) -> Constraints:
        """Return the constraints from the compiled functions; few of them also as lines for lanes."""
        text, unrolled = self._constraints, None
        assert text
        if text.unrolled:
            functions["reactions"].py_func.in_lanes = functions["reactions_in_lanes"]
            unrolled = text.unrolled.unrolled(functions["forces"])
        return Constraints(functions["projection"], functions["constrained_step"], text.place, unrolled)

    def parts(self) -> None:
        """Write the functions that others call: the positions of the corners of cells, and the work of threads."""
        if self._supports:
            self._supports.functions()
        if self._has_stages:
            with self._function("share(stage, part, parts, t, u, v, p, a)", self._moving):
                self._source.is_of_part = True
                if self._shares_cells:
                    with self._block(f"if stage == {OWN}"):
                        self._forces_on_part()
                for near in self._near if self._source.team is not None else self.grains:
                    near.stages()
                self._source.is_of_part = False

    def rhs(self) -> None:
        """Write the function of the accelerations."""
        with self._function(f"{self._rhs_name}(t, u, v, p, a)", self._moving):
            if self._shares_cells:
                velocity = "v" if self._reads_v else "u"  # a rhs that names v counts as reading it
                given = f"t, memory(u), memory({velocity}), memory(p), memory(a), {self._source.team}"
                self._line(f"set_forces(share, {given})")
            else:
                self._forces()
            if self._spins:
                begin = self._n * len(self._axes)
                with self._block(f"for k in range({begin}, {begin + self._n * len(self._spins)})"):
                    self._line("a[k] = 0.0")
            for near in self._near:
                near.forces()
            if self._n_states > self._coordinates:
                with self._block(f"for k in range({self._coordinates}, {self._n_states})"):
                    self._line("a[k] = 0.0")
            for group in self._with_states:
                group.rates()
            if self._follows_work:
                with self._block(f"if a.size > {self._work}"):  # a run that integrates the work
                    self._line(f"a[{self._work}] = power(t, u, v, p)")
            if not self._suffix:
                self._bodies_text.plates()
        if self._suffix:
            with self._function("forces(t, u, v, p, a)"):
                self._bodies_text.forces()
                self._bodies_text.plates()
        if self._constraints:
            self._constraints.functions()

    def power(self) -> None:
        """Write the function of the power of the effects without a potential and of the supports."""
        with self._function("power(t, u, v, p)", self._moving):
            self._line("total = 0.0")
            for masses in self._on_masses:
                masses.power()
            for links in self._links:
                links.power()
            for links in self._links:
                links.power_of_supports()
            for links in self._links:
                links.power_of_images()
            for block in (*self._meshes, *self._near):
                block.power()
            self._line("return total")

    def energy(self) -> None:
        """Write the function of the kinetic energy and the potentials, minus the work in a run that integrates it."""
        with self._function(f"energy{self._suffix}(t, u, v, p)", self._moving):
            self._line("total = 0.0")
            if self._follows_work:
                with self._block(f"if v.size > {self._work}"):
                    self._line(f"total -= v[{self._work}]")
            with self._masses(0, self._own_masses) as i:
                speeds = [self._at("v", axis, i) for axis in self._axes]
                self._line(f"total += {added([f'{v} * {v}' for v in speeds])} / (2 * {self._w(i)})")
            for block in self._blocks:
                block.potential()
            if self._spins:
                square = " + ".join(f"{self._spin('v', axis, 'i')} ** 2" for axis in self._spins)
                with self._block(f"for i in range({self._n})"), self._block(f"if {self._t('i')} > 0"):
                    self._line(f"total += ({square}) / (2 * {self._t('i')})")
            self._line("return total")
        if self._suffix:
            with self._function("energy(t, u, v, p)"):
                self._bodies_text.value("energy_of_all(t, everywhere, speeds, p)")

    def history(self) -> None:
        """Write the functions of the springs between grains."""
        with self._function("advance(t, u, v, p)"):
            for text in self.grains:
                text.advance()
            self._line("return 0.0")
        with self._function("begin(t, u, v, p)"):
            for text in self.grains:
                text.begin()
            self._line("advance(t, u, v, p)", "return 0.0")

    def events(self) -> None:
        """Write the two functions of the events of each effect on a group."""
        for group in self._with_states:
            for law in group.having("event"):
                one, k = group.of_laws([law]), len(self._occurring)
                self._event(one, f"event_{k}")
                if any(name in law.functions for name in RESETS):
                    self._reset(one, f"reset_{k}")
                self._occurring.append(law)

    def events_of(self, functions: dict[str, Any], names: list[str]) -> dict[str, Event]:
        """Return the events by these names, from the compiled functions."""
        found: dict[str, Event] = {}
        for k, law in enumerate(self._occurring):
            count, changes = law.events.size, any(name in law.functions for name in FORCES)
            effect = law.effect
            g, apply = _members(functions[f"event_{k}"], count), [unchanged if changes else None] * count
            if f"reset_{k}" in functions:
                apply = _members(functions[f"reset_{k}"], count)
            rule = effect.rule, effect.turns, {*law.functions} & {*RESETS} == {"state_after"}
            for s, number in enumerate(law.events):
                found[names[number]] = EffectEvent(g[s], effect.crossing, False, apply[s], *rule)
        return {name: found[name] for name in names}  # in the order in which the effects were added

    def angles(self) -> None:
        """Write the function of the angles of the laws whose torque may jump at half a turn."""
        if self.jumping:
            with self._function(f"angles{self._suffix}(t, u, v, p, a)"):
                for k, mesh in enumerate(self.jumping):
                    mesh.angles(sum(other.size for other in self.jumping[:k]))
            if self._suffix:
                with self._function("angles(t, u, v, p, a)"):
                    self._bodies_text.value("angles_of_all(t, everywhere, speeds, p, a)")

    def angles_of(self, functions: dict[str, Any]) -> Angles:
        """Return the names and the function of these angles, and the degrees of freedom that show how bodies turn."""
        counts: Counter[str] = Counter()
        names = []
        for mesh in self.jumping:
            title = mesh.laws[0].effect.title
            names += [f"{title} {counts[title] + k}" for k in range(mesh.size)]
            counts[title] += mesh.size
        return Angles(self._turning, tuple(names), functions["angles"])

    # The parts of these functions

    def _forces(self) -> None:
        """Set all accelerations, from all forces except forces between near points."""
        on_all, others = self._by_extent()
        rows = [links for links in self._links if links.is_row and len(links.runs) == 1 and links.size > 1]
        row = max(rows, key=lambda links: links.size, default=None)
        holding = [links for links in self._links if row and links.holds_end(row)]
        self._every_mass(on_all, row, holding)
        for block in others:
            if block is not row and block not in holding:
                block.forces()

    def _forces_on_part(self) -> None:
        """Set the accelerations of the masses of a part. A force on masses of two parts is computed in both."""
        begin = len(self._source.lines)
        on_all, others = self._by_extent()
        self._line(f"low, end = bounds(int64({self._n}), part, parts)")
        for masses in on_all:
            masses.constants(*masses.FORCES)
        with self._block("for i in range(low, end)"):
            self._set(on_all, "i")
        for block in others:
            block.forces()
        self._reads_v = any(re.search(r"\bv\b", line) for line in self._source.lines[begin:])

    def _every_mass(self, on_all: list[MassesText], row: LinksText | None, holding: list[LinksText]) -> None:
        """Set all accelerations, from the effects on all masses and, in the same loop, the longest row of links.

        Along a row, the force of each link is kept for the next link, which shares a mass with it. `holding` has the
        links from supports to the first and last mass of the row.
        """
        start, stop = (row.runs[0, 2], row.runs[0, 2] + row.size + 1) if row else (self._n, self._n)
        for masses in on_all:
            masses.constants(*masses.FORCES)
        if row:
            row.constants(*row.FORCES)
        for first, last in ((0, start), (stop, self._n)):
            if first < last:
                with self._masses(first, last) as i:
                    self._set(on_all, i)
        if row:
            row.before()
            self._hold(holding, start)
            with self._block(f"for s in range({row.size})"):
                self._line(f"i, j = {start} + s, {start + 1} + s")
                row.separation("s", "i", "j")
                row.pull("s", "i", "j", self._common)
                self._set(on_all, "i", lambda axis: f"f{axis} - {axis}_before")
                row.keep()
            self._hold(holding, stop - 1)
            self._set(on_all, str(stop - 1), lambda axis: f"-{axis}_before")

    def _hold(self, holding: list[LinksText], mass: int) -> None:
        for links in (links for links in holding if links.group.first[0] == mass):
            with links.members(*links.FORCES) as (s, i, j):
                links.separation(s, i, j)
                links.pull(s, i, j, self._common)
            self._line(*(f"{axis}_before += f{axis}" for axis in self._axes))

    @contextmanager
    def _masses(self, first: int, stop: int) -> Iterator[str]:
        """Write a loop over masses; give the name of the index."""
        if stop - first == 1:
            yield str(first)
        else:
            with self._block(f"for i in range({first}, {stop})"):
                yield "i"

    def _set(self, on_all: list[MassesText], i: str, pull: Callable[[str], str] | None = None) -> None:
        accelerations: list[str] = []
        forces: list[str] = []
        for masses in on_all:
            given = masses.given(i, i)
            accelerations += given[0]
            forces += given[1]
        for axis in self._axes:
            pulls = [pull(axis)] if pull else []
            self._line(f"{self._at('a', axis, i)} = {self._along(axis, i, accelerations, forces, pulls)}")

    def _by_extent(self) -> tuple[list[MassesText], list[BlockText]]:
        """Return the effects on all masses, and the effects on some masses, without forces between near points."""
        on_all = [masses for masses in self._on_masses if masses.size == self._n and len(masses.runs) == 1]
        others = [masses for masses in self._on_masses if masses not in on_all]
        return on_all, [*others, *self._links, *self._meshes]

    def _event(self, group: Any, name: str) -> None:
        """Write the function whose zeros are the events of an effect on a group."""
        with group.member(f"{name}{self._suffix}(member, t, u, v, p)") as (s, i, j):
            offered = group.offered(s, i, j, "event")
            self._line(f"return float({group.laws[0].call('event', s, offered)})")
        if self._suffix:
            with self._function(f"{name}(member, t, u, v, p)"):
                self._bodies_text.value(f"{name}_of_all(member, t, everywhere, speeds, p)")

    def _reset(self, group: Any, name: str) -> None:
        """Write the function that changes the state at the events of an effect on a group.

        In a run that integrates the work, the change of the energy is added to the work.
        """
        law = group.laws[0]
        with group.member(f"{name}{self._suffix}(member, t, u, v, p)") as (s, i, j):
            follows_work = self._follows_work and not self._suffix
            if follows_work:
                self._line("before = energy(t, u, v, p)")
            offered = group.offered(s, i, j, *RESETS)
            if "state_after" in law.functions:
                self._line(f"state = {law.call('state_after', s, offered)}")
            changes_velocity = law.functions.keys() & {"velocity_after", "rate_after"}
            constraints = self._constraints if changes_velocity and not self._suffix else None
            if constraints:
                constraints.before_impulse()
            if changes_velocity:
                group.strike(s, i, j, offered)
            if constraints:
                constraints.after_impulse()
            if "state_after" in law.functions:
                self._line(f"{law.columns[STATE].of(s)} = state")
            if follows_work:
                with self._block(f"if v.size > {self._work}"):
                    self._line(f"v[{self._work}] += energy(t, u, v, p) - before")

        if self._suffix:
            with self._function(f"{name}(member, t, u, v, p)"):
                assert self._constraints
                self._bodies_text.reset(f"{name}_of_all(member, t, everywhere, speeds, p)", self._constraints)


def _text_of(effect: Effect) -> type[PairForceText]:
    """Return the class that writes the forces between near points."""
    if isinstance(effect, FrictionalContact):
        return GrainsText
    return LatticeSumText if isinstance(effect, LatticeSum) else PairForceText


def _acting(groups: Iterable[G]) -> list[G]:
    """Return the groups with only the laws that are forces."""
    acting = [group.of_laws(group.having(*group.FORCES)) for group in groups]
    return [group for group in acting if group.laws]
