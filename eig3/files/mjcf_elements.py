"""The elements of a MuJoCo file (MJCF) with their default attributes, and what a scene cannot have.

The format is described at https://mujoco.readthedocs.io/en/stable/XMLreference.html. An attribute that neither is read
nor leaves the motion as it is gets an error, so that a scene does not move in another way than the model.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple, NoReturn
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from .libraries import library

#: What can be left out of a scene: the names that `ignore` takes.
OMISSIONS = (
    *("actuator", "actuatorfrcrange", "armature", "contact", "damping", "equality", "fluid", "frictionloss"),
    *("gravcomp", "range", "springyield", "stiffness", "tendon"),
)
_ORIENTATIONS = "quat axisangle euler xyaxes zaxis"
_NAMED = f"name class childclass pos group user {_ORIENTATIONS}"

#: By the element: the attributes that are read or do not change the motion.
_KNOWN = {
    "compiler": "angle autolimits eulerseq inertiafromgeom inertiagrouprange alignfree assetdir conflict discardvisual "
    "fitaabb fusestatic meshdir passthrough savecanonical savecompiled saveinertial strippath texturedir usethread",
    "option": "gravity timestep apirate ccd_iterations ccd_tolerance collision cone impratio "
    "integrator iterations jacobian ls_iterations ls_tolerance magnetic mpr_iterations mpr_tolerance noslip_iterations "
    "noslip_tolerance o_friction o_margin o_solimp o_solref sdf_initpoints sdf_iterations sleep_tolerance solver "
    "tolerance density viscosity wind",
    "body": f"{_NAMED} gravcomp mocap sleep fuse simple",
    "frame": _NAMED,
    "inertial": f"{_NAMED} mass diaginertia fullinertia",
    "joint": "name class type pos axis stiffness damping ref springref range limited armature frictionloss springyield "
    "actuatorfrcrange actuatorfrclimited actuatorgravcomp group user margin solimpfriction solimplimit solreffriction "
    "solreflimit",
    "freejoint": "name group align",
    "geom": f"{_NAMED} type size fromto mass density contype conaffinity mesh adhesion castshadow condim fitscale "
    "fluidcoef fluidshape friction gap hfield margin material priority rgba solimp solmix solref surfacevel",
    "site": f"{_NAMED} type size fromto material mesh rgba",
    "connect": "name class active solref solimp body1 body2 anchor site1 site2",
    "weld": "name class active solref solimp body1 body2 anchor torquescale site1 site2",
    "motor": "name class joint jointinparent gear ctrlrange ctrllimited forcerange forcelimited armature damping group "
    "user lengthrange",
    "exclude": "name body1 body2",
}

#: The values of other attributes that leave the motion as it is.
_NEUTRAL = {
    "actuatorgroupdisable": "",
    "balanceinertia": "false",
    "coordinate": "local",
    "settotalmass": "-1",
    "shellinertia": "false",
}

#: Attributes that may be left out, and by which name.
_OMITTED = {
    "option": {"density": "fluid", "viscosity": "fluid"},
    "body": {"gravcomp": "gravcomp"},
    "joint": {name: name for name in ("armature", "frictionloss", "springyield")},
    "motor": {"armature": "armature", "damping": "damping"},
}
#: The flags that disable what other flags do; versions of MuJoCo before 3.3.3 have passive.
_GROUPS = {"constraint": {"contact", "equality", "frictionloss", "limit"}, "passive": {"spring", "damper"}}
_ACTUATORS = {
    *("general", "motor", "position", "velocity", "intvelocity", "damper", "cylinder", "muscle", "adhesion"),
    *("dcmotor", "pid", "plugin"),
}


class Pose(NamedTuple):
    """A frame in the frame of the scene: its origin, m, and its rotation, a SciPy ``Rotation``."""

    origin: np.ndarray
    rotation: Any

    def at(self, place: np.ndarray) -> np.ndarray:
        return self.origin + self.rotation.apply(place)

    def then(self, inner: Pose) -> Pose:
        return Pose(self.at(inner.origin), self.rotation * inner.rotation)


class Elements:
    """The elements of a file, with the files that it includes.

    `ignore` has names of `OMISSIONS`: what the scene does not have. `options` has the attributes of ``compiler`` and
    ``option``, and `disabled` the flags that are set to "disable".
    """

    def __init__(self, path: Path, ignore: Collection[str]) -> None:
        ignore = [ignore] if isinstance(ignore, str) else ignore
        unknown = sorted(set(ignore) - set(OMISSIONS))
        if unknown:
            raise ValueError(f"ignore must have names of {', '.join(OMISSIONS)}, not {unknown[0]!r}.")
        self._rotations = library("scipy.spatial.transform", ".xml", "mechanisms").Rotation
        self.path, self._ignore = path, set(ignore)
        self._found: dict[str, list[str]] = {}
        self._root = self._included(path)
        if self._root.tag != "mujoco":
            self.refuse(f"the element {self._root.tag}, and not mujoco, at its top")
        self._classes: dict[str, dict[str, dict[str, str]]] = {"main": {}}
        for element in self._root.findall("default"):
            if element.get("class", "main") != "main":
                self.refuse(f"class={element.get('class')!r}, and not 'main', in the default at its top")
            self._add_defaults(element, self._classes["main"])
        flags: dict[str, str] = {}
        for element in self._root.findall("option/flag"):
            flags |= element.attrib
        self.disabled = {name for name, value in flags.items() if value == "disable"}
        for group, parts in _GROUPS.items():
            if group in self.disabled:
                self.disabled |= parts
        self.options: dict[str, str] = {}
        for kind in ("compiler", "option"):
            for element in self._root.findall(kind):
                self.options |= self.attributes(element)
        self._is_in_degrees = self.options.get("angle", "degree") == "degree"

    def refuse(self, what: str) -> NoReturn:
        raise ValueError(f"{self.path} has {what}, which is not supported.")

    def omit(self, name: str, what: str) -> None:
        """Note that the file has something that a scene would leave out."""
        if name not in self._ignore:
            self._found.setdefault(name, []).append(what)

    def check_omissions(self) -> None:
        """Raise an error that names everything that a scene would leave out."""
        if not self._found:
            return
        known = [f"{name} ({some[0]}{', ...' * (len(some) > 1)})" for name, some in self._found.items()]
        raise ValueError(
            f"{self.path} has what a scene does not have: {', '.join(known)}. To leave it out of the motion, give "
            f"ignore={tuple(self._found)!r}."
        )

    def sections(self, kind: str) -> list[Element]:
        return self._root.findall(kind)

    def inside(self, kind: str) -> Iterator[Element]:
        """Yield the elements inside all sections of a kind."""
        for section in self.sections(kind):
            yield from section

    def check_sections(self) -> None:
        """Refuse sections that may change the motion and are not read."""
        known = "actuator asset compiler contact custom default equality keyframe option sensor size statistic tendon"
        for section in self._root:
            if section.tag not in (*known.split(), "visual", "worldbody"):
                self.refuse(f"the element {section.tag}")

    def attributes(self, element: Element, children_class: str = "") -> dict[str, str]:
        """Return the attributes of an element with the defaults of its class, and check that they are supported."""
        kind = element.tag if element.tag != "worldbody" else "body"
        group = "actuator" if kind in _ACTUATORS else "equality" if kind in ("connect", "weld") else kind
        name = element.get("class") or children_class or "main"
        if name not in self._classes:
            self.refuse(f"the class {name!r} without a default")
        inherited = self._classes[name].get(group, {})
        known = _KNOWN[kind].split()
        if group == "actuator":  # all kinds share their defaults; a motor does not read the rest
            inherited = {key: value for key, value in inherited.items() if key in known}
        found = {**inherited, **element.attrib}
        for key, value in found.items():
            named = f"{key} of {self.name(element)}"
            if key not in known and not self._is_neutral(key, value):
                self.refuse(f"{key}={value!r} in {self.name(element)}")
            if key in _OMITTED.get(kind, {}) and not self._is_neutral(key, value) and key not in self.disabled:
                self.omit(_OMITTED[kind][key], named)
        return found

    def name(self, element: Element) -> str:
        """Return the words for an element in errors."""
        given = element.get("name")
        return f"{element.tag} {given!r}" if given else f"{'an' if element.tag[0] in 'aeiou' else 'a'} {element.tag}"

    def numbers(self, values: Mapping[str, str], key: str, default: str = "", count: int = 0) -> np.ndarray:
        """Return the numbers of an attribute, which must be `count` if it is given."""
        text = values.get(key, default)
        try:
            found = np.array([float(word) for word in text.split()])
        except ValueError:
            self.refuse(f"{key}={text!r}, not numbers")
        if (count and found.size != count) or not np.isfinite(found).all():
            self.refuse(f"{key}={text!r}, not {count or 'finite'} numbers")
        return found

    def angle(self, value: float) -> float:
        return math.radians(value) if self._is_in_degrees else value

    def is_limited(self, values: Mapping[str, str], flag: str, key: str) -> bool:
        """Whether a range is in effect."""
        given = values.get(flag, "auto")
        return given == "true" or (given == "auto" and key in values and self.options.get("autolimits") != "false")

    def pose(self, values: Mapping[str, str]) -> Pose:
        """Return the frame of an element in the frame of its parent."""
        return Pose(self.numbers(values, "pos", "0 0 0", 3), self._rotation(values))

    def along(self, direction: np.ndarray) -> Any:
        """Return the least rotation of the z axis to a direction."""
        axis = np.array([-direction[1], direction[0], 0.0])
        sine = np.linalg.norm(axis)
        axis = axis / sine if sine else np.array([1.0, 0.0, 0.0])
        return self._rotations.from_rotvec(math.atan2(sine, direction[2]) * axis)

    def _rotation(self, values: Mapping[str, str]) -> Any:
        given = [key for key in _ORIENTATIONS.split() if key in values]
        if len(given) > 1:
            self.refuse(f"{' and '.join(given)} in one element")
        if not given:
            return self._rotations.identity()
        key = given[0]
        x = self.numbers(values, key, count={"euler": 3, "xyaxes": 6, "zaxis": 3}.get(key, 4))
        if key == "quat":
            return self._rotations.from_quat(np.roll(x, -1))
        if key == "axisangle":
            return self._rotations.from_rotvec(self.angle(x[3]) * x[:3] / np.linalg.norm(x[:3]))
        if key == "zaxis":
            return self.along(x)
        if key == "xyaxes":
            first = x[:3] / np.linalg.norm(x[:3])
            second = x[3:] - x[3:] @ first * first
            second /= np.linalg.norm(second)
            return self._rotations.from_matrix(np.column_stack([first, second, np.cross(first, second)]))
        turned = self._rotations.identity()
        for letter, turn in zip(self.options.get("eulerseq", "xyz"), x, strict=True):
            one = self._rotations.from_euler(letter.lower(), self.angle(turn))
            turned = turned * one if letter.islower() else one * turned
        return turned

    def _is_neutral(self, key: str, value: str) -> bool:
        if key in _NEUTRAL:
            return value == _NEUTRAL[key]
        return not value.replace(".", "").replace(" ", "").strip("-0")

    def _add_defaults(self, element: Element, inherited: dict[str, dict[str, str]]) -> None:
        own = {kind: dict(values) for kind, values in inherited.items()}
        self._classes[element.get("class", "main")] = own
        for child in element:
            if child.tag != "default":
                group = "actuator" if child.tag in _ACTUATORS else child.tag
                own[group] = {**own.get(group, {}), **child.attrib}
        for child in element.findall("default"):
            self._add_defaults(child, own)

    def _included(self, path: Path) -> Element:
        """Return the root of a file, in which included files replace their elements; paths are from the first file."""
        try:
            root = ElementTree.parse(path).getroot()
        except ElementTree.ParseError as error:
            raise ValueError(f"{path} is not an XML file: {error}.") from None
        for parent in list(root.iter()):
            for k in range(len(parent) - 1, -1, -1):
                if parent[k].tag == "include":
                    parent[k : k + 1] = list(self._included(self.path.parent / parent[k].attrib["file"]))
        return root
