"""Chains of rods in MuJoCo, whose joints are angles. It needs `mujoco`."""

from __future__ import annotations

import importlib.util
import time

import numpy as np

INSTALL = "MuJoCo is not installed: `pip install mujoco`."


def is_there() -> bool:
    """Return whether MuJoCo is installed."""
    return importlib.util.find_spec("mujoco") is not None


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
