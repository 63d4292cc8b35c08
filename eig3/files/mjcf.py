"""Mechanisms in the format of MuJoCo (MJCF): bodies, joints, constraints and motors at the start, in SI units."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from itertools import combinations, islice
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from .mjcf_elements import Elements, Pose
from .solids import SIZES, mass_properties, semi_axes

GROUND = -1  # the number of the body that does not move
_DENSITY = "1000"  # kg/m^3
_NOT_SOLID = ("plane", "hfield", "mesh", "sdf")
_HARMLESS = ("site", "camera", "light")  # members of bodies; sites are read
_STEEP = 0.99  # the largest cosine of the angle of two hinges that cross
_COINCIDENT = 1e-9  # the largest distance of two sites that are one point, m


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint of a body with its parent.

    Attributes
    ----------
    name, kind : str
        The kind is "free", "ball", "hinge" or "slide".
    anchor, axis : ndarray, shape (3,)
        In the frame of the scene; the axis is a unit vector.
    stiffness, rest, damping : float
        Of the spring and the damper of a hinge or a slide; the rest is the angle or the displacement from the start.
    """

    name: str
    kind: str
    anchor: np.ndarray
    axis: np.ndarray
    stiffness: float = 0.0
    rest: float = 0.0
    damping: float = 0.0


@dataclass(eq=False)
class MovingBody:
    """A body with joints, and the bodies without joints that are welded to it.

    Attributes
    ----------
    name : str
    parent : int
        The number of the body to which the joints lead, or `GROUND`.
    rotation : ndarray, shape (3, 3)
        From the frame of the body to the frame of the scene.
    joints : list of Joint
    parts : list of (float, ndarray, ndarray)
        The mass, the centre of mass and the inertia about it of each part, in the frame of the scene.
    shapes : list of (str, ndarray, ndarray)
        For pictures: the kind, the centre, and the semi-axes as rows, in the frame of the scene.
    """

    name: str
    parent: int
    rotation: np.ndarray
    joints: list[Joint]
    parts: list[tuple[float, np.ndarray, np.ndarray]] = field(default_factory=list)
    shapes: list[tuple[str, np.ndarray, np.ndarray]] = field(default_factory=list)

    def mass_properties(self) -> tuple[float, np.ndarray, np.ndarray]:
        """Return the mass, the centre of mass, and the inertia about it in the frame of the body."""
        mass = sum(m for m, _, _ in self.parts)
        centre = sum((m * x for m, x, _ in self.parts), np.zeros(3)) / (mass or 1.0)
        inertia = np.zeros((3, 3))
        for m, x, about_centre in self.parts:
            d = x - centre
            inertia += about_centre + m * (d @ d * np.eye(3) - np.outer(d, d))
        turned = self.rotation.T @ inertia @ self.rotation
        return mass, centre, (turned + turned.T) / 2


class Motor(NamedTuple):
    """An actuator ``motor``: the body and its joint, the gear, and the least and the largest control."""

    body: int
    joint: Joint
    gear: float
    low: float
    high: float


@dataclass(eq=False)
class MechanismTable:
    """The content of a file with a mechanism.

    Attributes
    ----------
    bodies : list of MovingBody
        Each body comes after its parent.
    numbers : dict of str to int
        By the name in the file: the number of the body that moves with it, or `GROUND`.
    sites : dict of str to (int, ndarray)
        The number of the body, and the position in the frame of the scene.
    connects : list of (int, int, ndarray)
        The numbers of two bodies, and the position of the point that they share.
    welds : list of (int, int)
    motors : dict of str to Motor
    gravity : ndarray, shape (3,)
    timestep : float
    """

    bodies: list[MovingBody] = field(default_factory=list)
    numbers: dict[str, int] = field(default_factory=lambda: {"world": GROUND})
    sites: dict[str, tuple[int, np.ndarray]] = field(default_factory=dict)
    connects: list[tuple[int, int, np.ndarray]] = field(default_factory=list)
    welds: list[tuple[int, int]] = field(default_factory=list)
    motors: dict[str, Motor] = field(default_factory=dict)
    gravity: np.ndarray = field(default_factory=lambda: np.zeros(3))
    timestep: float = 0.002


def read_mjcf(path: Path, ignore: Collection[str] = ()) -> MechanismTable:
    """Read a mechanism. What would change the motion and is not in a scene gets an error, unless it is ignored."""
    return _Reader(path, ignore).table


class _Collider(NamedTuple):
    """A geom that may touch others: its name, the number and the name of its body, and its bits."""

    name: str
    body: int
    of: str
    types: int
    affinity: int


