"""A program of a user, which `mypy --strict` accepts with the installed wheel: `.ci/run` checks this file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import eig3
from eig3.effects import Gravity, LinearSpring
from eig3.scene import Scene
from eig3.structures import Frame, Section


@eig3.jit
def duffing(t: float, u: float, v: float, p: np.ndarray) -> float:
    return float(p[0] * np.cos(t) - 0.1 * v - u - u**3)


@eig3.jit
def speed(t: float, u: float, v: float, p: np.ndarray) -> float:
    return v


def runs() -> list[eig3.Solution]:
    events = {"turn": eig3.Event(speed, direction=-1)}
    run = eig3.integrate(duffing, (0, 10), 1.0, 0.0, h=1e-2, params=[0.3], outputs={"speed": speed}, events=events)
    high: float = run.extremes["speed"].high
    first: np.ndarray = run.events["turn"].t[:1]
    prepared: eig3.Prepared = eig3.prepare(duffing, rtol=1e-8, method=eig3.RK8())
    run.save("run")
    loaded = eig3.load("run", rhs=duffing, events=events, outputs={"speed": speed})
    print(high, first, run.status is eig3.Status.COMPLETED, run.at(5.0))
    return [run, prepared((0, 10), 1.0, 0.0, [0.3]), loaded.extend(20.0)]


def members() -> float:
    params = np.linspace(0.1, 0.5, 4)[:, None]
    found: eig3.EnsembleSolution = eig3.ensemble(duffing, (0, 10), 1.0, 0.0, h=0.02, params=params)
    each: eig3.Solution = found[0]
    return float(each.u[-1] + found.u[:, -1].max())


def pendulum() -> eig3.Problem:
    scene = Scene(dimension=2)
    pivot, bob = scene.fixed((0, 0)), scene.mass(1.0, (0.75, 0))
    scene.add(LinearSpring(stiffness=98.1, rest_length=0.5), pivot, bob)
    scene.add(Gravity((0, -9.81)))
    return scene.problem((0, 1))


def structures() -> list[eig3.Problem]:
    K = np.array([[2.0, -1.0], [-1.0, 1.0]])
    chain = eig3.linear(np.eye(2), K=K, damping=eig3.Rayleigh(0.05, 0.5, 1.5), t_span=(0, 1), u0=[1.0, 0.0])
    cantilever = Frame()
    cantilever.node("foot", 0, 0)
    cantilever.node("head", 0, 3)
    cantilever.member("foot", "head", Section(E=2.1e11, density=7850.0, A=2.4e-2, I=8e-4))
    cantilever.support("foot")
    return [chain, cantilever.problem((0, 0.01), ground=([0.0, 1.0], [0.3, 0.3]))]


if __name__ == "__main__":
    problem: eig3.Problem = pendulum()
    best: eig3.Plan = eig3.plan(problem, 1e-3)
    limit: eig3.CriticalStep = problem.critical_step()
    slopes: eig3.Sensitivities = eig3.sensitivities(problem, ["u0[0]"], h=1e-3)
    page: Path = eig3.report(problem, "report", accuracies=[1e-2], rivals=False)
    print(best, limit, slopes, page, members(), [run.success for run in runs()])
    print([each.integrate(h=1e-6).success for each in structures()])
