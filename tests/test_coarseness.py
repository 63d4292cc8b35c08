"""Notes on a fixed step that is too long for the motion: in runs that need them, and in no others."""

import math
import re

import pytest

import eig3
from eig3 import integrate, problems
from eig3.effects import LinearDamper, Maxwell
from eig3.scene import Scene

from .conftest import oscillator, oscillator_vector, position
from .test_grains import Block, on_a_post


def coarse(run):
    """The note about the step; empty if there is none."""
    assert run.success
    return next((note for note in run.notes if note.startswith("h = ")), "")


def steps_in_a_period(note):
    return float(re.search(r"a period has about ([\d.]+) steps", note)[1])


falling = eig3.jit(lambda t, u, v, p: -9.81)
falling_from_a_stop = eig3.jit(lambda t, u, v, p: -1 - 1000 * max(u - 1, 0))


@eig3.jit
def rooted(t, u, v, p):
    if u < 0:
        raise ValueError("below the ground")
    return -math.sqrt(u)


@pytest.mark.parametrize("save_every", [1, None])
@pytest.mark.parametrize(("rhs", "u0"), [(oscillator, 1.0), (oscillator_vector, [1.0, 0.5])], ids=["scalar", "vector"])
def test_a_step_beyond_the_span(rhs, u0, save_every):
    """The step becomes 10, and the only step brings u0 = 1 to 1 - 10^2 / 2."""
    v0 = 0.0 if rhs is oscillator else [0.0, 0.0]
    run = integrate(rhs, (0, 10), u0, v0, h=100, params=(1.0, 0.0), save_every=save_every)
    note = coarse(run)
    assert steps_in_a_period(note) == pytest.approx(2 * math.pi / 10, rel=0.02)
    assert "EIG-3 is unstable beyond h = 2" in note
    assert f"Take h = {2 * math.pi / 20:.2g} " in note
    assert not coarse(integrate(rhs, (0, 10), u0, v0, h=0.3, params=(1.0, 0.0), save_every=save_every))
    assert coarse(integrate(rhs, (0, 10), u0, v0, h=2.5, params=(1.0, 0.0)).extend(20.0))


@pytest.mark.parametrize(("method", "noted"), [("eig3", 1.1), ("cd", 1.1), ("rk4", 1.1), ("rk8", 2.2)])
def test_steps_in_a_period_are_counted_in_the_states(method, noted):
    for omega_h in (0.2, 0.6, 0.9, 1.1, 1.5, 1.9, 2.2):
        if method in ("eig3", "cd") and omega_h > 1.9:
            continue
        note = coarse(integrate(oscillator, (0, 200 * omega_h), 1.0, 0.3, h=omega_h, params=(1.0, 0.0), method=method))
        assert bool(note) == (omega_h >= noted), omega_h
        if note and method in ("eig3", "cd"):  # they keep the amplitude, and turn by 2 asin(omega h / 2) in a step
            # 64 states contain a number of periods that is not whole
            assert steps_in_a_period(note) == pytest.approx(math.pi / math.asin(omega_h / 2), rel=0.05)


def test_damping_beyond_the_limit():
    """EIG-3 is the Adams-Bashforth method of second order for v, which is stable up to c h = 1."""
    options = {"params": (1.0, 100.0)}  # c = 200
    note = coarse(integrate(oscillator, (0, 0.2), 1.0, 1.0, h=0.1, **options))
    assert float(re.search(r"stable up to h = ([\d.]+\d)", note)[1]) == pytest.approx(1 / 200, rel=0.05)
    assert not coarse(integrate(oscillator, (0, 0.01), 1.0, 1.0, h=0.002, **options))
    assert not coarse(integrate(oscillator, (0, 0.5), 1.0, 1.0, h=0.1, method="cd", **options))  # it solves for v


