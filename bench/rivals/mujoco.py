"""Chains of rods and planar linkages in MuJoCo, whose joints are angles. It needs `mujoco`."""

from __future__ import annotations

import time
from functools import partial
from typing import Any

import numpy as np

from .rival import is_installed

INSTALL = "MuJoCo is not installed: `pip install mujoco`."
is_there = partial(is_installed, "mujoco")


class Chain:
    """Point masses at the ends of rods that hang from the origin, with hinges between them.

    Parameters
    ----------
    n : int
        Number of rods.
    length, mass : float
        Of one rod, m, and of one mass, kg.
    angle : float
        Of the straight chain from the vertical, rad.
    gravity : float
    """

    def __init__(self, n: int, length: float, mass: float, angle: float, gravity: float) -> None:
        import mujoco

        self._mujoco = mujoco
        tiny = 1e-9 * mass * length**2  # MuJoCo needs an inertia
        inner = ""
        for k in range(n - 1, -1, -1):
            place = "0 0 0" if k == 0 else f"0 0 {-length!r}"
            inner = (
                f'<body pos="{place}"><joint type="hinge" axis="0 1 0"/>'
                f'<inertial pos="0 0 {-length!r}" mass="{mass!r}" diaginertia="{tiny} {tiny} {tiny}"/>{inner}</body>'
            )
        option = f'<option gravity="0 0 {-gravity!r}" integrator="RK4"><flag contact="disable"/></option>'
        self._model = mujoco.MjModel.from_xml_string(
            f'<mujoco><size memory="200M"/>{option}<worldbody>{inner}</worldbody></mujoco>'
        )
        self._angle = angle

    def run(self, t_end: float, steps: int) -> tuple[float, np.ndarray]:
        """Return the seconds of a run with its RK4, and the places of the masses at its end, of shape (n, 2)."""
        data = self._mujoco.MjData(self._model)
        self._model.opt.timestep = t_end / steps
        data.qpos[0] = -self._angle
        begin = time.perf_counter()
        self._mujoco.mj_step(self._model, data, nstep=steps)
        seconds = time.perf_counter() - begin
        self._mujoco.mj_forward(self._model, data)
        return seconds, data.xipos[1:, [0, 2]].copy()


class Linkage:
    """Rigid bodies in the plane, joined by hinges, with a spring to the ground and a torque on the first body.

    A hinge that joins a new body to those before is an angle. The others are soft constraints: springs and dampers that
    close a gap in two steps, the shortest time that is stable.

    Parameters
    ----------
    linkage : Linkage
    """

    def __init__(self, linkage: Any) -> None:
        self._linkage = linkage
        self._above: dict[int, tuple[int | None, np.ndarray]] = {}  # of each body, the body before it, and the hinge
        self._loops: list[tuple[int, np.ndarray]] = []
        for first, second, place in linkage.joints:
            new = second if first in self._above else first
            if new is None or new in self._above:
                self._loops.append((first, np.asarray(place)))
            else:
                self._above[new] = (second if new == first else first), np.asarray(place)

    def run(self, t_end: float, steps: int) -> tuple[float, np.ndarray]:
        """Return the seconds of a run with its RK4, and the angles of the bodies at its end."""
        import mujoco

        model = mujoco.MjModel.from_xml_string(self._text(t_end / steps))
        data = mujoco.MjData(model)
        data.qfrc_applied[0] = self._linkage.torque
        begin = time.perf_counter()
        mujoco.mj_step(model, data, nstep=steps)
        seconds = time.perf_counter() - begin
        turned = np.zeros(len(self._linkage.bodies))
        for body, (before, _) in self._above.items():
            angle = data.qpos[model.joint(f"hinge{body}").qposadr[0]]
            turned[body] = angle + (turned[before] if before is not None else 0.0)
        return seconds, np.array([body[3] for body in self._linkage.bodies]) + turned

    def _text(self, h: float) -> str:
        base, body, hook, stiffness, length = self._linkage.spring
        site = {body: f'<site name="hook" pos="{_vector(hook - self._above[body][1])}"/>'}
        loops = "".join(
            f'<connect body1="body{k}" anchor="{_vector(place - self._above[k][1])}" solref="{2 * h} 1" '
            'solimp="0.9999 0.9999 0.001 0.5 2"/>'
            for k, place in self._loops
        )
        tree = self._bodies_after(None, np.zeros(2), site)
        return f"""<mujoco><option timestep="{h}" integrator="RK4" gravity="0 0 0" tolerance="1e-15">
            <flag contact="disable"/></option>
            <worldbody><site name="base" pos="{_vector(base)}"/>{tree}</worldbody>
            <equality>{loops}</equality>
            <tendon><spatial stiffness="{stiffness}" springlength="{length}"><site site="base"/><site site="hook"/>
            </spatial></tendon></mujoco>"""

    def _bodies_after(self, before: int | None, origin: np.ndarray, sites: dict[int, str]) -> str:
        """The bodies that are joined to one, whose frame has its origin at a place: at its own hinge."""
        found = ""
        for body, (above, hinge) in self._above.items():
            if above == before:
                mass, inertia, centre, _ = self._linkage.bodies[body]
                moments = f"{inertia / 2} {inertia / 2} {inertia}"
                found += (
                    f'<body name="body{body}" pos="{_vector(hinge - origin)}">'
                    f'<joint name="hinge{body}" type="hinge" axis="0 0 1"/>'
                    f'<inertial pos="{_vector(centre - hinge)}" mass="{mass}" diaginertia="{moments}"/>'
                    f"{sites.get(body, '')}{self._bodies_after(body, hinge, sites)}</body>"
                )
        return found


def _vector(place: np.ndarray) -> str:
    return f"{float(place[0])!r} {float(place[1])!r} 0"
