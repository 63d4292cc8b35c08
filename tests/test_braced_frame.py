"""Braces that buckle: one brace against Euler's theory, and the ready frame."""

import numpy as np
import pytest
from scipy.optimize import brentq

import eig3
from eig3.effects import LinearDamper, LinearSpring
from eig3.problems.braced_frame import EULER, STOREY, brace_forces
from eig3.structures import Frame, Section, link_forces


def test_a_cambered_brace_shortens_as_in_eulers_theory():
    """A heavy mass pushes it. The camber e grows to e / (1 - P / P_E), and the bow adds to the shortening P L / (E A).

    The chain of n members buckles at 1 + pi^2 / (12 n^2) times Euler's load, 0.6 % above. The waves of the start and
    the damper, which keeps the bow from vibrating, are below 0.5 % of the load.
    """
    n, length, section = 12, 5.0, Section(E=2.1e11, A=1.5e-3, I=1.4e-6, density=7850.0)
    camber, euler = length / 500, np.pi**2 * section.E * section.I / length**2
    frame = Frame()
    for k in range(n + 1):
        frame.node(f"{k}", length * k / n, camber * np.sin(np.pi * k / n))
        if k:
            frame.member(f"{k - 1}", f"{k}", section)
    frame.support("0", "uy")
    frame.support(f"{n}", "uy")
    frame.mass(f"{n}", 1e9)
    links = [
        (LinearSpring(1e9), None, "0.ux"),  # measures the force
        (LinearDamper(50.0), None, [f"{k}.uy" for k in range(1, n)]),
    ]
    pushed = np.array([-2.5e-3 * (name == f"{n}.ux") for name in frame.names])
    problem = frame.problem((0, 8), corotational=True, links=links, v0=pushed)
    run = problem.integrate(h=problem.critical_step().h, outputs={"force": link_forces(problem)}, save_every=2000)

    def shortening(P):
        return P * length / (section.E * section.A) + (np.pi * camber) ** 2 / (4 * length) * ((1 - P / euler) ** -2 - 1)

    u = dict(zip(problem.names, run.u.T, strict=True))
    expected = [brentq(lambda P, s=s: shortening(P) - s, 0, 0.999 * euler) for s in u["0.ux"] - u[f"{n}.ux"]]
    assert expected[-1] > 0.93 * euler
    forces = -run.outputs["force"][:, 0]
    np.testing.assert_allclose(forces, expected, rtol=0, atol=0.011 * euler)
    bow = camber + u[f"{n // 2}.uy"]
    np.testing.assert_allclose(bow[-1], camber / (1 - expected[-1] / euler), rtol=0.02)


def test_braces_of_the_ready_frame_carry_eulers_load():
    """In the linear frame they carry twice as much. Buckled braces are softer, so that the frame drifts more."""
    forces, drifts = [], []
    for buckling in (True, False):
        problem = eig3.problems.braced_frame(buckling=buckling, t_end=6.0)
        run = problem.integrate(h=problem.h)
        forces.append(-brace_forces(problem.geometry, run.u).min() / EULER)
        drifts.append(np.abs(run.u[:, problem.names.index("1A.ux")]).max() / STOREY)
    assert 0.9 < forces[0] < 1.05
    assert forces[1] > 2.0
    assert drifts[0] > 1.2 * drifts[1]
    assert drifts[0] < 0.004


def test_a_frame_that_is_struck_keeps_its_energy_while_braces_buckle():
    """The drift falls as h^2, by 4 with half the step."""
    problem = eig3.problems.braced_frame(peak=0.0, xi=0.0)
    speeds = {"1A.ux": 0.024, "1B.ux": 0.024, "2A.ux": 0.06, "2B.ux": 0.06}  # m/s
    struck = problem.with_(v0=[speeds.get(name, 0.0) for name in problem.names], t_span=(0.0, 2.0))
    runs = [struck.integrate(h=h) for h in (1e-4, 5e-5)]
    assert brace_forces(problem.geometry, runs[0].u).min() < -0.9 * EULER
    drifts = [run.drift["energy"] for run in runs]
    assert drifts[0] < 2e-5 * struck.energy_of(runs[0].u[0], runs[0].v[0])
    assert drifts[0] / drifts[1] == pytest.approx(4.0, rel=0.25)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_corotational_frame_has_the_rayleigh_damping_of_its_stiffness_at_rest(dimension):
    """Small free vibrations are those of the damped linear frame: nonlinear terms are 1e-4 of the motion."""
    frame = Frame(dimension)
    section = Section(E=2e11, A=1e-2, I=1e-5, density=7800.0, I_side=3e-5, G=8e10, J=1e-5)
    for k in range(4):
        frame.node(f"{k}", *[float(k), 0.0, 0.0][:dimension])
        if k:
            frame.member(f"{k - 1}", f"{k}", section)
    frame.support("0")
    v0 = [1e-3 * int(name[0]) ** 2 if name.endswith(".uy") else 0.0 for name in frame.names]
    damping = eig3.Rayleigh(0.1, modes=(1, 2))
    problems = [frame.problem((0, 0.02), corotational=choice, v0=v0, damping=damping) for choice in (True, False)]
    turning, linear = (problem.integrate(h=problems[0].critical_step().h / 2) for problem in problems)
    np.testing.assert_allclose(turning.u, linear.u, rtol=0, atol=1e-4 * np.abs(linear.u).max())
    assert turning.drift == {}
    with pytest.raises(TypeError, match=r"the damping of a corotational frame must be eig3\.Rayleigh"):
        frame.problem((0, 1), corotational=True, damping=eig3.Modal(0.1, 2))
