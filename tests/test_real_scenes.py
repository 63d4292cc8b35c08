"""The scenes of `eig3.problems`: against written equations, against SciPy, and by their energy."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from eig3 import problems
from eig3.problems.quarter_car import road
from eig3.problems.shear_building import quake

from .conftest import acceleration

JUMPS = [problems.quarter_car, problems.shear_building, problems.pounding_buildings]
SCENES = [*JUMPS, problems.rail_joint, problems.curtain]


@pytest.mark.parametrize("build", SCENES)
def test_the_change_of_energy_is_the_work_done(build):
    """To 2 % of the work where the velocity of a record jumps, and to 0.1 % where it does not."""
    problem = build(work=True)
    solution = problem.integrate(h=problem.h, save_every=100)
    assert solution.success
    work = np.ptp(solution.z["work"])
    assert work > 0
    assert solution.drift["energy"] < (2e-2 if build in JUMPS else 1e-3) * work


def test_the_quarter_car_has_the_textbook_equations():
    problem = problems.quarter_car()
    x, z = road(200.0, 0.05, 64e-6, seed=8608)
    rng = np.random.default_rng(0)
    for t in rng.uniform(0, 10, 20):
        u, v = problem.u0 + 0.01 * rng.standard_normal(2), rng.standard_normal(2)
        (wheel, body), ground = u - problem.u0, np.interp(20.0 * t, x, z)
        leg = 18e3 * (body - wheel) + 1.2e3 * (v[1] - v[0])
        expected = [(leg - 180e3 * (wheel - ground)) / 40.0, -leg / 300.0]
        np.testing.assert_allclose(acceleration(problem, u, v, t), expected, rtol=1e-9, atol=1e-9)


def test_the_road_is_of_its_class():
    """Its mean square is the integral of the spectrum G (n0 / n)^2 over the wave numbers of the standard."""
    _, z = road(5_000.0, 0.1, 64e-6, seed=1)
    assert np.var(z) == pytest.approx(64e-6 * 0.1**2 * (1 / 0.011 - 1 / 2.83), rel=0.25)


def test_the_building_follows_scipy():
    """Both have a step that ends at each corner of the record: SciPy is started anew there."""
    problem = problems.shear_building(t_end=10.0)
    t, x = quake(10.0, 0.01, 3.0, seed=1906)
    K = 12e6 * np.array([[2.0, -1, 0], [-1, 2, -1], [0, -1, 1]])
    C = 60e3 / 12e6 * K
    y = np.zeros(6)
    for k in range(t.size - 1):
        speed = (x[k + 1] - x[k]) / 0.01

        def f(s, y, k=k, speed=speed):
            moved = x[k] + speed * (s - t[k])
            force = -K @ y[:3] - C @ y[3:]
            force[0] += 12e6 * moved + 60e3 * speed
            return np.concatenate([y[3:], force / 20e3])

        y = solve_ivp(f, (t[k], t[k + 1]), y, rtol=1e-8, atol=1e-10, method="DOP853").y[:, -1]
    error = np.abs(problem.integrate(h=5e-4, save_every=None).u[-1] - y[:3]).max()
    assert error < 1e-4 * np.abs(x).max()  # of first order at the corners; ten times the error found


def test_every_impact_of_floors_keeps_momentum_and_loses_speed_by_the_restitution():
    """The times of impacts agree for a fixed step, of first order at the corners of the record, and for a tolerance."""
    problem = problems.pounding_buildings(gap=0.01, m=(20e3, 30e3))
    fixed = problem.integrate(h=problem.h, save_every=None).events
    found = problem.integrate(rtol=1e-8, save_every=None).events
    assert [len(each) for each in fixed.values()] == [len(each) for each in found.values()]
    assert sum(len(each) for each in found.values()) > 10
    for k, each in enumerate(found.values()):
        # an error of a time grows with each impact: the largest found is 1e-4, at the last of 19
        np.testing.assert_allclose(each.t, fixed[f"mass impact {k}"].t, rtol=0, atol=1e-3)
        before, after = (v[:, [k, 3 + k]] for v in (each.v, each.v_after))
        np.testing.assert_allclose(each.u[:, k], each.u[:, 3 + k], rtol=0, atol=1e-9)  # they meet, to the root's error
        rate, left = -np.diff(before), np.diff(after)
        rebound = np.maximum(0.65 * rate, np.minimum(rate, 0.01))  # an impact leaves 10 mm/s, or what it had
        np.testing.assert_allclose(left, rebound, rtol=1e-12)  # round-off
        np.testing.assert_allclose(after @ (20, 30), before @ (20, 30), rtol=0, atol=1e-12)


def test_buildings_far_apart_move_as_each_alone():
    """To round-off, which the positions of the left building in place of displacements make larger."""
    pair = problems.pounding_buildings(gap=2.0, t_end=10.0)
    both = pair.integrate(h=1e-3, save_every=None)
    assert not any(len(found) for found in both.events.values())
    for k, stiffness in ((0, 6e6), (3, 18e6)):
        alone = problems.shear_building(stiffness=stiffness, t_end=10.0).integrate(h=1e-3, save_every=None)
        np.testing.assert_allclose(both.u[-1, k : k + 3] + 2.0 * (k == 0), alone.u[-1], rtol=0, atol=1e-11)


def test_the_record_is_like_an_earthquake():
    _, x = quake(30.0, 0.01, 3.0, seed=1906)
    a = np.diff(x, 2) / 0.01**2
    assert x[0] == 0
    assert 1.0 < np.abs(a).max() < 4.0
    assert np.abs(x).max() < 0.5
    spectrum = np.abs(np.fft.rfft(a)) ** 2
    strongest = np.fft.rfftfreq(a.size, 0.01)[spectrum.argmax()]
    assert 0.3 < strongest < 5.0


def test_the_wheel_stands_before_the_joint_and_comes_to_rest_after():
    problem = problems.rail_joint(t_end=0.5)
    problem_at_rest = problems.rail_joint(angle=0.0)
    rest = acceleration(problem_at_rest, problem_at_rest.u0, problem_at_rest.v0)
    assert np.abs(rest).max() < 1e-6 * 9.81
    solution = problem.integrate(h=problem.h, save_every=100)
    wheel, rail = solution.u[:, 2], solution.u[:, 1]
    force = 9e10 * np.maximum(0, 0.5 - (wheel - rail)[solution.t > 0.05]) ** 1.5
    assert np.abs(solution.u[-1] - solution.u[0])[:3].max() < 1e-5
    assert force[-1] == pytest.approx(9.81 * 6600, rel=1e-3)


def test_the_curtain_hangs_by_two_corners():
    problem = problems.curtain(n=10, t_end=20.0, drag=5.0, work=True)
    solution = problem.integrate(h=1e-3, save_every=100)
    _, y, z = solution.u[-1].reshape(3, 10, 10)
    assert z[-1].max() < -0.8
    np.testing.assert_allclose(y, 1 - y[:, ::-1], atol=1e-6)  # it starts symmetric and remains so
    hooks = 1000.0 * np.abs(z[0, [0, -1]])
    assert hooks.sum() == pytest.approx(0.2 * 9.81, rel=0.02)  # they carry its weight


def test_records_are_the_same_each_time():
    assert problems.quarter_car().params.tolist() == problems.quarter_car().params.tolist()
    with pytest.raises(ValueError, match="n must be at least 3, not 2"):
        problems.curtain(n=2)
