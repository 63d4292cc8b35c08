"""The content of a scene: points, and the effects on them."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..functions.checks import check_count, reals
from ..keywords import with_suggestions
from .assembly import Bodies, Cloud, numbered
from .body_torque import BodyTorque
from .bonds import check_orders
from .cell import same_points
from .effect import Body, Effect, Link, arguments
from .frictional_contact import FrictionalContact
from .pair_force import PairForce, check_pair_force
from .picture import Places
from .placed import Placed, moves
from .point_joint import PointJoint

_ANGLES = {1: 0, 2: 1, 3: 3}  # of a mass that spins, by the dimension


@with_suggestions()
@dataclass(frozen=True, eq=False)
class Points:
    """Points of a scene: one point, or an array of points of any shape, which is indexed as NumPy arrays are.

    Attributes
    ----------
    scene : Scene
    numbers : ndarray of int
        The points' numbers in their scene.
    """

    scene: Description
    numbers: np.ndarray

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the array of points; () for one point."""
        return self.numbers.shape

    @property
    def position(self) -> np.ndarray:
        """The positions at the start, m, of shape (*shape, dimension), or of shape `shape` in one dimension."""
        places = self.scene._cloud().positions[self.numbers]
        return places[..., 0] if self.scene.dimension == 1 else places

    def __repr__(self) -> str:
        return f"Points(shape={self.shape}, dimension={self.scene.dimension})"

    def __len__(self) -> int:
        if not self.shape:
            raise TypeError("a single point has no length; only an array of points has one.")
        return len(self.numbers)

    def __iter__(self) -> Iterator[Points]:
        return (self[k] for k in range(len(self)))

    def __getitem__(self, index: Any) -> Points:
        return Points(self.scene, _constant(np.asarray(self.numbers[index])))

    def positions(self, u: ArrayLike, t: ArrayLike | None = None) -> np.ndarray:
        """Return the positions of these points in a run, m, including fixed and moved points.

        Parameters
        ----------
        u : array_like, shape (..., degrees of freedom)
            Such as ``solution.u``.
        t : float or array_like, shape (...), optional
            The times of these states, such as ``solution.t``, s, for points that a `Motion` moves.

        Returns
        -------
        ndarray, shape (..., *shape, dimension)
            Without the last axis in scenes of one dimension.

        Raises
        ------
        ValueError
            If t is missing or does not match u, and if masses were added after the run.
        """
        return self.scene._values_of(self.numbers, u, t)

    def velocities(self, v: ArrayLike, t: ArrayLike | None = None) -> np.ndarray:
        """Return the velocities of these points in a run, m/s; 0 for fixed points without a `Motion`.

        Parameters
        ----------
        v : array_like, shape (..., degrees of freedom)
            Such as ``solution.v``.
        t
            As for `positions`.

        Returns
        -------
        ndarray, shape (..., *shape, dimension)
            Without the last axis in scenes of one dimension.

        Raises
        ------
        ValueError
            As for `positions`.
        """
        return self.scene._values_of(self.numbers, v, t, rate=1)

    def angles(self, u: ArrayLike) -> np.ndarray:
        """Return the angles of these masses in a run, rad, from displacements such as ``solution.u``.

        Returns
        -------
        ndarray, shape (..., *shape) in the plane, or (..., *shape, 3) in space

        Raises
        ------
        ValueError
            If no mass of the scene has an inertia, a point is fixed, or masses were added after the run.
        """
        return self.scene._values_of(self.numbers, u, angles=True)

    def angular_velocities(self, v: ArrayLike) -> np.ndarray:
        """Return the angular velocities of these masses, rad/s, from ``solution.v``, as `angles` returns the angles."""
        return self.scene._values_of(self.numbers, v, angles=True)


class Axes(Points):
    """The unit vectors of one rigid body."""

    def across(self) -> tuple[Points, Points]:
        """Return the first vector, and the vector of the ground that equals it at the start."""
        fixed = self.scene.fixed(self.position[0])
        self.scene._bodies.vectors.append(int(fixed.numbers))
        return self[0], fixed


