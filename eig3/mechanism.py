"""Scenes from the mechanisms in files."""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .effects import Gravity, LinearDamper, LinearSpring, Link
from .files.mjcf import GROUND, Joint, MechanismTable, read_mjcf
from .functions.callbacks import jit
from .functions.checks import reals
from .scene.bodies import Along, RigidBody
from .scene.description import Points
from .scene.effect import arguments
from .scene.joint_law import HingeLawInSpace, SlideLaw

_PARALLEL = 1e-9  # the largest sine or cosine of the angle of axes that are parallel or at right angles
_IN_JOINT = {"hinge": HingeLawInSpace, "slide": SlideLaw}


@dataclass(frozen=True, eq=False)
class JointMotor(Link):
    """A motor whose torque or force is a control between two limits, times a gear."""

    control: Callable
    gear: ArrayLike
    low: ArrayLike
    high: ArrayLike

    source = "prescribed by the user"

    @property
    def tension(self) -> Any:
        return _controlled(self.control, len(arguments(self.control)))


@dataclass(frozen=True, eq=False)
class FileOfMechanism:
    """A scene with the bodies, joints, constraints and gravity of a file.

    Attributes
    ----------
    scene : Scene
    bodies : dict of str to RigidBody or None
        By the name in the file; a body without a name has its number, such as "body 3". A body without joints is part
        of the body to which it is welded; None is the ground.
    sites : dict of str to Points
        The points of bodies or of the ground that have a name.
    motors : tuple of str
        The names of the motors, for `drive`.
    timestep : float
        Of the file, s.
    """

    scene: Any
    bodies: dict[str, RigidBody | None]
    sites: dict[str, Points]
    motors: tuple[str, ...]
    timestep: float
    _table: MechanismTable
    _moving: list[RigidBody]
    _driven: set[str] = field(default_factory=set)

    def drive(self, motor: str, control: float | Callable) -> None:
        """Give a motor its control. Without a control, a motor has no torque or force.

        Parameters
        ----------
        motor : str
            A name of `motors`.
        control : float or jitted function
            A number, ``control(t)``, or ``control(t, q, rate)`` with the angle of the joint, rad, from -pi to pi, or
            its displacement, m, since the start. The torque, N m, or the force, N, is the control, kept inside the
            ranges of the file, times the gear.

        Raises
        ------
        TypeError, ValueError
            If the file has no such motor, the motor has a control, or the control is no finite number and no such
            function.
        """
        found = self._table.motors.get(motor)
        if found is None:
            known = f"one of {', '.join(self.motors)}" if self.motors else "left out: the file has none"
            raise ValueError(f"motor must be {known}, not {motor!r}.")
        if motor in self._driven:
            raise ValueError(f"motor {motor!r} has a control already: read the file again for another.")
        limits = np.nan_to_num([found.low, found.high])  # no limit becomes the largest number
        if not callable(control):
            limits[:] = np.clip(float(reals(control, "control")), *limits)
        elif not hasattr(control, "py_func") or arguments(control) not in (("t",), ("t", "q", "rate")):
            raise TypeError(
                "control must be a number, or a jitted function of t, or of t, q and rate, with these names."
            )
        self._driven.add(motor)
        law = JointMotor(control if callable(control) else _steady, found.gear, *limits.tolist())
        _add_law(self._table, self._moving, found.body, found.joint, law)


@jit
def _steady(t):  # type: ignore[no-untyped-def]
    return 0.0  # the limits are both the control


@functools.cache
def _controlled(control: Any, count: int) -> Any:
    """Return the same function for the same control: scenes with the same functions share their code."""

    @jit
    def of_time(t, gear, low, high):  # type: ignore[no-untyped-def]
        return -gear * min(max(control(t), low), high)

    @jit
    def of_joint(t, r, rate, gear, low, high):  # type: ignore[no-untyped-def]
        return -gear * min(max(control(t, r, rate), low), high)

    return of_time if count == 1 else of_joint


def read_mechanism(kind: type, path: Path, ignore: Collection[str]) -> FileOfMechanism:
    """Read a file of MuJoCo, as `Scene.read` describes it."""
    table = read_mjcf(path, ignore)
    scene = kind(dimension=3)
    moving: list[RigidBody] = []
    for number, body in enumerate(table.bodies):
        mass, centre, inertia = body.mass_properties()
        if mass <= 0:
            raise ValueError(f"{path} must give a mass to the body {body.name!r}, which moves.")
        try:
            found = scene.body(mass, inertia, centre, body.rotation)
        except ValueError as error:
            raise ValueError(f"{path} has the body {body.name!r}, for which {error}") from None
        moving.append(found)
        if body.shapes:
            scene._bodies.shapes[int(found.centre.numbers)] = [
                (shape, found._local(x - centre) @ found.principal, found._local(axes) @ found.principal)
                for shape, x, axes in body.shapes
            ]
        _join(found, _numbered(moving, body.parent), body.joints)
        for joint in body.joints:
            _add_laws(table, moving, number, joint)
    for first, second, place in table.connects:
        _close(table, moving, first, second, place)
    for first, second in table.welds:
        _close(table, moving, first, second, None)
    if table.gravity.any():
        scene.add(Gravity(table.gravity))
    return FileOfMechanism(
        scene=scene,
        bodies={name: _numbered(moving, number) for name, number in table.numbers.items() if name != "world"},
        sites={name: _place(scene, _numbered(moving, number), x) for name, (number, x) in table.sites.items()},
        motors=tuple(table.motors),
        timestep=table.timestep,
        _table=table,
        _moving=moving,
    )


