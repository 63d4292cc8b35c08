"""The problems: their constants do what they say, exact solutions solve them, energies are constant along them."""

import copy
import functools
import math
import pickle

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import eig3
from eig3 import problems
from eig3.functions.callbacks import check_callback
from eig3.kernels.protocol import SCALAR, VECTOR
from eig3.problems.bouncing_ball import flights, impact_times
from eig3.problems.figure_eight import PERIOD
from eig3.problems.hertz_impact import contact_time, largest_indentation
from eig3.problems.kepler import angular_momentum, eccentric_anomaly
from eig3.problems.outer_solar_system import AU, YEAR

from .conftest import made_up

free_duffing = functools.partial(problems.duffing, delta=0, gamma=0)
#: So far from the sun, the earth and the moon that random states near the start do not come close to them.
round_kepler, far_arenstorf = functools.partial(problems.kepler, e=0.2), functools.partial(problems.arenstorf, x=2.5)

PROBLEMS = [problems.single_dof, problems.hardening_spring, problems.softening_spring, problems.spring_pendulum]
CONSERVATIVE = [
    *PROBLEMS, problems.double_pendulum, problems.henon_heiles, problems.rotor, free_duffing, round_kepler,
    problems.hertz_impact, problems.two_frequency_oscillator, far_arenstorf, problems.figure_eight
]  # fmt: skip
SPANS = [  # the last omega h is 1e-3 at speeds of 1e3, and Hertz's span is its contact and a quarter
    *((build, 1.0, 1e-4) for build in (*PROBLEMS, problems.double_pendulum, problems.rotor, problems.duffing)),
    *((build, 1.0, 1e-4) for build in (free_duffing, problems.van_der_pol, problems.kepler)),
    *((build, 1.0, 1e-4) for build in (problems.friction_oscillator, problems.figure_eight)),
    (problems.henon_heiles, 1.0, 1e-3),
    (problems.hertz_impact, 0.016, 1e-5),
    (problems.two_frequency_oscillator, 0.1, 1e-6),
    (problems.arenstorf, 0.5, 1e-5),
]


#: Problems whose code for the default number of grains would take seconds to compile; other tests have these.
FEWER = {"argon": {"n": 4}, "hopper": {"n": 800}, "sand_column": {"n": 1000}}
#: Problems whose pictures show results of a run.
WITH_RESULTS = "braced_frame", "isolated_building", "pounding_buildings", "ten_storey_frame", "yielding_frame"


def acceleration(problem, t, u, v):
    """As a kernel calls rhs, which is then compiled once: Python would call it with other types."""
    p = np.array(problem.params, dtype=float)
    if np.ndim(problem.u0) == 0:
        return check_callback(problem.rhs, "rhs", SCALAR).call(float(t), float(u), float(v), p)
    a = np.empty(len(u))
    u, v = (np.array(values, dtype=float) for values in (u, v))
    check_callback(problem.rhs, "rhs", VECTOR).call(float(t), u, v, p, a)
    return a


def by_python(problem, t, u, v):
    a, p = np.empty(np.shape(u)), np.array(problem.params, dtype=float)
    written = problem.rhs.py_func(t, u, v, p, *[a] * (a.ndim > 0))
    return a if written is None else written


@pytest.mark.parametrize("build", CONSERVATIVE)
def test_energy_is_constant_along_the_motion(build):
    """dE/dt by central differences along (v, a) vanishes, at random states."""
    problem = build()
    p = np.array(problem.params, dtype=float)
    random = np.random.default_rng(1)
    for _ in range(20):
        u = np.asarray(problem.u0) + random.normal(scale=0.1, size=np.shape(problem.u0))
        v = random.normal(size=np.shape(problem.v0))
        u, v = (float(u), float(v)) if np.ndim(u) == 0 else (u, v)
        a = acceleration(problem, 0.0, u, v)
        dt = 1e-6
        ends = [problem.energy(0.0, u + s * dt * v, v + s * dt * a, p) for s in (1, -1)]
        scale = np.abs(np.sum(np.asarray(v) * a)) + 1  # the two powers that cancel
        # differences err by eps E / dt, some 1e-8 for E up to 1e3
        assert abs(ends[0] - ends[1]) / (2 * dt) < 1e-6 * scale


