"""`Frame`: trusses and frames built from nodes and members."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse

from ..animation.mechanism import Mechanism
from ..functions.checks import check_count, reals, shown
from ..functions.layout import unknown_name
from ..geometry import Geometry
from ..keywords import with_suggestions
from ..problem import Problem
from ..scene.effect import Link
from ..stability import practical_limit
from .corotational import chords, energy_of_members, turning_members
from .corotational_space import chords_in_space, energy_of_members_in_space, turning_members_in_space
from .damping import Rayleigh
from .frame_members import DIRECTIONS, Member, Section
from .linear import linear
from .matrices import check_mass, without
from .modes import Modes, highest_frequency, modes_of
from .structure import matrix_of

_TURNING: dict[int, Any] = {
    2: (turning_members, chords, energy_of_members),
    3: (turning_members_in_space, chords_in_space, energy_of_members_in_space),
}
_OF_LIMIT = 0.9  # safety factor of the stable step
_UNITS = {"u": "m", "r": "rad"}
_LEAST = 1e-12  # relative to the largest stiffness; a smaller stiffness counts as zero


@with_suggestions()
class Frame:
    """A truss or a frame of nodes, members, masses and supports, in the plane or in space.

    Degrees of freedom are named by node and direction, such as ``"roof.ux"``: ux, uy and rz in the plane, and ux, uy,
    uz, rx, ry and rz in space. Supports, and directions without stiffness and mass, have no degree of freedom. In a
    frame with masses, rotations without inertia follow the other motion without delay: they are condensed out of the
    stiffness (Guyan, 1965), and have no degree of freedom either.

    Each end of a member has half of its mass m, and in its rotations the inertia m L^2 / 24. The frequencies of beams
    are therefore too low: for the first mode of a cantilever by 4 % with 4 members, and by 1 % with 8 members.

    Parameters
    ----------
    dimension : {2, 3}

    Raises
    ------
    ValueError
        If the dimension is not 2 or 3.
    """

    def __init__(self, dimension: int = 2) -> None:
        if dimension not in DIRECTIONS:
            raise ValueError(f"dimension must be 2 or 3, not {shown(dimension)}.")
        self.dimension = dimension
        self._places: dict[str, np.ndarray] = {}
        self._members: list[tuple[str, str, Member]] = []
        self._hinges: dict[tuple[int, str, str], tuple[str, Link]] = {}  # by the member, its end and the direction
        self._masses: dict[str, float] = {}
        self._inertias: dict[str, float] = {}
        self._fixed: set[str] = set()

    def node(self, name: str, *place: float) -> None:
        """Add a node at a place, m.

        Raises
        ------
        TypeError, ValueError
            If the name is taken, or the place does not have `dimension` coordinates.
        """
        if not isinstance(name, str) or not name or "." in name:
            raise TypeError(f"the name of a node must be a text without a point, not {shown(name)}.")
        if name in self._places:
            raise ValueError(f"there is a node {name} already: give each node its own name.")
        at = reals(place, f"the place of {name}")
        if at.shape != (self.dimension,) or not np.isfinite(at).all():
            such = ", ".join(map(str, range(self.dimension)))
            raise ValueError(
                f"the place of {name} must have {self.dimension} finite coordinates, such as node({name!r}, {such})."
            )
        self._places[name] = at

    def member(
        self,
        start: str,
        end: str,
        section: Section,
        *,
        releases: Iterable[str] = (),
        hinges: Mapping[str, Link | Mapping[str, Link]] | None = None,
        up: Sequence[float] = (0.0, 0.0, 1.0),
    ) -> None:
        """Add a straight member between two nodes.

        Parameters
        ----------
        start, end : str
        section : Section
        releases : iterable of {"start", "end"}
            The ends without a moment.
        hinges : dict, optional
            Plastic hinges, such as ``{"start": ElasticPlastic(8e7, 3e5)}``. The link of `eig3.effects` gives the
            moment, N m, for the rotation of the end relative to its node, rad. The rotation of the end is a degree of
            freedom, such as ``"a-b.rz_start"``, with the inertia of half the member. In space, hinges have
            directions, such as ``{"start": {"ry": law}}``, which are the axes of the frame and not of the member: for a
            column along z, "rz" is torsion. In these directions alone, the end rotates by itself.
        up : sequence of float, shape (3,)
            In space: a direction in the plane in which the section bends with I. A member along `up` uses x instead,
            or z if it is along x.

        Raises
        ------
        TypeError, ValueError
            If an argument is not valid.
        """
        if not isinstance(section, Section):
            raise TypeError(f"section must be an eig3.structures.Section, not {shown(section)}.")
        free = frozenset(releases if isinstance(releases, Iterable) and not isinstance(releases, str) else [releases])
        if not free <= {"start", "end"}:
            raise ValueError(f'releases must be some of "start" and "end", not {shown(releases)}.')
        if not isinstance(hinges, Mapping | None):
            raise TypeError(
                f'hinges must be a dictionary such as {{"start": ElasticPlastic(...)}}, not {shown(hinges)}.'
            )
        ends = self._check_hinges({} if hinges is None else dict(hinges), free, section)
        member = Member(section, self._place(start), self._place(end), free, _direction(up))
        if member.length == 0:
            raise ValueError(f"the member from {start} to {end} must have a length.")
        number = len(self._members)
        self._members.append((start, end, member))
        same = sum((a, b) == (start, end) for a, b, _ in self._members[:number]) if ends else 0
        for (side, direction), law in ends.items():
            name = f"{start}-{end}{f'({same + 1})' * (same > 0)}.{direction}_{side}"
            if any(name == other for other, _ in self._hinges.values()):
                raise ValueError(f"two hinges have the name {name}: use names of nodes without hyphens.")
            self._hinges[number, side, direction] = name, law

    def _check_hinges(
        self, hinges: dict[str, Any], releases: frozenset[str], section: Section
    ) -> dict[tuple[str, str], Link]:
        """Return the links of the hinges by their ends and directions."""
        found = {}
        rotations = DIRECTIONS[self.dimension][self.dimension :]
        for side, given in hinges.items():
            if side not in ("start", "end") or side in releases or section.is_bar:
                raise ValueError(f'hinges must be at "start" or "end", where the member has a moment, not at {side!r}.')
            if self.dimension == 3 and not isinstance(given, Mapping):
                raise TypeError(
                    f'hinges[{side!r}] must name directions in space, such as {{"ry": ElasticPlastic(...)}}.'
                )
            for direction, law in given.items() if isinstance(given, Mapping) else [(rotations[0], given)]:
                if direction not in rotations:
                    raise unknown_name(f"hinges[{side!r}] has", str(direction), rotations, ValueError)
                if not isinstance(law, Link):
                    raise TypeError(f"hinges[{side!r}] must be a link of eig3.effects, not {shown(law)}.")
                found[side, direction] = law
        return found

    def _ends(self, number: int, hinged: bool = True) -> list[str]:
        """Return the names of the degrees of freedom of both ends of a member; with `hinged`, also of its hinges."""
        start, end, _ = self._members[number]
        sides = [(side, node, x) for side, node in (("start", start), ("end", end)) for x in DIRECTIONS[self.dimension]]
        hinges = self._hinges if hinged else {}
        return [hinges[number, side, x][0] if (number, side, x) in hinges else f"{node}.{x}" for side, node, x in sides]

    def mass(self, node: str, m: float, inertia: float = 0.0) -> None:
        """Add a mass, kg, to a node, and a moment of inertia, kg m^2, to its rotations.

        Raises
        ------
        ValueError
            If a value is negative, or the node is not known.
        """
        self._place(node)
        values = reals([m, inertia], "m and inertia")
        if not (np.isfinite(values).all() and (values >= 0).all()):
            raise ValueError(f"m and inertia must be at least 0, not {m} and {inertia}.")
        self._masses[node] = self._masses.get(node, 0.0) + float(m)
        self._inertias[node] = self._inertias.get(node, 0.0) + float(inertia)

    def support(self, node: str, directions: str = "") -> None:
        """Fix a node, or some of its directions, such as ``"ux uy"``.

        Raises
        ------
        ValueError
            If the node or a direction is not known.
        """
        self._place(node)
        if not isinstance(directions, str):
            raise TypeError(f'directions must be a text such as "ux uy", not {shown(directions)}.')
        known = DIRECTIONS[self.dimension]
        for direction in directions.split() or known:
            if direction not in known:
                raise unknown_name(f"{node} has", direction, known, ValueError)
            self._fixed.add(f"{node}.{direction}")

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the degrees of freedom."""
        return tuple(self._assembled(hinged=True)[0])

    @property
    def matrices(self) -> tuple[np.ndarray, Any]:
        """The lumped masses, shape (n,), and the sparse stiffness, to which hinges do not contribute."""
        return self._assembled(hinged=True)[1:]

    def highest_frequency(self) -> float:
        """Return a bound of the angular frequencies, rad/s: the highest frequency of a single member with its masses.

        By Rayleigh's theorem no frequency of the frame is higher (Irons, 1970). The masses of nodes are left out. If a
        member has stiffness in a direction in which it has no mass, it is the highest frequency of the frame.

        Raises
        ------
        ValueError
            If the frame has stiffness in a direction without mass.
        """
        largest = 0.0
        for _, _, member in self._members:
            K, m = member.matrices
            some = m > 0
            stiff = np.abs(K[~some]).max(initial=0.0) > _LEAST * np.abs(K).max()
            if stiff or not some.any():
                _, masses, K = self._with_masses()
                return highest_frequency(check_mass(masses, None), K)
            root = np.sqrt(m[some])
            squares = np.linalg.eigvalsh(K[np.ix_(some, some)] / np.outer(root, root))
            largest = max(largest, float(np.sqrt(squares.max())))
        return largest

    def problem(
        self,
        t_span: Sequence[float],
        *,
        ground: Any = None,
        direction: str = "ux",
        corotational: bool = False,
        **options: Any,
    ) -> Problem:
        """Return the problem of the frame's motion.

        Parameters
        ----------
        t_span : (float, float)
        ground : tuple
            The times, s, and the accelerations, m/s^2, of the ground.
        direction : str
            The direction of the ground motion.
        corotational : bool
            Allow large displacements and rotations of the members, with small strains. By default the frame is linear.
            In space, rx, ry and rz of a node are then its rotation vector; its rates, as in `v0`, equal the angular
            velocity only for small rotations. A run ends where a node has rotated by 2 pi. Rayleigh damping has the
            stiffness at rest, so it also resists large rotations of the members.
        **options
            The other options of `eig3.linear`, such as `damping`, `force`, `links`, `u0` and `work`.

        Returns
        -------
        Problem
            Its `view` shows the frame, and `h` is a stable step from the frequencies of the members, without links. Its
            energy is constant without ground motion, damping and links.

        Raises
        ------
        TypeError, ValueError
            If an argument is not valid, a direction has stiffness and no mass, or, for corotational members in space,
            a support fixes only some of a node's rotations.
        """
        for name in ("M", "C", "K", "names", "units"):
            if name in options:
                raise TypeError(f"{name} of a frame comes from its nodes and members: leave it out, and give damping.")
        names, masses, K = self._with_masses(condensed=not corotational, hinged=True)
        if self._hinges:
            options["links"] = [*options.get("links", ()), *self._links(names)]
            if isinstance(options.get("damping"), Rayleigh):
                closed = self._with_masses()
                options["damping"] = options["damping"].of(check_mass(closed[1], None), closed[2])
        if ground is not None:
            if not isinstance(ground, tuple | list) or len(ground) != 2:
                raise TypeError(
                    "ground of a frame must be (times, accelerations): its influence follows from direction."
                )
            options["ground"] = *ground, self._influence(names, direction)
        units = tuple(_UNITS[name.rpartition(".")[2][0]] for name in names)
        C = None
        if corotational:
            if self._hinges and self.dimension == 3:
                raise ValueError("hinges of members in space are for linear frames: leave out corotational=True.")
            if {"force", "work", "params"} & {*options}:
                raise ValueError("force, work and params are for linear frames: leave out corotational=True.")
            C = _damping_at_rest(options.pop("damping", None), masses, K)
            force, of, energy = _TURNING[self.dimension]
            ends = [self._ends(k) for k in range(len(self._members))]
            options |= {"force": force, "params": of(names, [member for *_, member in self._members], ends)}
            K = None
        problem = linear(masses, C, K, t_span=t_span, names=names, units=units, **options)
        if corotational and ground is None and C is None and not options.get("links"):
            problem = problem.with_(energy=energy)
        h = None if corotational or options.get("links") else self._stable_step(problem.params)
        return problem.with_(name="frame", view=self._view(names, 1.0), geometry=self._geometry(names), h=h)

    def _links(self, names: Sequence[str]) -> Iterator[tuple[Link, str | None, str]]:
        """Return the hinges as links between the rotations of a node and of the end of a member."""
        for (number, side, direction), (hinge, law) in self._hinges.items():
            rotation = f"{self._members[number][side == 'end']}.{direction}"
            is_fixed = rotation in self._fixed
            for name in (hinge, *[rotation] * (not is_fixed)):
                if name not in names:
                    raise ValueError(
                        f"{name} must have inertia, because a hinge joins it: give the section a density, or the node "
                        "an inertia."
                    )
            yield law, None if is_fixed else rotation, hinge

    def modes(self, count: int, direction: str = "ux") -> Modes:
        """Return the lowest natural modes, with their participation in a ground motion in a direction.

        Hinges of members are rigid.

        Parameters
        ----------
        count : int
        direction : str

        Returns
        -------
        Modes

        Raises
        ------
        ValueError
            If there are fewer modes, the direction is not known, or a direction has stiffness and no mass.
        """
        names, masses, K = self._with_masses()
        influence = self._influence(names, direction)
        return modes_of(check_mass(masses, None), K, check_count(count, "count"), influence)

    def _influence(self, names: Sequence[str], direction: str) -> np.ndarray:
        """Return 1 for the degrees of freedom in a direction of the ground motion, and 0 for the others."""
        known = DIRECTIONS[self.dimension][: self.dimension]
        if direction not in known:
            raise unknown_name("the ground has", direction, known, ValueError)
        return np.array([float(name.endswith(f".{direction}")) for name in names])

    def _with_masses(self, *, condensed: bool = True, hinged: bool = False) -> tuple[list[str], np.ndarray, Any]:
        """Return the names, masses and stiffness of degrees of freedom, which must have masses."""
        names, masses, K = self._assembled(condensed=condensed, hinged=hinged)
        light = [name for name, m in zip(names, masses, strict=True) if m == 0]
        if light:
            raise ValueError(f"{light[0]} must have a mass: give its members a density, or the node a mass.")
        return names, masses, K

    def _stable_step(self, params: Any) -> float:
        """Return a stable step of EIG-3 with the damping of the problem."""
        has, omega = params._asdict(), self.highest_frequency()
        ratios = {omega: has.get("a", 0.0) / (2 * omega) + has.get("b", 0.0) * omega / 2}
        if "modes" in has:  # of modal damping
            modes, rates = has["modes"], has["rates"]
            damped = np.sqrt(np.einsum("ki,ik->k", modes, matrix_of(has["K"]) @ modes.T)).max()
            ratios[damped] = np.einsum("ki,ki->k", modes, rates).max() / (2 * damped)
        return _OF_LIMIT * min(practical_limit("eig3", xi) / omega for omega, xi in ratios.items())

    def view(self, factor: float = 1.0) -> Mechanism:
        """Return the view of the frame for `Problem.animate`, with displacements that are `factor` times as large."""
        return self._view(list(self.names), factor)

    def places(self, u: np.ndarray) -> np.ndarray:
        """Return the places of all nodes, shape (s, nodes, dimension), m, for displacements of the shape (s, n)."""
        return _moved(None, np.atleast_2d(u), *self._drawn(list(self.names)), 1.0)

    def _geometry(self, names: list[str]) -> Geometry:
        nodes = list(self._places)
        links = [(nodes.index(start), nodes.index(end)) for start, end, _ in self._members]
        axes = DIRECTIONS[self.dimension][: self.dimension]
        held = [nodes.index(n) for n in nodes if all(f"{n}.{axis}" in self._fixed for axis in axes)]
        rest, columns = self._drawn(names)
        return Geometry(
            places=partial(_moved, rest=rest, columns=columns, factor=1.0),
            velocities=partial(_moved, rest=np.zeros_like(rest), columns=columns, factor=1.0),
            links=np.array(links).reshape(-1, 2),
            fixed=np.array(held, dtype=int),
        )

    def _view(self, names: list[str], factor: float) -> Mechanism:
        geometry = self._geometry(names)
        rest, columns = self._drawn(names)
        return Mechanism(
            partial(_moved, rest=rest, columns=columns, factor=factor),
            links=geometry.links,
            fixed=geometry.fixed,
            labels=("x (m)", "y (m)", "z (m)")[: self.dimension],
            note="" if factor == 1 else f"displacements {factor:g} times as large",
        )

    def _drawn(self, names: list[str]) -> tuple[np.ndarray, np.ndarray]:
        """Return the places at rest, and the degree of freedom of each coordinate, -1 where it is fixed."""
        number = {name: i for i, name in enumerate(names)}
        axes = DIRECTIONS[self.dimension][: self.dimension]
        columns = np.array([[number.get(f"{node}.{axis}", -1) for axis in axes] for node in self._places])
        return np.array(list(self._places.values())), columns

    def _assembled(self, *, condensed: bool = True, hinged: bool = False) -> tuple[list[str], np.ndarray, Any]:
        """Return the names of the degrees of freedom, their masses, and the stiffness.

        With `hinged`, ends with hinges have a rotation of their own; otherwise hinges are rigid. Rotations without
        inertia are condensed, unless nothing has a mass: K is then of statics.
        """
        if not self._members:
            raise ValueError("the frame must have at least one member.")
        every = [f"{node}.{direction}" for node in self._places for direction in DIRECTIONS[self.dimension]]
        every += [name for name, _ in self._hinges.values()] if hinged else []
        number = {name: i for i, name in enumerate(every)}
        d = len(DIRECTIONS[self.dimension])
        rows, columns, entries, masses = [], [], [], np.zeros(len(every))
        for k, (*_, member) in enumerate(self._members):
            places = np.array([number[name] for name in self._ends(k, hinged)])
            K, m = member.matrices
            masses[places] += m
            rows.append(np.repeat(places, 2 * d))
            columns.append(np.tile(places, 2 * d))
            entries.append(K.ravel())
        for values, part in ((self._masses, slice(self.dimension)), (self._inertias, slice(self.dimension, d))):
            for node, value in values.items():
                masses[number[f"{node}.ux"] :][:d][part] += value
        given = np.concatenate(entries), (np.concatenate(rows), np.concatenate(columns))
        K = scipy.sparse.coo_array(given, shape=(len(every),) * 2).tocsr()
        moves = (masses > 0) | (K.diagonal() > _LEAST * K.diagonal().max())
        free = [i for i, name in enumerate(every) if moves[i] and name not in self._fixed]
        names, masses, K = [every[i] for i in free], masses[free], K[free][:, free]
        turns = np.array([not name.rpartition(".")[2].startswith("u") for name in names], dtype=bool)
        stay = (masses > 0) | ~turns
        if not condensed or stay.all() or not masses.any():
            return names, masses, K
        return [name for name, stays in zip(names, stay, strict=True) if stays], masses[stay], without(K, ~stay)

    def _place(self, node: str) -> np.ndarray:
        if node not in self._places:
            raise unknown_name("the frame has", str(node), list(self._places) or ["node"], ValueError)
        return self._places[node]


def _moved(t: Any, u: np.ndarray, rest: np.ndarray, columns: np.ndarray, factor: float) -> np.ndarray:
    """Return the places of the nodes, shape (s, nodes, dimension)."""
    values = np.concatenate([u, np.zeros((len(u), 1))], axis=1)  # column -1 is for fixed coordinates
    return rest + factor * values[:, columns]


def _damping_at_rest(damping: Any, masses: np.ndarray, K: Any) -> Any:
    """Return the damping matrix a M + b K with the stiffness at rest, or None."""
    if damping is None:
        return None
    if not isinstance(damping, Rayleigh):
        raise TypeError(f"the damping of a corotational frame must be eig3.Rayleigh(...), not {shown(damping)}.")
    a, b = damping.of(check_mass(masses, None), K).coefficients
    C = (a * scipy.sparse.diags_array(masses) + b * K).tocsr()
    C.eliminate_zeros()  # without b, a diagonal
    return C


def _direction(up: Any) -> np.ndarray:
    vector = reals(up, "up")
    if vector.shape != (3,) or not np.isfinite(vector).all() or not vector.any():
        raise ValueError("up must be a direction in space: three numbers that are not all 0.")
    return vector / np.linalg.norm(vector)
