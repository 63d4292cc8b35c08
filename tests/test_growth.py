"""Finite blow-ups: a motion that grows through its step alone does not end as completed; one that may grow does."""

import math
import re

import numpy as np
import pytest

import eig3
from eig3 import integrate, problems

from .conftest import oscillator, oscillator_vector, spring


@eig3.jit
def lennard_jones(t, u, v, p, a):
    """Atoms in the plane: x of all, then y of all; p holds a spring to the centre that keeps them together."""
    n = u.size // 2
    for i in range(2 * n):
        a[i] = -p[0] * u[i]
    for i in range(n):
        for j in range(i):
            dx, dy = u[i] - u[j], u[n + i] - u[n + j]
            s = 1 / (dx * dx + dy * dy)
            pull = 24 * (s**4 - 2 * s**7)
            a[i] -= pull * dx
            a[n + i] -= pull * dy
            a[j] += pull * dx
            a[n + j] += pull * dy


def atoms(side):
    x, y = np.meshgrid(*(2 ** (1 / 6) * (np.arange(side) - (side - 1) / 2),) * 2)
    u0 = np.concatenate([x.ravel(), y.ravel()])
    return {"u0": u0, "v0": np.random.default_rng(1).standard_normal(u0.size), "params": 0.01}


def blown_up(run):
    assert run.status is eig3.Status.DIVERGED
    assert not run.success
    assert np.isfinite(run.u).all()
    assert "grew to" in run.message
    assert "critical step" in run.message or "unstable at every step" in run.message
    return run


@pytest.mark.parametrize("save_every", [1, None])
@pytest.mark.parametrize(("rhs", "u0"), [(spring, 1.0), (oscillator_vector, [1.0, 0.5, 0.2])], ids=["scalar", "vector"])
def test_a_step_above_the_limit_that_stays_finite(rhs, u0, save_every):
    """omega h = 2.1: u grows as exp(0.63 n), which 190 steps do not bring to overflow."""
    run = blown_up(integrate(rhs, (0, 400), u0, np.zeros_like(u0), h=2.1, params=(1.0, 0.0), save_every=save_every))
    assert run.t[-1] == 400  # nothing is cut off
    assert "is 2 from t = 0" in run.message
    growth = float(run.message.partition("grew to ")[2].split()[0])
    assert growth == pytest.approx(max(np.abs(run.u[-1]).max(), np.abs(run.v[-1]).max()), rel=0.05)
    assert "h = 1.8 was tried and is stable" in run.explain()
    with pytest.raises(eig3.IntegrationError, match="grew to"):
        integrate(rhs, (0, 400), u0, np.zeros_like(u0), h=2.1, params=(1.0, 0.0), raise_on_failure=True)


def test_a_method_without_a_stable_step():
    run = blown_up(integrate(spring, (0, 1000), 1.0, 0.0, h=0.1, params=4.0, method="ab2"))
    assert "unstable at every step" in run.message


def test_atoms_that_come_close_on_their_way():
    """A step just below the critical one at the start is too long where the atoms collide."""
    start = atoms(8)
    limit = eig3.critical_step(lennard_jones, start["u0"], start["v0"], start["params"]).limit
    run = blown_up(integrate(lennard_jones, (0, 400 * limit), **start, h=0.98 * limit, save_every=None))
    assert integrate(lennard_jones, (0, 400 * limit), **start, h=0.05 * limit, save_every=None).success
    assert "h = " in run.message


inverted_pendulum = eig3.jit(lambda t, u, v, p: p[0] * np.sin(u))
falling = eig3.jit(lambda t, u, v, p: 9.81)
forced = eig3.jit(lambda t, u, v, p: p[0] * np.sin(p[1] * t) - u)


@eig3.jit
def shaken_storeys(t, u, v, p, a):
    a[0] = 400 * (u[1] - u[0]) - 400 * u[0] - 0.5 * v[0] + 5 * np.sin(3 * t) ** 2
    a[1] = a[2] = 400 * (u[0] - u[1]) - 0.5 * v[1]


@eig3.jit
def saddle(t, u, v, p, a):
    """One direction that grows as exp(t), and two that vibrate at omega = 3."""
    a[0] = u[0]
    a[1], a[2] = -9 * u[1], -9 * u[2]