@with_suggestions()
class Description:
    """The points and the effects of a scene, as they are added one after the other."""

    def __init__(self, dimension: int, box: Sequence[float | None] | None = None, shear: float = 0.0) -> None:
        if isinstance(dimension, bool) or not isinstance(dimension, int | np.integer) or dimension not in (1, 2, 3):
            raise ValueError(f"dimension must be 1, 2 or 3, not {dimension!r}.")
        self.dimension = int(dimension)
        self._box = self._check_box(box)
        self._shear = float(reals(shear, "shear"))
        if not math.isfinite(self._shear):
            raise ValueError(f"shear must be finite, not {shear!r}.")
        if self._shear and not (self.dimension > 1 and (self._box[:2] > 0).all()):
            raise ValueError("shear needs a box with sides along x and y, such as box=(1.0, 1.0).")
        self._pair_forces: list[PairForce] = []
        none = np.empty((0, self.dimension))
        # masses, positions, velocities, positions at rest, inertias and spins, in the order of numbers
        self._parts: list[Any] = [(none[:, 0], none, none, none, none[:, 0], np.empty((0, _ANGLES[self.dimension])))]
        self._count = 0
        self._placed: list[Placed] = []
        self._bodies = Bodies.none()

    def fixed(self, position: ArrayLike) -> Points:
        """Add points that do not move, unless a `Motion` moves them.

        Parameters
        ----------
        position : array_like, shape (..., dimension)
            m. In one dimension it has any shape, without the last axis.

        Returns
        -------
        Points
        """
        position = self._vectors(position, "position of fixed points")
        return self._added(position, np.zeros(position.shape[:-1]), np.zeros_like(position))

    def mass(
        self,
        m: ArrayLike,
        position: ArrayLike,
        velocity: ArrayLike = 0.0,
        *,
        inertia: ArrayLike | None = None,
        angular_velocity: ArrayLike = 0.0,
    ) -> Points:
        """Add masses that are free to move.

        Parameters
        ----------
        m : float or array_like, shape (...)
            kg.
        position : array_like, shape (..., dimension)
            m. In one dimension it has any shape, without the last axis.
        velocity : array_like, shape (..., dimension), optional
            m/s; 0 if not given.
        inertia : float or array_like, shape (...), optional
            The moment of inertia of a disc or a sphere, kg m^2: the masses then have rotational degrees of freedom.
        angular_velocity : array_like, shape (...) in the plane, or (..., 3) in space, optional
            rad/s; 0 if not given.

        Returns
        -------
        Points

        Raises
        ------
        TypeError, ValueError
            If a mass or an inertia is not positive, or shapes do not match.
        """
        position = self._vectors(position, "position of masses")
        m = reals(m, "m of masses")
        if not (np.isfinite(m).all() and (m > 0).all()):
            raise ValueError(f"m of masses must be positive and finite, not {m[~((m > 0) & np.isfinite(m))].flat[0]}.")
        if np.ndim(velocity) == 0 and velocity == 0:
            velocity = np.zeros(position.shape if self.dimension > 1 else position.shape[:-1])
        velocity = self._vectors(velocity, "velocity of masses")
        shape = position.shape[:-1]
        turning = self._turning(inertia, angular_velocity, shape)
        given = spread(m, shape, "m"), spread(velocity, position.shape, "velocity")
        return self._added(position, *given, turning=turning)

    def add(
        self,
        effect: Effect,
        *points: Any,
        others: Points | None = None,
        exclude_bonded: Collection[str] = (),
        neighbor_capacity: int | None = None,
    ) -> None:
        """Add an effect on some points.

        Parameters
        ----------
        effect : Effect
            Its parameters are numbers, or arrays with one number for each of the points or pairs of points.
        *points : Points
            A `Body` takes masses; without them it acts on all masses of the scene. A `Link` takes its two ends, as
            points of the same shape or as one point for many. A `Motion` takes fixed points. A `Cell` takes the points
            of each of its corners, in the same way as a link. A `Weld` takes rigid bodies.

            A `Link` with a cutoff also takes one array of points, and then acts between all pairs of these points. A
            neighbour list keeps the time of a step proportional to the number of points. The parameters are numbers;
            the parameters in `Link.mixed` may have a value for each point, and a pair then has the mean or the product
            of the values of its points.
        others : Points, optional
            The link acts between all pairs of a point of the first array and a point of `others`. Only the first array
            can have parameters for each point.
        exclude_bonded : collection of "1-2", "1-3" and "1-4"
            Exclude pairs that are one, two or three bonds apart. Bonds are links and constraints of two points, the
            edges of cells with a volume, and all pairs of points of a rigid body.
        neighbor_capacity : int, optional
            The number of pairs of each point for which the neighbour list has memory. By default it is twice the number
            at the start, and at least the number in a dense packing. With more pairs the results stay correct, but each
            evaluation then searches for the pairs and takes longer.

        Raises
        ------
        TypeError, ValueError
            If the points or parameters do not match the effect. The error names the effect.
        """
        if not isinstance(effect, Effect):
            given = effect.__name__ if isinstance(effect, type) else type(effect).__name__
            raise TypeError(f"effect must be an effect with parameters, such as LinearSpring(10.0), not {given}.")
        if effect.directions > 1:
            raise TypeError(
                f"{effect.title} acts across two directions of a structure: give it to eig3.linear or Frame."
            )
        effect, points = effect.resolved(points)
        effect.check(self.dimension)
        effect = effect.snapshot()
        if isinstance(effect, FrictionalContact) and len(points) != 1:
            raise TypeError(
                f"{effect.title} takes one array of points, and fixed points as others=, not {len(points)}."
            )
        if isinstance(effect, Link) and len(points) == 1:
            self._add_pair_force(effect, points[0], others, check_orders(exclude_bonded), neighbor_capacity)
            return
        if others is not None or exclude_bonded or neighbor_capacity is not None:
            raise TypeError(
                "others, exclude_bonded and neighbor_capacity are for a link on one array of points, not for "
                f"{effect.title}."
            )
        numbers = self._numbers_of(points, effect)
        if not numbers:  # on all masses; their number is known later
            self._placed.append(Placed(effect, {}))
            return
        columns = effect.columns(numbers[0].shape, self.dimension)
        flat = tuple(array.ravel() for array in numbers)
        if same_points(flat):
            raise ValueError(f"{effect.title} joins a point to itself.")
        cloud = self._cloud()
        if isinstance(effect, Body) and cloud.is_massless[np.concatenate(flat)].any():
            self._check_massless(effect)
        columns |= effect.shape_columns([cloud.rest[i] for i in flat])
        positions = [cloud.positions[i] for i in flat]
        if isinstance(effect, Link):
            positions = _nearest(positions, cloud.box)
        elif not isinstance(effect, PointJoint):
            _check_whole(effect.title, positions, cloud.box)
        effect.check_points([cloud.masses[i] for i in flat], positions, columns)
        if not flat[0].size:
            return
        self._placed.append(Placed(effect, columns, flat))

    def _add_pair_force(
        self, effect: Link, points: Points, others: Points | None, excluded: tuple[str, ...], capacity: int | None
    ) -> None:
        effect = effect.of_groups(1 if others is None else 2)
        handles = (points,) if others is None else (points, others)
        groups = [self._numbers_of([handle], effect)[0] for handle in handles]
        first, second = groups[0].ravel(), groups[1].ravel() if len(groups) > 1 else np.empty(0, dtype=np.int64)
        columns = effect.columns(groups[0].shape, self.dimension)
        if not first.size or (others is not None and not second.size):
            return
        products = [name for name, rule in effect.mixing_rules().items() if rule == "product" and others is None]
        columns = {
            name: column[:1] if (column == column[0]).all() and name not in products else column
            for name, column in columns.items()
        }
        capacity = None if capacity is None else check_count(capacity, "neighbor_capacity")
        pair_force = PairForce(effect, columns, (first, second), excluded, capacity)
        cloud = self._cloud()
        check_pair_force(pair_force, cloud)
        self._pair_forces.append(pair_force)

    def _vectors(self, values: ArrayLike, name: str) -> np.ndarray:
        vectors = reals(values, name)
        if self.dimension == 1:
            vectors = vectors[..., np.newaxis]
        elif vectors.shape[-1:] != (self.dimension,):
            raise ValueError(f"{name} must have {self.dimension} components each, not the shape {vectors.shape}.")
        if not np.isfinite(vectors).all():
            raise ValueError(f"{name} must be finite.")
        return vectors

    def _added(
        self,
        position: np.ndarray,
        m: np.ndarray,
        velocity: np.ndarray,
        rest: np.ndarray | None = None,
        turning: tuple[np.ndarray, np.ndarray] | None = None,
    ) -> Points:
        numbers = np.arange(self._count, self._count + m.size).reshape(m.shape)
        self._count += m.size
        rows = (m.size, self.dimension)
        rest = position if rest is None else rest
        inertia, spins = turning or (np.zeros(m.size), np.zeros((m.size, _ANGLES[self.dimension])))
        self._parts.append(
            (m.ravel(), position.reshape(rows), velocity.reshape(rows), rest.reshape(rows), inertia, spins)
        )
        return Points(self, _constant(numbers))

    def _cloud(self) -> Cloud:
        """Return all points. Their arrays are joined here, because points may be added one by one."""
        if len(self._parts) > 1:
            self._parts = [tuple(np.concatenate(arrays) for arrays in zip(*self._parts, strict=True))]
        masses, positions, velocities, rest, inertia, spins = self._parts[0]
        spins = spins if inertia.any() else spins[:, :0]
        given = self._box, self._shear, inertia, spins, self._bodies
        return Cloud(masses, positions, velocities, rest, *given)

    def _turning(
        self, inertia: ArrayLike | None, spin: ArrayLike, shape: tuple[int, ...]
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Return the inertias and the spins of masses, as rows; None for masses that do not spin."""
        if inertia is None:
            if np.any(np.asarray(spin) != 0):
                raise ValueError("angular_velocity of masses needs their inertia: give inertia too.")
            return None
        if self.dimension == 1:
            raise ValueError("inertia is for scenes of 2 or 3 dimensions: nothing spins on a line.")
        moments = spread(reals(inertia, "inertia of masses"), shape, "inertia")
        if not (np.isfinite(moments).all() and (moments > 0).all()):
            raise ValueError("inertia of masses must be positive and finite.")
        spins = reals(spin, "angular_velocity of masses")
        if not np.isfinite(spins).all():
            raise ValueError("angular_velocity of masses must be finite.")
        angles = _ANGLES[self.dimension]
        spins = spread(spins, shape if angles == 1 else (*shape, angles), "angular_velocity")
        return moments.ravel(), spins.reshape(-1, angles)

    def _check_box(self, box: Sequence[float | None] | None) -> np.ndarray:
        """Return the sides of the box, which are 0 along axes that are not periodic."""
        if box is None:
            return np.zeros(self.dimension)
        sides = reals([0.0 if side is None else side for side in np.atleast_1d(np.array(box, dtype=object))], "box")
        if sides.shape != (self.dimension,) or not (np.isfinite(sides) & (sides >= 0)).all():
            raise ValueError(f"box must have {self.dimension} sides, each a positive length or None, not {box!r}.")
        return sides

    def _numbers_of(self, points: Sequence[Points], effect: Effect) -> list[np.ndarray]:
        if isinstance(effect, BodyTorque) and [type(handle) for handle in points] != [Axes]:
            name = effect.title
            raise TypeError(f"{name} turns a rigid body: give its axes, as in scene.add({name}(...), body.axes).")
        for handle in points:
            if not isinstance(handle, Points):
                hint = ": index an array of points, as in masses[[0, 3]]" * isinstance(handle, list | tuple)
                hint += ": give body.centre, or a point such as body.point(place)" * hasattr(handle, "centre")
                raise TypeError(f"{effect.title} acts on Points of a scene, not on {type(handle).__name__}{hint}.")
            if handle.scene is not self:
                raise ValueError(f"{effect.title} was given points of another scene.")
        if len(points) not in effect.takes and not (isinstance(effect, Link) and len(points) == 1):
            takes = " or ".join(map(str, effect.takes))
            raise TypeError(f"{effect.title} takes {takes} arguments of points, not {len(points)}.")
        numbers = [handle.numbers for handle in points]
        if len({array.shape for array in numbers if array.size != 1}) > 1:
            shapes = " and ".join(str(array.shape) for array in numbers)
            pairs = "; others= gives all near pairs of two groups" * bool(effect.cutoff_field)
            raise ValueError(
                f"{effect.title} was given ends of shapes {shapes}; give one shape, or one point for all{pairs}."
            )
        return list(np.broadcast_arrays(*numbers)) if numbers else []

    def _values_of(
        self, numbers: np.ndarray, given: ArrayLike, t: ArrayLike | None = None, rate: int = 0, angles: bool = False
    ) -> np.ndarray:
        """Return the values of points, or of their angles; for fixed points the position, or its rate for rate=1."""
        values, cloud = np.asarray(given, dtype=np.float64), self._cloud()
        kinds, is_fixed = cloud.spins.shape[1], cloud.free[numbers] < 0
        if angles and not kinds:
            raise ValueError("no mass of the scene has an inertia, and thus an angle: pass inertia to scene.mass.")
        if angles and is_fixed.any():
            raise ValueError("fixed points have no angles; only masses do.")
        count = np.count_nonzero(cloud.is_own)
        size = values.shape[-1] if values.ndim else 0
        expected = count * (self.dimension + kinds) + len(numbered(cloud, self._placed)[2])
        if size != expected:
            raise ValueError(
                f"values must have {expected} degrees of freedom on the last axis, as has "
                f"solution.u of this scene, not {size}."
            )
        if angles:
            taken = values[..., cloud.free[numbers][..., np.newaxis] + count * (self.dimension + np.arange(kinds))]
        else:
            places = Places(cloud.positions, cloud.free, bodies=self._bodies, moves=moves(self._placed))
            times = self._times_of(numbers, values.shape[:-1], t, rate, places)
            taken = places.of(numbers.ravel(), values, times, rate)
            taken = taken.reshape(*values.shape[:-1], *numbers.shape, self.dimension)
        return taken[..., 0] if taken.shape[-1] == 1 else taken

    def _check_massless(self, effect: Body) -> None:
        """Refuse an effect that needs a mass on a point without a mass."""
        functions = effect.functions()
        if "acceleration" in functions or any("m" in arguments(function) for function in functions.values()):
            raise ValueError(f"{effect.title} acts on masses, and a point of a rigid body has none: give body.centre.")

    def _times_of(
        self, numbers: np.ndarray, shape: tuple[int, ...], t: ArrayLike | None, rate: int, places: Places
    ) -> np.ndarray | None:
        """Return the times of states of a shape, which points need if a motion moves one of them."""
        if not any(np.isin(numbers, some).any() for *_, some in places.moves):
            return None
        if t is None:
            call = "points.velocities(solution.v, solution.t)" if rate else "points.positions(solution.u, solution.t)"
            raise ValueError(f"t must be given for points that a motion moves, as in {call}.")
        times = reals(t, "t")
        if times.shape != shape[len(shape) - times.ndim :]:
            raise ValueError(f"t must have the shape {shape} of the states, not {times.shape}.")
        return times

    def _carry(self, parts: np.ndarray, factors: np.ndarray, is_vector: bool) -> Points:
        """Add points that are linear combinations of others, with factors of shape (..., parts)."""
        cloud = self._cloud()
        shape = *factors.shape[:-1], self.dimension
        position = (factors @ cloud.positions[parts]).reshape(shape)
        points = self._added(position, np.ones(shape[:-1]), (factors @ cloud.velocities[parts]).reshape(shape))
        for number, row in zip(points.numbers.ravel().tolist(), factors.reshape(-1, len(parts)), strict=True):
            self._bodies.carried[number] = parts, row
            self._bodies.vectors.extend([number] * is_vector)
        return points


def _constant(numbers: np.ndarray) -> np.ndarray:
    numbers.flags.writeable = False
    return numbers


def spread(values: np.ndarray, shape: tuple[int, ...], name: str) -> np.ndarray:
    try:
        return np.broadcast_to(values, shape)
    except ValueError:
        raise ValueError(f"{name} of masses must have the shape {shape} of these masses, not {values.shape}.") from None


def _check_whole(title: str, positions: list[np.ndarray], box: np.ndarray) -> None:
    """Refuse cells and constraints of consecutive points that have nearer images in a periodic box: they use none."""
    apart = (np.abs(np.diff(positions, axis=0)) > np.where(box > 0, box / 2, np.inf)).any(axis=(0, 2))
    if apart.any():
        raise ValueError(
            f"{title} {int(np.argmax(apart))} has points more than half a side of the box apart, and uses no periodic "
            "images: give the positions of a molecule or mesh that is whole, not wrapped into the box."
        )


def _nearest(positions: list[np.ndarray], box: np.ndarray) -> list[np.ndarray]:
    """Return the ends of links, with the image of each second end that is the nearest to its first end."""
    first, second = positions
    way = second - first
    turns = np.round(way / np.where(box > 0, box, np.inf))
    return [first, np.where(turns == 0, second, first + (way - box * turns))]