class _Reader:
    def __init__(self, path: Path, ignore: Collection[str]) -> None:
        self._elements = elements = Elements(path, ignore)
        elements.check_sections()
        self.table = table = MechanismTable()
        self._poses = {"world": Pose(np.zeros(3), elements.pose({}).rotation)}
        self._orientations: dict[str, Any] = {}  # of sites
        self._joints: dict[str, tuple[int, Joint]] = {}
        self._colliders: list[_Collider] = []
        for world in elements.sections("worldbody"):
            for member in self._members(world, self._poses["world"], ""):
                self._add_member(member[0], "world", GROUND, *member[1:])
        if "gravity" not in elements.disabled:
            table.gravity = elements.numbers(elements.options, "gravity", "0 0 -9.81", 3)
        table.timestep = float(elements.numbers(elements.options, "timestep", "0.002", 1)[0])
        for element in elements.inside("equality") if "equality" not in elements.disabled else ():
            self._add_equality(element)
        for element in elements.inside("actuator") if "actuation" not in elements.disabled else ():
            self._add_actuator(element)
        for element in elements.inside("tendon"):
            elements.omit("tendon", elements.name(element))
        if "contact" not in elements.disabled:
            self._check_contacts()
        elements.check_omissions()

    def _members(self, body: Element, pose: Pose, default: str) -> Iterator[tuple[Element, Pose, str]]:
        """Yield the elements in a body, also inside frames, with their parent frame and default class."""
        for element in body:
            if element.tag == "frame":
                values = self._elements.attributes(element)
                inner = pose.then(self._elements.pose(values))
                yield from self._members(element, inner, values.get("childclass", default))
            else:
                yield element, pose, default

    def _add_member(self, element: Element, of: str, body: int, pose: Pose, default: str) -> None:
        """Add an element inside a body with a name, which moves as the body of a number."""
        if element.tag == "body":
            self._add_body(element, body, pose, default)
        elif element.tag == "geom":
            self._add_geom(element, of, body, pose, default)
        elif element.tag == "site":
            values = self._elements.attributes(element, default)
            place = pose.then(self._placed(values)[0])
            self.table.sites[values.get("name", f"site {len(self.table.sites)}")] = body, place.origin
            self._orientations[values.get("name", "")] = place.rotation
        elif element.tag not in (*_HARMLESS, "inertial", "joint", "freejoint"):
            self._elements.refuse(f"the element {element.tag}")

    def _add_body(self, element: Element, parent: int, outer: Pose, default: str) -> None:
        elements, table = self._elements, self.table
        values = elements.attributes(element)
        name = values.get("name", f"body {len(table.numbers)}")
        pose = outer.then(elements.pose(values))
        members = list(self._members(element, pose, values.get("childclass", default)))
        joints = [self._joint(*member) for member in members if member[0].tag in ("joint", "freejoint")]
        body = parent
        if joints:
            body = len(table.bodies)
            self._check_joints(joints, elements.name(element))
            table.bodies.append(MovingBody(name, parent, pose.rotation.as_matrix(), joints))
            self._joints |= {joint.name: (body, joint) for joint in joints if joint.name}
        table.numbers[name], self._poses[name] = body, pose
        inertial = element.find("inertial")
        policy = elements.options.get("inertiafromgeom", "auto")
        is_from_geoms = policy == "true" or (policy == "auto" and inertial is None)
        for member in members:
            if member[0].tag == "geom":
                self._add_geom(member[0], name, body, *member[1:], is_from_geoms)
            else:
                self._add_member(member[0], name, body, *member[1:])
        if inertial is not None and not is_from_geoms and body != GROUND:
            table.bodies[body].parts.append(self._inertial(inertial, pose))

    def _joint(self, element: Element, pose: Pose, default: str) -> Joint:
        elements = self._elements
        values = elements.attributes(element, default)
        kind = "free" if element.tag == "freejoint" else values.get("type", "hinge")
        named = elements.name(element)
        if "limit" not in elements.disabled and elements.is_limited(values, "limited", "range") and kind != "free":
            elements.omit("range", named)
        if elements.is_limited(values, "actuatorfrclimited", "actuatorfrcrange"):
            elements.omit("actuatorfrcrange", named)
        law = [elements.numbers(values, key, "0") for key in ("stiffness", "damping")]
        for key, flag, x in zip(("stiffness", "damping"), ("spring", "damper"), law, strict=True):
            if flag in elements.disabled:
                x[:] = 0.0
            if x[1:].any() or (x.any() and kind in ("free", "ball")):
                elements.omit(key, f"of {named}")
        rest = float(np.subtract(*(elements.numbers(values, key, "0", 1) for key in ("springref", "ref")))[0])
        axis = pose.rotation.apply(elements.numbers(values, "axis", "0 0 1", 3))
        if not axis.any():
            elements.refuse(f"axis='0 0 0' in {named}")
        return Joint(
            name=values.get("name", ""),
            kind=kind,
            anchor=pose.at(elements.numbers(values, "pos", "0 0 0", 3)),
            axis=axis / np.linalg.norm(axis),
            stiffness=float(law[0][0]),
            rest=elements.angle(rest) if kind == "hinge" else rest,
            damping=float(law[1][0]),
        )

    def _check_joints(self, joints: list[Joint], named: str) -> None:
        """Refuse joints whose combination no joint of a scene has. Slides come first, because axes turn with hinges."""
        kinds = [joint.kind for joint in joints]
        turning = [joint for joint in joints if joint.kind != "slide"]
        turns = np.array([joint.axis for joint in turning])
        slides = np.array([joint.axis for joint in joints if joint.kind == "slide"]).reshape(-1, 3)
        is_one_point = all(np.linalg.norm(joint.anchor - turning[0].anchor) < _COINCIDENT for joint in turning)
        is_apart = _are_square(turns) or (len(turns) == 2 and abs(turns[0] @ turns[1]) < _STEEP)
        is_known = len(turning) < 2 or (set(kinds) <= {"hinge", "slide"} and is_one_point and is_apart)
        is_ordered = kinds == sorted(kinds, key=lambda kind: kind != "slide")
        is_known &= is_ordered and "free" not in kinds and _are_square(slides)
        if not (is_known or kinds == ["free"]):
            self._elements.refuse(
                f"the joints {', '.join(kinds)} in {named}, instead of slides at right angles and then a ball, a "
                "hinge, two hinges that cross, or three hinges at right angles in one point"
            )
        for joint in joints:
            if joint.kind == "hinge" and joint.stiffness and abs(joint.rest) >= np.pi:
                self._elements.refuse(f"a springref half a turn or more from ref in joint {joint.name!r} of {named}")
            if joint.kind == "hinge" and len(turning) > 1:
                for key in ("stiffness", "damping"):
                    if getattr(joint, key):
                        self._elements.omit(key, f"of joint {joint.name!r} with another hinge in {named}")

    def _inertial(self, element: Element, pose: Pose) -> tuple[float, np.ndarray, np.ndarray]:
        elements = self._elements
        values = elements.attributes(element)
        own = pose.then(elements.pose(values))
        if "fullinertia" in values:
            xx, yy, zz, xy, xz, yz = elements.numbers(values, "fullinertia", count=6)
            inertia = np.array([(xx, xy, xz), (xy, yy, yz), (xz, yz, zz)])
        else:
            inertia = np.diag(elements.numbers(values, "diaginertia", "0 0 0", 3))
        turn = own.rotation.as_matrix()
        return float(elements.numbers(values, "mass", count=1)[0]), own.origin, turn @ inertia @ turn.T

    def _placed(self, values: dict[str, str]) -> tuple[Pose, np.ndarray]:
        """Return the frame of a geom or a site in its parent, and its sizes."""
        elements = self._elements
        size = elements.numbers(values, "size", "0.005")
        if "fromto" not in values:
            return elements.pose(values), size
        start, end = elements.numbers(values, "fromto", count=6).reshape(2, 3)
        half = np.linalg.norm(end - start) / 2
        radii = size[:1].repeat(2 if values.get("type") in ("box", "ellipsoid") else 1)
        return Pose((start + end) / 2, elements.along(start - end)), np.append(radii, half)

    def _add_geom(
        self, element: Element, of: str, body: int, outer: Pose, default: str, has_mass: bool = False
    ) -> None:
        elements = self._elements
        values = elements.attributes(element, default)
        kind = values.get("type", "mesh" if "mesh" in values else "sphere")
        types, affinity = (int(values.get(key, "1")) for key in ("contype", "conaffinity"))
        self._colliders.append(_Collider(elements.name(element), body, of, types, affinity))
        if body == GROUND or (kind not in SIZES and kind not in _NOT_SOLID):
            return
        least, most = elements.numbers(elements.options, "inertiagrouprange", "0 5", 2)
        has_mass &= least <= int(values.get("group", "0")) <= most
        has_mass &= values.get("mass") is None or float(values["mass"]) > 0
        if kind in _NOT_SOLID or "mesh" in values:
            if has_mass:
                elements.refuse(f"a {kind} with a mass: give the body an inertial element")
            return
        pose, size = self._placed(values)
        if size.size < SIZES[kind]:
            elements.refuse(f"{size.size} sizes of {elements.name(element)}, not {SIZES[kind]}")
        size, pose = size[: SIZES[kind]], outer.then(pose)
        turn = pose.rotation.as_matrix()
        shape, lengths = semi_axes(kind, size)
        moving = self.table.bodies[body]
        moving.shapes.append((shape, pose.origin, lengths[:, None] * turn.T))
        if has_mass:
            volume, moments = mass_properties(kind, size)
            density = float(values["mass"]) / volume if "mass" in values else float(values.get("density", _DENSITY))
            moving.parts.append((density * volume, pose.origin, turn @ np.diag(density * moments) @ turn.T))

    def _add_equality(self, element: Element) -> None:
        elements, table = self._elements, self.table
        if element.tag not in ("connect", "weld"):
            elements.omit("equality", elements.name(element))
            return
        values = elements.attributes(element)
        if values.get("active", "true") == "false":
            return
        if "site1" in values:
            names = values["site1"], values["site2"]
            unknown = [name for name in names if name not in table.sites]
            if unknown:
                elements.refuse(f"no site {unknown[0]!r}, but a constraint of it")
            (first, place), (second, other) = (table.sites[name] for name in names)
            turns = [self._orientations[name] for name in names]
            is_turned = element.tag == "weld" and (turns[0].inv() * turns[1]).magnitude() > _COINCIDENT
            if np.linalg.norm(place - other) > _COINCIDENT or is_turned:
                elements.refuse(f"sites of {elements.name(element)} that are apart at the start")
        else:
            first, second = (self._number(values.get(key, "world")) for key in ("body1", "body2"))
            anchor = elements.numbers(values, "anchor", "0 0 0", 3)
            place = self._poses[values.get("body1", "world")].at(anchor)
        if first == second:  # parts of one rigid body
            return
        if element.tag == "connect":
            table.connects.append((first, second, place))
        else:
            table.welds.append((first, second))

    def _number(self, name: str) -> int:
        if name not in self.table.numbers:
            self._elements.refuse(f"no body {name!r}, but a constraint of it")
        return self.table.numbers[name]

    def _add_actuator(self, element: Element) -> None:
        elements = self._elements
        joint = element.get("joint", element.get("jointinparent"))
        body, found = self._joints.get(joint or "", (GROUND, None))
        turns = [x for x in self.table.bodies[body].joints if x.kind == "hinge"] if found else []
        if element.tag != "motor" or found is None or not (found.kind == "slide" or turns == [found]):
            elements.omit("actuator", elements.name(element))
            return
        values = elements.attributes(element)
        low, high = -np.inf, np.inf
        for flag, key in (("ctrllimited", "ctrlrange"), ("forcelimited", "forcerange")):
            is_on = key == "forcerange" or "clampctrl" not in elements.disabled
            if is_on and elements.is_limited(values, flag, key):
                low, high = np.clip([low, high], *elements.numbers(values, key, count=2))
        gear = float(elements.numbers(values, "gear", "1")[0])
        name = values.get("name", f"motor {len(self.table.motors)}")
        self.table.motors[name] = Motor(body, found, gear, float(low), float(high))

    def _check_contacts(self) -> None:
        """Note the first geoms that may touch."""
        elements = self._elements
        excluded = set()
        for element in elements.inside("contact"):
            if element.tag == "exclude":
                values = elements.attributes(element)
                excluded.add(frozenset((values["body1"], values["body2"])))
            else:
                elements.omit("contact", f"of {element.get('geom1')!r} and {element.get('geom2')!r}")
        for a, b in islice(self._touching(excluded), 2):
            elements.omit("contact", f"of {a.name} and {b.name}")

    def _touching(self, excluded: set[frozenset[str]]) -> Iterator[tuple[_Collider, _Collider]]:
        """Yield the pairs of geoms that may touch, by the rules of MuJoCo."""
        bodies = self.table.bodies
        for a, b in combinations(self._colliders, 2):
            may_touch = (a.types & b.affinity) | (b.types & a.affinity)
            if not may_touch or a.body == b.body or frozenset((a.of, b.of)) in excluded:
                continue
            parents = [(x.body, bodies[y.body].parent) for x, y in ((a, b), (b, a)) if GROUND not in (x.body, y.body)]
            if "filterparent" in self._elements.disabled or all(x != parent for x, parent in parents):
                yield a, b


def _are_square(axes: np.ndarray) -> bool:
    """Whether unit vectors, the rows, are at right angles to each other."""
    return bool(np.abs(axes @ axes.T - np.eye(len(axes))).max(initial=0.0) < _COINCIDENT)