ALLOWED = {
    "an inverted pendulum that leaves its position": (inverted_pendulum, (0, 40), 1e-9, 0.0, 100.0),
    "a linear instability of the system": (saddle, (0, 60), [1e-12, 0.1, 0.1], [0.0] * 3, 1.0),
    "free fall": (falling, (0, 1e4), 0.0, 0.0, 1.0),
    "resonance from rest": (forced, (0, 2000), 0.0, 0.0, (1.0, 1.0)),
    "a force from rest": (forced, (0, 500), 0.0, 0.0, (1e9, 0.3)),
    "a structure from rest": (shaken_storeys, (0, 50), [0.0] * 3, [0.0] * 3, 1.0),
    "negative damping": (oscillator, (0, 400), 1.0, 0.0, (1.0, -0.1)),
}


@pytest.mark.parametrize("save_every", [1, None])
@pytest.mark.parametrize("method", ["eig3", "cd", "rk4", "rk2"])
@pytest.mark.parametrize("name", ALLOWED)
def test_a_motion_that_grows_by_itself_is_left_alone(name, method, save_every):
    rhs, span, u0, v0, params = ALLOWED[name]
    for _ in range(2):  # the second run has the pace of the first, and so other chunks
        run = integrate(rhs, span, u0, v0, h=0.01, params=params, method=method, save_every=save_every)
        assert run.success
        assert run.notes == ()


def test_a_contact_far_from_the_start_is_left_alone():
    """A planet that passes close by the sun has a critical step that falls by a factor of 100 there."""
    run = problems.kepler(e=0.9).integrate(h=1e-3, save_every=None, invariants={})
    assert run.success


@pytest.mark.parametrize(("h", "steps"), [(0.05, 6), (0.125, 4)])
def test_a_run_past_the_end_of_its_solution_diverges(h, steps):
    """u'' = 60 u^3 from rest at u = 1 is unbounded at t = 1.3110 / sqrt(30) = 0.239; no step limits its growth."""
    run = integrate(quartic, (0, steps * h), 1.0, 0.0, h=h, method="rk4")
    members = eig3.ensemble(quartic, (0, steps * h), [1.0], 0.0, h=h, method="rk4")
    assert run.status is members.status[0] is eig3.Status.DIVERGED
    assert "the solution itself may be unbounded" in run.explain()
    assert integrate(quartic, (0, 0.2), 1.0, 0.0, h=0.05, method="rk4").success


quartic = eig3.jit(lambda t, u, v, p: 60 * u**3)


def test_what_is_found_at_the_end_costs_no_run_that_stays_small(monkeypatch):
    monkeypatch.setattr(eig3.run.fixed_run, "find_blow_up", None)
    assert integrate(spring, (0, 400), 1.0, 0.0, h=0.5, params=1.0).success
    assert math.isfinite(integrate(forced, (0, 500), 0.0, 0.0, h=0.01, params=(1.0, 0.3)).u[-1])


def test_a_drift_far_beyond_the_energy_is_noted():
    """Two atoms so near each other that the first step throws them apart: then their energy stays constant."""
    start = [-0.15, 0.15, 0.0, 0.0], np.zeros(4)
    options = {"params": 0.0, "invariants": {"energy": energy_of_two}, "save_every": None}
    run = integrate(lennard_jones, (0, 10), *start, h=1e-3, **options)
    assert run.success
    drift = f"energy drifts by {run.drift['energy']:.2g}, "
    (note,) = (note for note in run.notes if note.startswith(drift))
    assert f"{run.drift['energy'] / energy_of_two(0.0, *map(np.array, start), 0.0):.2g} times" in note
    assert f"  Note: {note}" in repr(run)
    variable = integrate(lennard_jones, (0, 10), *start, rtol=1e-6, method="rk8", **options)
    assert variable.notes == ()


@eig3.jit
def energy_of_two(t, u, v, p):
    s = 1 / ((u[0] - u[1]) ** 2 + (u[2] - u[3]) ** 2)
    return 0.5 * (v[0] ** 2 + v[1] ** 2 + v[2] ** 2 + v[3] ** 2) + 4 * (s**6 - s**3)