@pytest.mark.parametrize(("law", "h"), [(LinearDamper(50.0), 0.01), (Maxwell(5.0, 0.1), 0.05)], ids=["damper", "z"])
def test_the_step_of_a_mechanism_with_damping(law, h):
    """EIG-3 has its usual limit under constraints: h = 0.4 / c = 0.008 with the damper, and 1 / 50 with Maxwell's."""
    scene = Scene(2)
    wheel = scene.body(1.0, 0.4, (0.0, 0.0), angular_velocity=0.3)
    wheel.revolute(None, (0.0, 0.0))
    wheel.torsional_spring(None, law)
    problem = scene.problem((0, 0.1))
    noted, quiet = (problem.integrate(h=each, save_every=None) for each in (h, h / 10))
    assert re.search(r"^h = .* critical step.* EIG-?3", noted.notes[0])
    assert quiet.notes == ()


@pytest.mark.parametrize("h", [10.0, 3.0, 1.0, 0.1])
def test_free_fall_has_no_period(h):
    for u0, v0 in ((0.0, 0.0), (100.0, 0.0), (0.0, 50.0)):
        assert not coarse(integrate(falling, (0, 10), u0, v0, h=h))


def test_the_first_step_follows_the_acceleration():
    assert not coarse(integrate(falling_from_a_stop, (0, 3), 1.0, 0.0, h=0.5))


def test_rest_has_no_period():
    for u0 in (0.0, [0.0, 0.0]):
        rhs = oscillator if u0 == 0.0 else oscillator_vector
        for h in (1.0, 10.0):
            assert not coarse(integrate(rhs, (0, 100), u0, u0, h=h, params=(1.0, 0.0)))


def test_resets_are_no_turns():
    """A ball that bounces ten times in the last steps of the run."""
    bounce = eig3.jit(lambda t, u, v, p: (0.0, -v))
    events = {"floor": eig3.Event(position, direction=-1, apply=bounce)}
    run = integrate(falling, (0, 10), 1.0, 0.0, h=0.5, events=events)
    assert len(run.events["floor"]) > 10
    assert not coarse(run)


def test_an_exception_beyond_the_motion_is_none():
    run = integrate(rooted, (0, 1), 1.0, -0.3, h=1.0)  # the first step ends at u = 0.2, and rhs is not evaluated there
    assert not coarse(run)
    assert not coarse(integrate(rooted, (0, 0.5), 0.3, -0.5, h=0.5))  # and here beyond its domain


@pytest.mark.parametrize("method", ["eig3", "rk4"])
@pytest.mark.parametrize("build", [problems.elastic_bar, problems.damped_bar, problems.shear_building])
def test_the_highest_modes_may_have_few_steps(build, method):
    """At the critical step they have 2 or 3 steps in a period, and the motion has many."""
    problem = build()
    h = problem.critical_step(method=method).h
    for n_steps in (1, 3, 7, 12, 300):
        t_end = problem.t_span[0] + n_steps * h
        assert not coarse(problem.integrate(h=h, t_end=t_end, method=method, invariants={})), n_steps


@pytest.mark.parametrize("name", ["kepler", "bouncing_ball", "hertz_impact", "double_pendulum", "van_der_pol"])
def test_runs_with_the_step_of_the_problem(name):
    problem = getattr(problems, name)()
    h = problem.h or 1e-4 * (problem.t_span[1] - problem.t_span[0])
    for n_steps in (5, 3000):
        assert not coarse(problem.integrate(h=h, t_end=problem.t_span[0] + n_steps * h, invariants={})), n_steps


def test_the_springs_at_the_end_of_a_run_are_not_those_at_its_start():
    """A grain is pressed to a wall and hangs on a spring along it, which is stretched half a period after the start.

    It then pulls with twice the weight. At the start, the acceleration would seem to change by this much in a step.
    """
    stiffness, shear, m, press = 1e4, 1e3, 0.02, 981.0
    wall = Block(stiffness, shear, contact_distance=0.2, friction=0.4)
    at = 0.2 - m * press / stiffness
    hanging = on_a_post(wall, m, (at, 0.0), (0.0, 0.0), (0.0, 0.0), inertia=None, field=(-press, -9.81))
    problem = hanging.problem((0, math.pi * math.sqrt(m / shear)))
    assert not coarse(problem.integrate(h=1e-4, method="ab3", save_every=None))