@pytest.mark.parametrize(("build", "t_end", "h"), SPANS)
def test_against_dop853(build, t_end, h):
    problem = build()
    n = np.size(problem.u0)

    def first_order(t, y):
        u, v = (y[0], y[1]) if np.ndim(problem.u0) == 0 else (y[:n], y[n:])
        return np.concatenate([np.atleast_1d(v), np.atleast_1d(acceleration(problem, t, u, v))])

    y0 = np.concatenate([np.atleast_1d(problem.u0), np.atleast_1d(problem.v0)])
    reference = solve_ivp(first_order, (0, t_end), y0, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    run = problem.integrate(h=h, t_end=t_end, method="rk4", save_every=None)
    ours = np.concatenate([np.atleast_1d(run.u[-1]), np.atleast_1d(run.v[-1])])
    np.testing.assert_allclose(ours, reference, rtol=0, atol=1e-6)  # hardening: (omega h)^4 over 7 periods


def test_periods_of_the_springs():
    """Back where it started after the period the article prints; to 1e-6 since that is its last digit."""
    for problem, period in ((problems.hardening_spring(), 0.1515328), (problems.softening_spring(), 1.1418763)):
        run = problem.integrate(h=period / 20000, t_end=period, method="rk4", save_every=None)
        assert run.u[-1] == pytest.approx(run.u[0], abs=1e-6)
        assert run.v[-1] == pytest.approx(0, abs=1e-3)


@pytest.mark.parametrize("xi", [0.0, 0.05, 0.7, 1.0, 2.5])
@pytest.mark.parametrize(("force", "force_omega"), [(0.0, 0.0), (2.0, 0.0), (2.0, 3.1), (2.0, 2.0)])
def test_exact_solution_of_the_oscillator(xi, force, force_omega):
    """Against RK4 at a step where its error is (omega h)^4 t / 120 = 1e-11; resonance and xi = 1 among the cases."""
    problem = problems.single_dof(2.0, xi, force, force_omega, u0=0.7, v0=-1.3, t_end=10.0)
    run = problem.integrate(h=1e-3, method="rk4")
    u, v = problem.exact(run.t)
    np.testing.assert_allclose(run.u, u, rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.v, v, rtol=0, atol=1e-9)


def test_only_the_effects_named_are_compiled():
    assert problems.single_dof().rhs is not problems.single_dof(xi=0.1).rhs
    assert problems.single_dof(xi=0.1).uses_velocity
    assert not problems.single_dof(force=1.0).uses_velocity
    assert problems.single_dof(xi=0.1).energy is None
    assert problems.single_dof().energy is not None


def test_only_the_effects_named_are_compiled_in_duffings_oscillator():
    builds = [problems.duffing(delta=delta, gamma=gamma) for delta in (0, 0.3) for gamma in (0, 0.5)]
    assert len({problem.rhs for problem in builds}) == 4
    assert [problem.uses_velocity for problem in builds] == [False, False, True, True]
    assert [problem.energy is not None for problem in builds] == [True, False, False, False]
    for problem, (delta, gamma) in zip(builds, [(0, 0), (0, 0.5), (0.3, 0), (0.3, 0.5)], strict=True):
        t, u, v = 0.7, 1.3, -0.4
        expected = gamma * math.cos(1.2 * t) - delta * v + u - u**3
        assert acceleration(problem, t, u, v) == pytest.approx(expected, rel=1e-14)  # sums of a few terms near 1


@pytest.mark.parametrize("name", problems.__all__)
def test_uses_velocity_says_whether_the_force_reads_it(name):
    """Python runs the code if it can, and if no picture below needs it compiled."""
    problem = getattr(problems, name)(**FEWER.get(name, {}))
    u, v = (np.array(x, dtype=float) for x in problem.start)  # with z, which the force reads after v
    v.reshape(-1)[: np.size(problem.u0)] = np.nan
    u, v = (float(u), float(v)) if u.ndim == 0 else (u, v)
    is_compiled = "lists" in problem.rhs.py_func.__globals__ or problem.outputs or name in WITH_RESULTS
    with np.errstate(invalid="ignore"):
        a = (acceleration if is_compiled else by_python)(problem, 0.0, u, v)
    assert np.isnan(a).any() == problem.uses_velocity


@pytest.mark.parametrize("e", [0.0, 0.3, 0.9, 0.99, 1 - 1e-9])
def test_keplers_equation_is_solved_to_round_off(e):
    """All quadrants and anomalies down to nothing; 4 eps is what E - e sin E - M itself is rounded by, up to pi."""
    M = np.concatenate([np.linspace(-np.pi, np.pi, 10001), np.geomspace(1e-300, 1, 1001)])
    E = eccentric_anomaly(M, e)
    assert np.abs(E - e * np.sin(E) - M).max() <= 4 * np.finfo(float).eps
    np.testing.assert_array_equal(eccentric_anomaly(-M, e), -E)


@pytest.mark.parametrize("e", [0.0, 0.9, 0.99])
def test_keplers_orbit_returns_after_its_period(e):
    """The third law, 2 pi sqrt(a^3 / GM), to some eps t of rounded time, which the speed and the pull multiply."""
    problem = problems.kepler(GM=3.0, a=2.0, e=e)
    period = 2 * math.pi * math.sqrt(8 / 3)
    assert problem.t_span[1] == pytest.approx(20 * period, rel=1e-15)
    u, v = problem.exact(np.array([0.0, period, 20 * period]))
    assert u.shape == v.shape == (3, 2)
    np.testing.assert_array_equal(u[0], problem.u0)
    np.testing.assert_allclose(v[0], problem.v0, rtol=1e-14, atol=0)
    speed = math.hypot(*problem.v0)
    late = 4 * np.finfo(float).eps * 20 * period
    np.testing.assert_allclose(u[1:], u[:1].repeat(2, 0), rtol=0, atol=speed * late)
    pull = 3 / problem.u0[0] ** 2
    np.testing.assert_allclose(v[1:], v[:1].repeat(2, 0), rtol=0, atol=pull * late + 1e-14 * speed)
    half, back = problem.exact(period / 2)
    assert half == pytest.approx([-2 * (1 + e), 0], abs=1e-14 * 2 * (1 + e))  # the aphelion, some eps of its distance
    assert back[1] == pytest.approx(-v[0, 1] * (1 - e) / (1 + e), rel=1e-12)  # eps / (1 - e) in v[0]


def test_exact_solution_of_keplers_problem():
    """Against RK4, whose error over one orbit of 40000 steps was seen to fall as h^4 to 4e-9 and 9e-8 (in v)."""
    problem = problems.kepler(t_end=2 * math.pi)
    invariants = {"energy": problem.energy, "angular momentum": angular_momentum}
    run = problem.integrate(h=2 * math.pi / 40000, method="rk4", save_every=100, invariants=invariants)
    u, v = problem.exact(run.t)
    np.testing.assert_allclose(run.u, u, rtol=0, atol=1e-8)
    np.testing.assert_allclose(run.v, v, rtol=0, atol=2e-7)
    assert max(run.drift.values()) < 1e-8  # both are smooth functions of a state as near as that


@pytest.mark.parametrize(("mu", "h", "period"), [(10.0, 1e-3, 19.07837), (100.0, 1e-4, 162.83707)])
def test_van_der_pols_period(mu, h, period):
    """To the last of the digits printed; RK4 at mu h = 0.01 and the cubic between states err by less than 1e-7."""
    run = problems.van_der_pol(mu, t_end=2.4 * period).integrate(h=h, method="rk4")
    rising = np.flatnonzero((run.u[:-1] < 0) & (run.u[1:] >= 0))
    first, second = (brentq(lambda t: run.at(t)[0], run.t[i], run.t[i + 1], xtol=1e-12) for i in rising[:2])
    assert second - first == pytest.approx(period, abs=1e-5)


@pytest.mark.parametrize(("k", "speed"), [(1e6, 1.0), (3e4, 0.2)])
def test_hertzs_contact(k, speed):
    """At 400 steps a contact, where h^(5/2) is 3e-7 of it: indentation, speed of return and time of contact."""
    contact, deepest = contact_time(k, speed), largest_indentation(k, speed)
    assert contact == pytest.approx(2.94328 * deepest / speed, rel=2e-6)  # half of the last digit
    problem = problems.hertz_impact(k, speed)
    assert problem.t_span == (0.0, 2 * contact)
    run = problem.integrate(h=contact / 400, method="rk4")
    assert -run.u.min() == pytest.approx(deepest, rel=1e-6)  # 200 steps in the contact have it at a grid point
    assert run.v[-1] == pytest.approx(speed, rel=1e-6)  # a restitution of 1
    assert run.t[-1] - run.u[-1] / run.v[-1] == pytest.approx(contact, rel=1e-6)  # back along the free flight
    assert run.drift["energy"] < 1e-6 * speed**2 / 2
    eig3_run = problem.integrate(h=contact / 400, save_every=None)
    assert eig3_run.v[-1] == pytest.approx(speed, rel=1e-6)  # symmetric in time where nothing reads v


def test_arenstorfs_orbit_closes():
    """After one period; RK8 at a step that was seen to leave 1e-11, and 1e-16 of the start times 1e5 adds as much."""
    problem = problems.arenstorf()
    run = problem.integrate(h=problem.t_span[1] / 170_000, method="rk8", save_every=1000)
    np.testing.assert_allclose(run.u[-1], run.u[0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.v[-1], run.v[0], rtol=0, atol=1e-6)  # 500 times as much: near the moon
    jacobi = 2 * abs(problem.energy_of(run.u[0], run.v[0]))
    assert run.drift["energy"] < 1e-11 * jacobi
    crossings = np.flatnonzero(run.u[:-1, 1] * run.u[1:, 1] < 0)
    assert len(crossings) == 6  # two for each of the three loops; the start and the end lie on the axis
    mirrored = run.u[::-1] * [1, -1]  # time runs backwards in the mirror image
    np.testing.assert_allclose(run.u, mirrored, rtol=0, atol=1e-9)


def test_arenstorfs_forces_vanish_at_the_triangular_point():
    """A body at the third corner of an equilateral triangle with the earth and the moon stays there: some eps."""
    problem = problems.arenstorf(mu=0.3)
    corner = np.array([0.5 - 0.3, math.sqrt(3) / 2])
    np.testing.assert_allclose(acceleration(problem, 0.0, corner, np.zeros(2)), 0, rtol=0, atol=1e-15)


def test_the_bodies_on_the_eight_change_places_each_third_of_the_period():
    """After 1/3 of the period, each is where another was; the start is known to 8 digits, and the motion is stable."""
    problem = problems.figure_eight()
    t = PERIOD * np.arange(61) / 3
    run = problem.integrate(rtol=1e-12, t_eval=t)
    places = run.u.reshape(-1, 3, 2)
    for i, now in enumerate(places):
        np.testing.assert_allclose(now, np.roll(places[0], i, axis=0), rtol=0, atol=1e-5)
    np.testing.assert_allclose(places.mean(axis=1), 0, rtol=0, atol=1e-12)
    assert run.drift["energy"] < 1e-10


def test_the_outer_planets_keep_momentum_and_turn_in_their_years():
    """The mean periods about the sun over 1000 years are those of the almanacs: to 3 %, for 4 turns of Pluto."""
    problem = problems.outer_solar_system(t_end=1000 * YEAR)
    run = problem.integrate(rtol=1e-10, t_eval=np.linspace(0, 1000 * YEAR, 20_001))
    x, v = (values.reshape(-1, 6, 3) for values in (run.u, run.v))
    masses = np.array(problem.params)
    assert np.abs(np.einsum("i,tij->tj", masses, x)).max() < 1e-9 * masses[0] * AU  # the centre of mass is at rest
    spin = np.einsum("i,tij->tj", masses, np.cross(x, v))
    np.testing.assert_allclose(spin, np.broadcast_to(spin[0], spin.shape), rtol=0, atol=1e-9 * np.abs(spin).max())
    assert run.drift["energy"] < 1e-9 * abs(problem.energy_of(run.u[0], run.v[0]))
    for i, years in enumerate((11.862, 29.457, 84.02, 164.8, 247.9), start=1):
        longitude = np.unwrap(np.arctan2(*(x[:, i] - x[:, 0]).T[1::-1]))
        assert 2 * np.pi * 1000 / (longitude[-1] - longitude[0]) == pytest.approx(years, rel=0.03)


def test_heights_of_the_ball_between_its_impacts():
    """The flight after the impact k takes 2 e^k falls, and is e^(2k) times as high as the start; to some eps."""
    e, h0, g = 0.8, 2.0, 10.0
    fall = math.sqrt(2 * h0 / g)
    times = impact_times(31, e, h0, g)
    assert times[0] == pytest.approx(fall, rel=1e-15)
    np.testing.assert_allclose(np.diff(times), 2 * fall * e ** np.arange(1, 31), rtol=1e-11)  # eps t of the sums
    problem = problems.bouncing_ball(e, h0, g)
    assert times[29] < problem.t_span[1] < times[30]
    peaks, speeds = problem.exact((times[:-1] + times[1:]) / 2)
    np.testing.assert_allclose(peaks, h0 * e ** (2 * np.arange(1, 31)), rtol=1e-9)
    np.testing.assert_allclose(speeds, 0, rtol=0, atol=1e-13 * g)
    assert np.abs(problem.exact(times)[0]).max() < 1e-13 * h0
    _, v = problem.exact(times[:5, None] + [-1e-6, 1e-6])
    np.testing.assert_allclose(v[:, 1], -e * v[:, 0], rtol=0, atol=2e-5)  # g (1 + e) 1e-6 of change in between


def test_the_ball_falls_freely_until_the_first_impact_and_rests_after_the_last():
    e, h0, g = 0.8, 1.0, 9.81
    problem = problems.bouncing_ball(e, h0, g)
    t = np.array([0.0, 0.2, 0.4])
    np.testing.assert_allclose(problem.exact(t)[0], h0 - g * t**2 / 2, rtol=1e-14)
    np.testing.assert_allclose(problem.exact(t)[1], -g * t, rtol=0, atol=1e-14)
    last = math.sqrt(2 * h0 / g) * (1 + e) / (1 - e)  # the geometric series
    assert impact_times(200, e, h0, g)[-1] == pytest.approx(last, rel=1e-14)
    assert problem.exact(last + 1.0) == (0.0, 0.0)


def test_without_loss_the_ball_returns_to_its_height():
    problem = problems.bouncing_ball(1.0)
    fall = math.sqrt(2 / 9.81)
    np.testing.assert_allclose(impact_times(100, 1.0, 1.0, 9.81), fall * np.arange(1, 200, 2), rtol=1e-15)
    u, v = problem.exact(fall * np.arange(0, 200, 2))
    np.testing.assert_allclose(u, 1.0, rtol=0, atol=1e-13)
    np.testing.assert_allclose(v, 0.0, rtol=0, atol=1e-12)  # eps t g
    assert flights(1.3, 1 - 1e-9, 1.0, 9.81)[0] == pytest.approx(problem.exact(1.3)[0], abs=1e-8)


def test_the_impact_of_the_ball_reverses_its_velocity():
    problem = problems.bouncing_ball(0.7)
    (event,) = problem.events.values()
    p = np.array(problem.params)
    assert event.direction == -1
    assert event.g(0.0, 0.3, -2.0, p) == 0.3
    assert event.apply(0.0, 1e-17, -2.0, p) == (0.0, 1.4)


@pytest.mark.parametrize("steps", [{"h": 1e-3}, {"rtol": 1e-6}])
def test_an_ensemble_of_balls_bounces(steps):
    ball = problems.bouncing_ball()
    heights = np.array([1.0, 2.0])
    balls = ball.ensemble(u0=heights, **steps)
    np.testing.assert_allclose(balls.events["impact"].first, np.sqrt(2 * heights / 9.81), rtol=1e-12)
    for i, height in enumerate(heights):
        alone = ball.with_(u0=height).integrate(save_every=None, **steps)
        assert balls.status[i] is alone.status
        np.testing.assert_array_equal(balls[i].events["impact"].v_after, alone.events["impact"].v_after)
        np.testing.assert_array_equal(balls[i].u, alone.u)


def test_friction_takes_its_share_of_every_peak():
    """-0.85, 0.65, -0.45, 0.25: the smoothing spares 0.8 mu v_s^2 / a of work at a turn, 1e-6 of amplitude in all."""
    run = problems.friction_oscillator().integrate(h=1e-3, method="rk4")
    turns = np.flatnonzero(run.v[1:-1] * run.v[2:] < 0) + 1
    peaks = [run.u[i] if abs(run.v[i]) < abs(run.v[i + 1]) else run.u[i + 1] for i in turns]
    np.testing.assert_allclose(peaks, [-0.85, 0.65, -0.45, 0.25], rtol=0, atol=5e-6)  # half a step off is 1e-7
    np.testing.assert_allclose(run.t[turns], np.pi * np.arange(1, 5), rtol=0, atol=5e-3)  # v_s / a and a step


def test_exact_solution_of_the_two_frequencies():
    """Against RK4, late by (omega h)^4 / 120 of a radian a radian: 8e-7 of the fast amplitude after 10^4 radians."""
    problem = problems.two_frequency_oscillator(u0=(0.7, -0.3), t_end=10.0)
    run = problem.integrate(h=1e-5, method="rk4", save_every=100)
    u, v = problem.exact(run.t)
    np.testing.assert_allclose(run.u, u, rtol=0, atol=1e-6)
    np.testing.assert_allclose(run.v, v, rtol=0, atol=1e-3)  # a thousand times u
    slow, slow_v = problem.exact(2.0)
    assert slow[0] == pytest.approx(0.7 * math.cos(2.0), rel=1e-15)
    assert slow_v[0] == pytest.approx(-0.7 * math.sin(2.0), rel=1e-15)


def test_eig3_takes_its_staggered_form_where_nothing_reads_the_velocity():
    for method in ("EIG3", eig3.EIG3()):
        assert problems.hardening_spring().stepper(h=0.1, method=method).running.velocity == "none"
        assert problems.spring_pendulum().stepper(h=0.1, method=method).running.velocity == "auto"


def test_cd_takes_its_explicit_form_where_nothing_reads_the_velocity():
    assert problems.single_dof().integrate(h=0.1, method="cd", t_end=10).n_iterations == 0
    assert problems.single_dof(xi=0.1).integrate(h=0.1, method="cd", t_end=10).n_iterations > 0
    record = eig3.CentralDifference()
    run = problems.single_dof().integrate(h=0.1, method=record, t_end=10)
    assert (run.method, run.n_rhs) == (record, run.n_steps + 1)


def test_constants_are_the_articles():
    assert problems.single_dof().params[0] == 4.0
    assert problems.hardening_spring().params == (100.0, 10.0)
    assert problems.softening_spring().params == (100.0,)
    assert problems.spring_pendulum().params == (1.0, 0.5, 98.1, 9.81)
    assert problems.spring_pendulum().u0.tolist() == [0.75, math.pi / 2]


@pytest.mark.parametrize(
    ("build", "name", "value", "what"),
    [
        (problems.single_dof, "omega", 0, "positive"),
        *(
            (problems.double_pendulum, name, value, "positive")
            for name in ("m1", "m2", "l1", "l2")
            for value in (0, -1)
        ),
        (problems.duffing, "delta", -0.1, "not be negative"),
        (problems.van_der_pol, "mu", -1, "not be negative"),
        (problems.kepler, "GM", 0, "positive"),
        (problems.kepler, "a", -1, "positive"),
        (problems.kepler, "e", 1.0, "at least 0 and below 1"),
        (problems.kepler, "e", -0.1, "at least 0 and below 1"),
        (problems.kepler, "e", math.nan, "at least 0 and below 1"),
        (problems.henon_heiles, "E", 0, "positive and below 1/6"),
        (problems.henon_heiles, "E", 0.2, "positive and below 1/6"),
        (problems.henon_heiles, "y0", 0.9, "closer to 0"),
        (problems.rotor, "omega", 0, "positive"),
        (problems.rotor, "beta", -1, "not be negative"),
        (problems.hertz_impact, "k", 0, "positive"),
        (problems.hertz_impact, "speed", -1, "positive"),
        (problems.arenstorf, "mu", 0, "positive and at most 0.5"),
        (problems.arenstorf, "mu", 0.6, "positive and at most 0.5"),
        (problems.bouncing_ball, "restitution", 0, "positive and at most 1"),
        (problems.bouncing_ball, "restitution", 1.1, "positive and at most 1"),
        (problems.bouncing_ball, "h0", 0, "positive"),
        (problems.bouncing_ball, "g", -1, "positive"),
        (problems.friction_oscillator, "omega", 0, "positive"),
        (problems.friction_oscillator, "mu", -0.1, "not be negative"),
        (problems.friction_oscillator, "v_s", 0, "positive"),
        (problems.two_frequency_oscillator, "omega", 0, "positive"),
        (problems.two_frequency_oscillator, "omega_fast", -1, "positive"),
    ],
)
def test_bad_constants_are_refused(build, name, value, what):
    with pytest.raises(ValueError, match=rf"^{name} must .*{what}.*, not {value}\.$"):
        build(**{name: value})


def test_invariants_can_be_replaced():
    run = problems.single_dof().integrate(h=0.1, t_end=10, invariants={})
    assert run.drift == {}


def picture(problem, solution):
    figure = Figure(dpi=40)
    problem.draw(figure, solution)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())


def have_equal_parts(*functions):
    """Return whether the functions are one, with equal numbers and arrays that `functools.partial` binds."""
    try:
        np.testing.assert_equal(*((f.func, f.keywords) if isinstance(f, functools.partial) else f for f in functions))
    except (AssertionError, ValueError):
        return False  # also of objects that compare by identity
    return True


@pytest.mark.parametrize("name", problems.__all__)
def test_copies_of_a_problem_have_its_exact_solution_and_its_picture(name):
    """The picture is that of a free motion, which takes no time to compile, or of a run."""
    problem = getattr(problems, name)(**FEWER.get(name, {}))
    t = np.linspace(*problem.t_span, 21)
    solution = made_up(t, problem.u0 + np.multiply.outer(t, problem.v0))
    pickled = pickle.loads(pickle.dumps(problem))
    for other in (pickled, copy.deepcopy(problem)):
        for function in ("exact", "continuum"):
            one, two = getattr(problem, function), getattr(other, function)
            assert (one is None) == (two is None)
            if one:
                np.testing.assert_array_equal(two(solution.t), one(solution.t))
    if have_equal_parts(pickled.draw, problem.draw):
        return
    if name in WITH_RESULTS:
        h = problem.h or min(0.1 * problem.critical_step().h, 1e-3 * problem.t_span[1])
        solution = problem.integrate(h=h, t_end=20 * h)
    np.testing.assert_array_equal(picture(pickled, solution), picture(problem, solution))