def _numbered(moving: list[RigidBody], number: int) -> RigidBody | None:
    return None if number == GROUND else moving[number]


def _place(scene: Any, body: RigidBody | None, position: np.ndarray) -> Points:
    return scene.fixed(position) if body is None else body.at(position)


def _add_laws(table: MechanismTable, moving: list[RigidBody], number: int, joint: Joint) -> None:
    """Add the spring and the damper of a joint."""
    if joint.kind not in _IN_JOINT:
        return
    if joint.stiffness:
        _add_law(table, moving, number, joint, LinearSpring(joint.stiffness, joint.rest))
    if joint.damping:
        _add_law(table, moving, number, joint, LinearDamper(joint.damping))


def _add_law(table: MechanismTable, moving: list[RigidBody], number: int, joint: Joint, law: Link) -> None:
    """Add a law for the angle of a hinge, or for the displacement of a slide."""
    body, of = moving[number], table.bodies[number]
    parent = _numbered(moving, of.parent)
    if joint.kind == "hinge":
        places = body._about(parent, joint.axis, "a joint")
    else:
        anchor = of.joints[-1].anchor  # a hinge after slides turns about its anchor
        places = body.at(anchor), body._place_of(parent, anchor), body._of(parent, joint.axis)
    body.scene.add(_IN_JOINT[joint.kind](law), *places)


def _join(body: RigidBody, parent: RigidBody | None, joints: list[Joint]) -> None:
    """Add the joints of a body with its parent, as constraints of the motions that they do not allow."""
    slides = [joint.axis for joint in joints if joint.kind == "slide"]
    hinges = [joint.axis for joint in joints if joint.kind == "hinge"]
    kinds, anchor = [joint.kind for joint in joints], joints[-1].anchor
    if kinds == ["free"]:
        return
    if kinds == ["hinge"]:
        body.revolute(parent, anchor, hinges[0])
    elif kinds == ["slide"]:
        body.prismatic(parent, anchor, slides[0])
    elif kinds == ["ball"]:
        body.spherical(parent, anchor)
    else:
        across = np.linalg.svd(np.array(slides).reshape(-1, 3))[2][len(slides) :]
        body._join("joint", *_pinned(body, parent, anchor, across), *_turns(body, parent, kinds, hinges))


def _pinned(body: RigidBody, other: RigidBody | None, place: np.ndarray, across: np.ndarray) -> list[tuple[Any, ...]]:
    """Return the constraints that a point of both bodies stays the same across some directions."""
    if len(across) == 3:
        return [body._pin(other, place)]
    theirs, mine = body._place_of(other, place), body.at(place)
    return [(Along(), theirs, mine, body._of(other, direction)) for direction in across]


def _turns(body: RigidBody, parent: RigidBody | None, kinds: list[str], hinges: list[np.ndarray]) -> list[tuple]:
    """Return the constraints of the rotation that joints do not allow."""
    if "ball" in kinds or len(hinges) == 3:
        return []
    if len(hinges) == 2:
        return body._turns(parent, hinges[1:], hinges[:1])
    first, *across = body._frame(hinges[0] if hinges else np.array([1.0, 0.0, 0.0]), "axis")
    locked = body._turns(parent, [first], across)
    return locked if hinges else locked + body._turns(parent, across[:1], across[1:])


def _close(table: MechanismTable, moving: list[RigidBody], first: int, second: int, place: np.ndarray | None) -> None:
    """Join two bodies in a point, or weld them. In a loop that moves in a plane, only motion in the plane is left."""
    if first == GROUND:
        first, second = second, first
    body, other = moving[first], _numbered(moving, second)
    kind, point = ("weld", body.centre.position) if place is None else ("connect", place)
    normal = _normal_of_loop(table, first, second)
    if normal is None:
        constraints = [body._pin(other, point)]
        across = np.eye(3)
    else:
        across = np.array(body._frame(normal, "axis")[1:])
        constraints = _pinned(body, other, point, across)
    if place is None:
        pairs = [(0, 1)] if normal is not None else [(0, 1), (1, 2), (2, 0)]
        constraints += [part for i, k in pairs for part in body._turns(other, [across[i]], [across[k]])]
    body._join(kind, *constraints)


def _normal_of_loop(table: MechanismTable, first: int, second: int) -> np.ndarray | None:
    """Return the normal of the plane in which the bodies between two bodies move relative to each other, if any."""
    paths = [_ancestors(table, number) for number in (first, second)]
    joints = [joint for number in set(paths[0]) ^ set(paths[1]) for joint in table.bodies[number].joints]
    hinges = [joint.axis for joint in joints if joint.kind == "hinge"]
    if not hinges or {joint.kind for joint in joints} - {"hinge", "slide"}:
        return None
    normal = hinges[0]
    is_flat = all(np.linalg.norm(np.cross(normal, axis)) < _PARALLEL for axis in hinges)
    is_flat &= all(abs(normal @ joint.axis) < _PARALLEL for joint in joints if joint.kind == "slide")
    return normal if is_flat else None


def _ancestors(table: MechanismTable, number: int) -> list[int]:
    found = []
    while number != GROUND:
        found.append(number)
        number = table.bodies[number].parent
    return found
