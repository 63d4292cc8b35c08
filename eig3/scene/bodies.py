"""Rigid bodies in natural coordinates: a centre, and the unit vectors along the axes of each body.

The vectors are points of the scene whose masses are the principal moments J_k = sum m x_k^2, in kg m^2. So the kinetic
energy is m |c'|^2 / 2 + sum J_k |e_k'|^2 / 2, with a constant diagonal mass matrix, and every point of a body is a sum
of its centre and its vectors with constant factors. There are no angles, and no orientation is singular: J. Garcia de
Jalon and E. Bayo, Kinematic and Dynamic Simulation of Multibody Systems, Springer (1994).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..functions.checks import reals, shown
from ..keywords import with_suggestions
from .constraint import Constraint, Equation
from .description import Description, Points
from .effect import Link
from .hinge_friction import HingeFriction
from .hinge_motor import HingeMotor
from .joint_law import HingeLaw, HingeLawInSpace
from .point_joint import PointJoint
from .prescribed_angle import PrescribedAngle, PrescribedAngleInSpace
from .weld import Weld

_UNIT = 1e-9  # the largest error of a rotation
_THIN = 1e-12  # least J_k relative to the largest moment: a vector without a mass could not be moved
_MARGIN = 1e-9  # relative error of the moments of a plate without thickness
_PLATE = 1e-4  # a body is a plate if one J_k is below this fraction of the largest, see `plates`


@dataclass(frozen=True, eq=False)
class Rigid(Constraint):
    """The vectors of a body stay unit vectors at right angles."""

    needs = ()
    takes = (2, 3)
    picture = ""
    source = "phi = (e_i . e_j - delta_ij) / 2"

    def equations(self, points: list[np.ndarray], values: dict[str, Any]) -> list[Equation]:
        d = len(points)
        units = [(np.eye(d)[k], np.zeros(d)) for k in range(d)]
        lengths = [Equation(unit, unit, 0.5, 1.0, "N m") for unit in units]
        return lengths + [Equation(units[i], units[j], 1.0, 0.0, "N m") for i in range(d) for j in range(i)]


@dataclass(frozen=True, eq=False)
class Perpendicular(Constraint):
    """The product of two vectors stays as at the start."""

    needs = ()
    picture = ""
    source = "phi = e_0 . e_1 - (e_0 . e_1 at the start)"

    def equations(self, points: list[np.ndarray], values: dict[str, Any]) -> list[Equation]:
        zero = np.zeros(len(points[0]))
        return [Equation(((1.0, 0.0), zero), ((0.0, 1.0), zero), 1.0, float(points[0] @ points[1]), "N m")]


@dataclass(frozen=True, eq=False)
class Along(Constraint):
    """The line between two points stays perpendicular to a vector, the third point."""

    needs = ()
    takes = (3,)
    picture = ""
    source = "phi = (x1 - x0) . e"

    def equations(self, points: list[np.ndarray], values: dict[str, Any]) -> list[Equation]:
        zero, target = np.zeros(len(points[0])), float((points[1] - points[0]) @ points[2])
        return [Equation(((-1.0, 1.0, 0.0), zero), ((0.0, 0.0, 1.0), zero), 1.0, target)]


@with_suggestions()
@dataclass(frozen=True, eq=False)
class RigidBody:
    """A rigid body of a scene.

    Attributes
    ----------
    scene : Scene
    centre : Points
        The centre of mass.
    axes : Points
        The unit vectors along the principal axes, of shape (dimension,), on which `effects.Torque` acts.
    principal : ndarray, shape (dimension, dimension)
        The principal axes in the frame of the body, as columns.

    Notes
    -----
    Other codes: ``revolute`` is a hinge of MuJoCo and ``ObjectJointRevoluteZ`` of exudyn; ``prismatic`` is a slide and
    ``ObjectJointPrismaticX``; ``spherical`` is a ball and ``ObjectJointSpherical``. Modelica has ``Joints.Revolute``,
    ``Prismatic``, ``Spherical`` and ``Universal``. ``motor`` with a torque(t, angle, rate) replaces position and
    velocity actuators of MuJoCo, and ``friction`` its ``frictionloss`` and ``damping``. ``torsional_spring`` is
    ``TorsionalSpringDamper`` of exudyn, and a rotational ``zeroLength`` element with any uniaxial material of OpenSees.

    Not included: rigid limits of joints (MuJoCo's ``range``; take a ``Gap`` and a ``Cable``), armature, and friction
    that sticks.
    """

    scene: Description
    centre: Points
    axes: Points
    principal: np.ndarray

    def point(self, place: ArrayLike) -> Points:
        """Return a point that is fixed to the body, on which effects can act.

        Parameters
        ----------
        place : array_like, shape (..., dimension)
            In the frame of the body, whose origin is the centre of mass, m.
        """
        return self._carried(self._vectors(place, "place"), 1.0)

    def vector(self, direction: ArrayLike) -> Points:
        """Return a vector that is fixed to the body.

        Parameters
        ----------
        direction : array_like, shape (..., dimension)
            In the frame of the body.
        """
        return self._carried(self._vectors(direction, "direction"), 0.0)

    def at(self, position: ArrayLike) -> Points:
        """Return the point of the body that is at a position of the scene at the start, m."""
        return self.point(self._local(self._vectors(position, "position") - self.centre.position))

    def revolute(self, other: RigidBody | None, position: ArrayLike, axis: ArrayLike | None = None) -> None:
        """Add a revolute joint to another body, or to the ground, at a position, m; in space about an axis.

        Its reactions are the components of the force on the other body, or on the ground, N. In space, two torques on
        the body follow, N m: about the cross products of the axis with two unit vectors normal to it. These vectors are
        ``np.linalg.svd([axis])[2][1:]`` at the start, and turn with the other body, as the axis turns with the body.
        """
        self._check_axis(axis, "a revolute joint")
        across = [] if axis is None else self._frame(axis, "axis")
        self._join("revolute joint", self._pin(other, position), *self._turns(other, across[:1], across[1:]))

    def spherical(self, other: RigidBody | None, position: ArrayLike) -> None:
        """Add a ball joint in space to another body, or to the ground, at a position, m."""
        self._check_space("a spherical joint")
        self._join("spherical joint", self._pin(other, position))

    def universal(self, other: RigidBody | None, position: ArrayLike, axis: ArrayLike, other_axis: ArrayLike) -> None:
        """Add a universal joint in space to another body, or to the ground, at a position, m.

        The cross of the joint turns about `axis`, which is fixed in the body, and about `other_axis`, which is fixed
        in the other body. The axes are perpendicular. The reactions are the components of the force on the other body,
        or on the ground, N, and the torque on the body about the cross product of axis and other_axis, N m.
        """
        self._check_space("a universal joint")
        mine, theirs = self._frame(axis, "axis")[0], self._frame(other_axis, "other_axis")[0]
        if abs(mine @ theirs) > _UNIT:
            raise ValueError("axis and other_axis of a universal joint must be at right angles to each other.")
        self._join("universal joint", self._pin(other, position), *self._turns(other, [mine], [theirs]))

    def weld(self, other: RigidBody | None) -> None:
        """Fix the body to another body, or to the ground, with a `Weld`."""
        self.scene.add(Weld(), self, *([] if other is None else [other]))

    def prismatic(self, other: RigidBody | None, position: ArrayLike, direction: ArrayLike) -> None:
        """Add a prismatic joint: the body slides along a direction of another body or the ground, without rotation.

        Its reactions are the forces on the body along the unit vectors normal to the direction, which are
        ``np.linalg.svd([direction])[2][1:]``, N; then the torques on the body about the cross products of the direction
        with these vectors, and in space about the cross product of both vectors, N m.
        """
        ahead, *across = self._frame(direction, "direction")
        place = self._place_of(other, position)
        slides = [(Along(), place, self.at(position), self._of(other, vector)) for vector in across]
        turns = self._turns(other, [ahead], across) + self._turns(other, across[:1], across[1:])
        self._join("prismatic joint", *slides, *turns)

    def prescribed_angle(self, other: RigidBody | None, angle: Callable, axis: ArrayLike | None = None) -> None:
        """Prescribe the angle of the body relative to another body, or to the ground, as a function of time.

        In space, the body must have a revolute joint with the same axis. The reaction is the driving torque, N m.

        Parameters
        ----------
        other : RigidBody or None
        angle : jitted function
            ``angle(t) -> (angle, rate, acceleration)`` in rad, rad/s and rad/s^2; 0 is the position at the start.
        axis : array_like, shape (3,), optional
            In space, the axis of the joint; the angle is positive by the right-hand rule.
        """
        vectors = self._about(other, axis, "a prescribed angle")
        self._join("prescribed angle", ((PrescribedAngle if axis is None else PrescribedAngleInSpace)(angle), *vectors))

    def motor(self, other: RigidBody | None, torque: Callable, axis: ArrayLike | None = None) -> None:
        """Add a torque on the body, and the opposite torque on another body, or on the ground.

        In space, the body must have a revolute joint with the same axis.

        Parameters
        ----------
        other : RigidBody or None
        torque : jitted function
            ``torque(t)`` or ``torque(t, angle, rate)``, N m. The angle is the rotation relative to the other body since
            the start, from -pi to pi, rad; the rate is in rad/s. It has no parameters: for gains that differ between
            the members of an ensemble, or for an angle of whole turns, give `torsional_spring` a `Link` with fields,
            whose tension is minus the torque.
        axis : array_like, shape (3,), optional
            In space, the axis of the torque.
        """
        self._add_law(HingeMotor(torque), other, axis, "a motor")

    def torsional_spring(self, other: RigidBody | None, law: Link, axis: ArrayLike | None = None) -> None:
        """Add a link of `eig3.effects` for the angle of the body relative to another body, or to the ground.

        The link has the angle as its r, rad, and the torque as its tension, N m: a spring, a damper, a gap, or a
        plastic hinge such as ``ElasticPlastic(stiffness=8e7, yield_force=3e5)``. Its states and events have the names
        that they have between points. In space, the body must have a revolute joint with the same axis.

        Parameters
        ----------
        other : RigidBody or None
        law : Link
            The angle is 0 at the start, and from -pi to pi; ``rest_length`` is an angle too, and may be negative. A
            body that turns past half a turn gets the torque of the angle less a whole turn: it jumps there, and a note
            says so if the saved states show it. For a torque that depends on whole turns, take a `Link` whose state is
            the angle: its ``state_rate`` returns rate, and its ``tension`` reads state in place of r.
        axis : array_like, shape (3,), optional
            In space, the axis of the joint; the angle is positive by the right-hand rule.

        Raises
        ------
        TypeError, ValueError
            For what is not a link along one line, for impacts, and for a ``rest_length`` of half a turn or more.
        """
        self._add_law(law, other, axis, "a torsional spring")

    def friction(
        self,
        other: RigidBody | None,
        limit: float = 0.0,
        axis: ArrayLike | None = None,
        *,
        damping: float = 0.0,
        regularization_speed: float = 1e-2,
    ) -> None:
        """Add friction against rotation of the body relative to another body, or to the ground.

        The torque is -(limit / sqrt(rate^2 + regularization_speed^2) + damping) rate; rate is the relative angular
        rate. In space, the body must have a revolute joint with the same axis.

        Parameters
        ----------
        other : RigidBody or None
        limit : float
            The torque of Coulomb friction, N m.
        axis : array_like, shape (3,), optional
            In space, the axis of the joint.
        damping : float
            The coefficient of viscous friction, N m s.
        regularization_speed : float
            The rate at which Coulomb friction reaches 0.71 of its limit, rad/s. At lower rates it acts as a stiff
            damper: an explicit method then needs a short step, and the joint creeps where it should stick.
        """
        self._add_law(HingeFriction(limit, damping, regularization_speed), other, axis, "friction")

    def _add_law(self, law: Link, other: RigidBody | None, axis: ArrayLike | None, what: str) -> None:
        kind = HingeLaw if axis is None else HingeLawInSpace
        self.scene.add(kind(law), *self._about(other, axis, what))

    def _about(self, other: RigidBody | None, axis: ArrayLike | None, what: str) -> tuple[Points, ...]:
        """Return a vector normal to an axis for each body, and in space the axis as a vector of the other body."""
        self._check_axis(axis, what)
        if axis is None:
            across = np.array([1.0, 0.0])
            return self._facing(across), self._of(other, across)
        ahead, across, _ = self._frame(axis, "axis")
        return self._facing(across), self._of(other, across), self._of(other, ahead)

    def rotation(self, values: ArrayLike) -> np.ndarray:
        """Return the rotation of the body, from ``solution.u`` or displacements of shape (..., degrees of freedom).

        Returns
        -------
        ndarray, shape (...) in the plane, or (..., 4) in space
            The angle from the x axis, rad, between -pi and pi; or quaternions (x, y, z, w), as in SciPy.
        """
        vectors = self.axes.positions(np.asarray(values))
        matrix = np.swapaxes(vectors, -1, -2) @ self.principal.T
        if len(self.principal) == 2:
            return np.arctan2(matrix[..., 1, 0], matrix[..., 0, 0])
        from scipy.spatial.transform import Rotation

        return Rotation.from_matrix(matrix.reshape(-1, 3, 3)).as_quat().reshape(*matrix.shape[:-2], 4)

    def angular_velocity(self, u: ArrayLike, v: ArrayLike) -> np.ndarray:
        """Return the angular velocity, rad/s: of shape (...) in the plane, or (..., 3) in the frame of the scene."""
        e, rates = self.axes.positions(np.asarray(u)), self.axes.velocities(np.asarray(v))
        if len(self.principal) == 2:
            return (e[..., 0] * rates[..., 1] - e[..., 1] * rates[..., 0]).mean(axis=-1)
        return np.cross(e, rates).sum(axis=-2) / 2

    def _local(self, vectors: np.ndarray) -> np.ndarray:
        return np.asarray(vectors @ (self.axes.position.T @ self.principal.T))

    def _facing(self, vector: np.ndarray) -> Points:
        """Return the vector of the body that equals a given vector at the start."""
        return self.vector(self._local(vector))

    def _of(self, other: RigidBody | None, vector: np.ndarray) -> Points:
        """Return the vector of another body, or of the ground, that equals a given vector at the start."""
        self._check_other(other)
        if other is not None:
            return other._facing(vector)
        fixed = self.scene.fixed(vector)
        self.scene._bodies.vectors.append(int(fixed.numbers))
        return fixed

    def _pin(self, other: RigidBody | None, position: ArrayLike) -> tuple[Any, ...]:
        """Return the constraint of two points that coincide, one of each body."""
        place = self._place_of(other, position)
        return PointJoint(), self.at(position), place

    def _turns(self, other: RigidBody | None, mine: list[np.ndarray], theirs: list[np.ndarray]) -> list[tuple]:
        """Return constraints between each of some vectors of this body and each of some vectors of another one."""
        return [(Perpendicular(), self._facing(a), self._of(other, b)) for a in mine for b in theirs]

    def _join(self, kind: str, *constraints: tuple[Any, ...]) -> None:
        """Add the constraints of a joint, each an effect and its points; errors name the joint."""
        joints = self.scene._bodies.joints
        name = f"{kind} {len({name for name in joints.values() if name.startswith(kind)})}"
        for effect, *points in constraints:
            self.scene.add(effect, *points)
            joints[int(points[0].numbers)] = name

    def _points_of_weld(self, other: RigidBody | None) -> tuple[Points, ...]:
        """Return the centre and axes of this body as points of the other body or the ground, then as its own points."""
        theirs = [self._of(other, axis) for axis in self.axes.position]
        return self._place_of(other, self.centre.position), self.centre, *theirs, *self.axes

    def _check_axis(self, axis: ArrayLike | None, what: str) -> None:
        if axis is None and len(self.principal) == 3:
            raise ValueError(f"axis of {what} must be given in a scene of 3 dimensions.")
        if axis is not None and len(self.principal) == 2:
            raise ValueError(f"axis of {what} is for scenes of 3 dimensions: leave it out in the plane.")

    def _check_space(self, what: str) -> None:
        if len(self.principal) == 2:
            raise ValueError(
                f"{what} is for scenes of 3 dimensions; in the plane, take body.revolute(other, position)."
            )

    def _place_of(self, other: RigidBody | None, position: ArrayLike) -> Points:
        """Return the point of another body, or of the ground, that is at a position at the start."""
        self._check_other(other)
        place = self._vectors(position, "position", is_one=True)
        return self.scene.fixed(place) if other is None else other.at(place)

    def _check_other(self, other: RigidBody | None) -> None:
        if other is self or not isinstance(other, RigidBody | None):
            raise ValueError(
                "other must be another body, or None for the ground; for a mass take scene.add(PointJoint(), "
                "body.at(position), mass)."
            )

    def _frame(self, direction: ArrayLike, name: str) -> list[np.ndarray]:
        """Return a unit vector along a direction, and unit vectors that are perpendicular to it and to each other."""
        vector = self._vectors(direction, name, is_one=True)
        if not np.any(vector):
            raise ValueError(f"{name} must not be zero.")
        unit = vector / np.linalg.norm(vector)
        return [unit, *np.linalg.svd(unit[None])[2][1:]]

    def _vectors(self, given: ArrayLike, name: str, is_one: bool = False) -> np.ndarray:
        """Return vectors, or one vector, which must have a finite component for each dimension."""
        vectors, d = reals(given, name), len(self.principal)
        if vectors.shape[-1:] != (d,) or (is_one and vectors.ndim > 1) or not np.isfinite(vectors).all():
            raise ValueError(f"{name} must have {d} finite components, not {shown(given)}.")
        return vectors

    def _carried(self, local: np.ndarray, of_centre: float) -> Points:
        factors = np.concatenate([np.full((*local.shape[:-1], 1), of_centre), local @ self.principal], axis=-1)
        parts = np.append(self.centre.numbers, self.axes.numbers)
        return self.scene._carry(parts, factors, is_vector=not of_centre)


def principal_moments(inertia: ArrayLike, dimension: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the moments J_k of a body, and its principal axes as columns, from its inertia about its centre.

    Raises
    ------
    ValueError
        If no body can have the inertia, or only a thin rod.

    Notes
    -----
    A plate without thickness gets a thickness whose J_k is 1e-12 of the largest moment.
    """
    given = reals(inertia, "inertia")
    if dimension == 2:
        if given.ndim or not (np.isfinite(given) and given > 0):
            raise ValueError("inertia of a body in the plane must be a positive number, in kg m^2.")
        return np.full(2, given / 2), np.eye(2)
    tensor = np.diag(given) if given.shape == (3,) else given
    if tensor.shape != (3, 3) or not np.allclose(tensor, tensor.T, rtol=1e-9, atol=0) or not np.isfinite(tensor).all():
        raise ValueError("inertia of a body in space must be 3 principal moments or a symmetric 3 x 3 matrix, kg m^2.")
    moments, axes = np.linalg.eigh(tensor) if given.ndim == 2 else (given, np.eye(3))
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    squares, largest = moments.sum() / 2 - moments, abs(moments).max()
    margin = _MARGIN * largest
    if not (squares.min() >= -margin and moments.min() > margin):
        raise ValueError(
            "inertia of a body must have positive principal moments, each at most the sum of the others; a thin "
            "rod can be a Rod between masses."
        )
    return np.maximum(squares, _THIN * largest), axes


def plates(squares: np.ndarray, vectors: np.ndarray) -> list[list[int]]:
    """Return the vectors of a body if it has hardly any thickness, in cyclic order, with the normal of the plate last.

    The mass of the normal is so small that forces on it are better applied to the other two: see `BodiesText.plates`.
    """
    across = int(np.argmin(squares))
    is_plate = len(squares) == 3 and squares[across] < _PLATE * squares.max()
    return [np.roll(vectors, 2 - across).tolist()] if is_plate else []


def rotation_matrix(rotation: Any, dimension: int) -> np.ndarray:
    """Return the matrix of a rotation: an angle in the plane, or in space a matrix, a quaternion or SciPy's Rotation.

    Raises
    ------
    ValueError
        If it is not a rotation.
    """
    if rotation is None:
        return np.eye(dimension)
    given = reals(rotation.as_matrix() if hasattr(rotation, "as_matrix") else rotation, "rotation")
    if dimension == 2 and given.ndim == 0 and np.isfinite(given):
        return np.array([[np.cos(given), -np.sin(given)], [np.sin(given), np.cos(given)]])
    if dimension == 3 and given.shape == (4,) and np.linalg.norm(given) > 0:
        from scipy.spatial.transform import Rotation

        return np.asarray(Rotation.from_quat(given).as_matrix())
    is_matrix = given.shape == (3, 3) == (dimension, dimension)
    if is_matrix and np.linalg.det(given) > 0 and np.abs(given @ given.T - np.eye(3)).max() < _UNIT:
        return given
    kinds = {2: "an angle in rad", 3: "a quaternion (x, y, z, w), a 3 x 3 rotation matrix or a SciPy Rotation"}
    raise ValueError(f"rotation of a body in {dimension} dimensions must be {kinds[dimension]}, not {shown(rotation)}.")