energy_of_pendulum = eig3.jit(lambda t, u, v, p: v * v / 2 + p[0] * (np.cos(u) - 1))
level_pendulum = eig3.jit(lambda t, u, v, p: -np.cos(u))
energy_of_level_pendulum = eig3.jit(lambda t, u, v, p: v * v / 2 + np.sin(u))
momentum = eig3.jit(lambda t, u, v, p: v[0] + v[1] + v[2] + v[3])


@pytest.mark.parametrize("method", ["eig3", "rk4"])
def test_what_is_nearly_zero_at_the_start_does_not_drift_far(method):
    """Of an energy that starts near zero by the choice of its zero, and of a momentum that is round-off."""
    options = {"h": 0.01, "method": method, "save_every": None}
    run = integrate(inverted_pendulum, (0, 40), 1e-9, 0.0, params=1.0, invariants={"e": energy_of_pendulum}, **options)
    assert run.drift["e"] > 100 * abs(energy_of_pendulum(0.0, 1e-9, 0.0, np.ones(1)))
    assert run.notes == ()
    for t_end in (14.83, 14.84):  # two periods of 7.4163
        run = integrate(level_pendulum, (0, t_end), 1e-15, 0.0, invariants={"e": energy_of_level_pendulum}, **options)
        assert run.drift["e"] > 1e-13
        assert run.notes == ()
    v0 = np.array([0.7, 0.1, -0.3, -0.5])
    run = integrate(
        lennard_jones, (0, 10), [-0.6, 0.6, 0.1, 0.0], v0, params=0.0, invariants={"p": momentum}, **options
    )
    assert run.drift["p"] < 1e-12
    assert not any("drifts" in note for note in run.notes)


def test_members_that_start_as_the_same_linear_system_search_its_critical_step_once(monkeypatch):
    """Each member is also searched where its own growth begins. A search may take a quarter of a second."""
    from eig3.diagnosis import divergence

    searched, search = [], divergence.of_linear
    monkeypatch.setattr(divergence, "of_linear", lambda system, method: searched.append(0) or search(system, method))
    n = 25  # too many degrees of freedom for lanes
    problem = eig3.linear(np.ones(n), None, np.diag(np.linspace(0.5, 1.0, n)), t_span=(0, 400), v0=np.eye(n)[-1])
    speeds = np.outer([1.0, 2.0, 3.0], np.eye(n)[-1])
    members = problem.ensemble(v0=speeds, h=2.1)
    assert len(searched) == 3 + 1
    alone = [problem.with_(v0=v0).integrate(h=2.1) for v0 in speeds]
    assert [str(message) for message in members.message] == [blown_up(run).message for run in alone]


def test_a_load_after_rest_is_no_growth_by_the_step(monkeypatch):
    """EIG-3 is unstable at every step with gyroscopic forces, here by less than 1e-5 a step. In 300 steps, this cannot
    make a motion grow 10 000 times, so that no critical step is searched."""
    from eig3.diagnosis import divergence

    searched, search = [], divergence.of_linear
    monkeypatch.setattr(divergence, "of_linear", lambda system, method: searched.append(0) or search(system, method))
    loads = np.array([0.0, 30.0, 31.0, 90.0]), np.array([[0.0, 0.0], [0.0, 0.0], [1.0, 1.0], [1.0, 1.0]])
    turning = eig3.linear(
        np.ones(2), [[0.0, 0.5], [-0.5, 0.0]], np.diag([1.0, 2.0]), t_span=(0, 90), u0=[1e-9, 0.0], force=loads
    )
    run = turning.integrate(h=0.3)
    assert (run.success, searched) == (True, [])
    assert np.abs(run.u).max() > 0.5


def test_the_growth_of_an_energy_does_not_depend_on_its_zero():
    """RK2 adds energy, which is noted relative to the terms, |v^2 / 2| + |sin u| up to 2, if the energy begins at 0."""
    options = {"invariants": {"e": energy_of_level_pendulum}, "save_every": None}
    run = integrate(level_pendulum, (0, 190), 0.0, 0.0, h=0.03, method="rk2", **options)
    percent = float(re.match(r"e grows steadily, by ([\d.]+) % over the run", run.notes[0])[1])
    assert 0.2 < percent / (100 * run.drift["e"]) < 3
    assert integrate(level_pendulum, (0, 190), 0.0, 0.0, rtol=1e-9, method="rk8", **options).notes == ()
