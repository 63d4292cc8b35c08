"""Each effect by itself: its force and potential, what it reads, conserves and dissipates."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eig3 import effects
from eig3.effects import (
    CoulombFriction,
    Gravity,
    HardeningSpring,
    HarmonicForce,
    LinearDamper,
    LinearSpring,
    MassContact,
    PlaneContact,
    QuadraticDrag,
    RotatingFrame,
    SampledMotion,
    SofteningSpring,
    SupportMotion,
)
from eig3.problems.hertz_impact import contact_time
from eig3.scene import Scene

from .conftest import acceleration, shaken


def unit(dimension):
    return np.eye(dimension)[-1]


#: Every effect of the catalogue, in each form that it has, by the dimension of the scene.
CATALOGUE = {
    "gravity": lambda d: Gravity(9.81 * unit(d)),
    "linear spring": lambda d: LinearSpring(50.0, 0.8),
    "linear spring without length": lambda d: LinearSpring(50.0),
    "hardening spring": lambda d: HardeningSpring(50.0, 2.0, 0.8),
    "softening spring": lambda d: SofteningSpring(50.0, 0.2, 0.8),
    "linear damper": lambda d: LinearDamper(2.0),
    "quadratic drag": lambda d: QuadraticDrag(0.3),
    "harmonic force": lambda d: HarmonicForce(3.0 * unit(d), 2.0, 0.4),
    "plane contact": lambda d: PlaneContact(400.0, unit(d), 1.4),
    "damped plane contact": lambda d: PlaneContact(400.0, unit(d), 1.4, damping=0.1),
    "rough plane contact": lambda d: PlaneContact(400.0, unit(d), 1.4, friction=0.3),
    "damped rough plane contact": lambda d: PlaneContact(400.0, unit(d), 1.4, damping=0.1, friction=0.3),
    "mass contact": lambda d: MassContact(400.0, 1.4 + 0.3 * d),
    "damped mass contact": lambda d: MassContact(400.0, 1.4 + 0.3 * d, damping=0.1),
    "friction": lambda d: CoulombFriction(0.3, 9.81, 0.05),
    "friction on a plane": lambda d: CoulombFriction(0.3, 9.81, 0.05, unit(d)),
    "rotating frame": lambda d: RotatingFrame(0.7 if d == 2 else (0.2, -0.4, 0.7)),
    "sampled motion": lambda d: SampledMotion([0.0, 1.0, 3.0], [0.0, 0.1, -0.1], unit(d)),
    "support motion": lambda d: SupportMotion(shaken, unit(d)),
}
PLANAR = (
    "rotating frame",
    "friction on a plane",
    "rough plane contact",
    "damped rough plane contact",
)  # need a second dimension
MASSES = (1.5, 0.7)
CASES = [(name, d) for name in CATALOGUE for d in (1, 2, 3) if d > 1 or name not in PLANAR]


def scene_with(name, dimension, *, work=False, seed=0):
    """Two masses, one of them beside a fixed point, with one effect; motions move the point that a spring holds."""
    rng = np.random.default_rng(seed)
    scene = Scene(dimension)
    places = np.arange(3)[:, None] * np.ones(dimension) + 0.2 * rng.standard_normal((3, dimension))
    places, speeds = (x[:, 0] if dimension == 1 else x for x in (places, rng.standard_normal((3, dimension))))
    post = scene.fixed(places[0])
    masses = scene.mass(MASSES, places[1:], speeds[1:])
    effect = CATALOGUE[name](dimension)
    if isinstance(effect, effects.Motion):
        scene.add(effect, post)
        scene.add(LinearSpring(50.0, 0.8), post, masses[0])
    elif isinstance(effect, effects.Link):
        scene.add(effect, masses[0], masses[1])
        scene.add(effect, post, masses[0])
    else:
        scene.add(effect)
    return scene.problem((0.0, 2.0), work=work)


def test_the_catalogue_is_whole():
    kinds = {effects.Body, effects.Link, effects.Motion}
    known = {getattr(effects, name) for name in effects.__all__} - kinds
    assert known == {type(build(2)) for build in CATALOGUE.values()}
    assert all(kind.source for kind in known)


@pytest.mark.parametrize(("name", "dimension"), CASES)
def test_a_force_is_minus_the_gradient_of_its_potential(name, dimension):
    """By central differences, whose error is some 1e-9 of the stiffest second derivative's scale here."""
    problem = scene_with(name, dimension)
    if problem.energy is None:
        effect = CATALOGUE[name](dimension)
        assert "potential" not in effect.functions() or isinstance(effect, effects.Motion)
        return
    u, rest, step = problem.u0, np.zeros(problem.u0.size), 1e-6
    gradient = [
        (problem.energy_of(u + step * e, rest) - problem.energy_of(u - step * e, rest)) / (2 * step)
        for e in np.eye(u.size)
    ]
    force = acceleration(problem, u, rest) * np.tile(MASSES, dimension)
    assert np.abs(force).max() > 0.1
    np.testing.assert_allclose(force, -np.array(gradient), rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(("name", "dimension"), CASES)
def test_it_reads_the_velocity_if_it_says_so(name, dimension):
    problem = scene_with(name, dimension)
    moving, other = (acceleration(problem, problem.u0, v) for v in (problem.v0, problem.v0 + 1.0))
    assert (moving != other).any() == problem.uses_velocity


@pytest.mark.parametrize("name", CATALOGUE)
def test_the_change_of_energy_is_the_work_done(name):
    """RK4 at h = 1e-4 and energies of some 10 J: round-off where the force is smooth; a contact's kink leaves some h^2,
    and the jump of a record's velocity h times that of the power."""
    solution = scene_with(name, 2, work=True).integrate(h=1e-4, method="rk4", save_every=None)
    bound = 1e-3 if "sampled" in name else 1e-6 if "contact" in name else 1e-9
    assert solution.drift["energy"] <= bound


@pytest.mark.parametrize("name", ["linear damper", "quadratic drag", "friction", "friction on a plane"])
def test_what_dissipates_only_takes_energy(name):
    work = scene_with(name, 2, work=True).integrate(h=1e-4, method="rk4").v[:, -1]
    assert work[-1] < -0.01
    assert (np.diff(work) <= 1e-15).all()


def test_coriolis_does_no_work():
    rng = np.random.default_rng(1)
    for dimension in (2, 3):
        problem = scene_with("rotating frame", dimension)
        v = rng.standard_normal(problem.v0.size)
        coriolis = acceleration(problem, problem.u0, v) - acceleration(problem, problem.u0, 0 * v)
        assert abs(coriolis @ v) <= 1e-15 * np.abs(coriolis).max() * np.abs(v).sum()  # round-off of the sum
        assert np.abs(coriolis).max() > 0.1


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_straight_line_seen_from_a_rotating_frame(dimension):
    """Exact, and of second order."""
    rate = np.array([0.0, 0.0, 0.7]) if dimension == 2 else np.array([0.2, -0.4, 0.7])
    x0, v0 = np.array([1.0, 0.5, 0.3 * (dimension == 3)]), np.array([-0.3, 0.6, 0.2 * (dimension == 3)])
    scene = Scene(dimension)
    ball = scene.mass(2.0, x0[:dimension], (v0 - np.cross(rate, x0))[:dimension])
    scene.add(RotatingFrame(rate[-1] if dimension == 2 else rate))
    problem = scene.problem((0.0, 5.0))
    exact = Rotation.from_rotvec(-5.0 * rate).apply(x0 + 5.0 * v0)[:dimension]
    errors = [np.abs(ball.of(problem.integrate(h=h).u[-1]) - exact).max() for h in (0.01, 0.005)]
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.05)
    assert errors[1] < 1e-3
    drifts = [problem.integrate(h=h).drift["energy"] for h in (0.01, 0.005)]
    assert drifts[1] < drifts[0] / 3.5  # Jacobi's integral


def test_two_balls_part_as_they_met_in_hertz_time():
    """Two masses are one of the reduced mass. The contact is over at a step, hence the 2 h."""
    k, m, speed, h = 1e6, np.array([0.5, 2.0]), 1.3, 1e-6
    reduced = m.prod() / m.sum()
    scene = Scene(1)
    balls = scene.mass(m, [0.0, 0.1], [speed, 0.0])
    scene.add(MassContact(k, 0.1), *balls)
    time = contact_time(k / reduced, speed)
    solution = scene.problem((0.0, 2 * time)).integrate(h=h)
    gap = np.diff(balls.of(solution.u))[:, 0] - 0.1
    parted = solution.t[np.flatnonzero(gap < 0)[-1]]
    assert parted == pytest.approx(time, abs=2 * h)
    rate = np.diff(balls.of(solution.v))[:, 0]
    assert rate[-1] / speed == pytest.approx(1, abs=1e-6)


def test_a_damped_contact_takes_energy_and_never_pulls():
    scene = Scene(1)
    ball = scene.mass(1.0, 0.0, -2.0)
    scene.add(PlaneContact(1e6, 1.0, damping=0.3))
    problem = scene.problem((0.0, 0.02))
    solution = problem.integrate(h=1e-6, method="rk4")
    assert (np.diff(ball.of(solution.v)) >= 0).all()  # pushed away from the plane throughout
    assert 0.3 < ball.of(solution.v)[-1] / 2.0 < 0.9


@pytest.mark.parametrize("times", [np.linspace(0.0, 2.0, 21), np.sort(np.random.default_rng(3).uniform(0, 2, 40))])
def test_a_record_is_interpolated_and_its_ends_hold(times):
    values = np.random.default_rng(4).standard_normal(times.size)
    motion = SampledMotion(times, values)
    at = np.concatenate([np.linspace(-1, 3, 1001), times])
    found = np.array([motion.motion(t, times, values) for t in at])
    np.testing.assert_allclose(found[:, 0], np.interp(at, times, values), rtol=0, atol=1e-13)
    before = np.searchsorted(times, at, side="right") - 1
    inside = (before >= 0) & (before < times.size - 1)
    slopes = np.append(np.diff(values) / np.diff(times), 0.0)
    np.testing.assert_array_equal(found[:, 1], np.where(inside, slopes[before], 0.0))


def test_friction_stops_at_its_limit():
    """A sliding mass is slowed by coefficient load / m until its speed is near the slip's."""
    scene = Scene(2)
    scene.mass(2.0, (0.0, 0.0), (3.0, 4.0))
    scene.add(CoulombFriction(0.5, 2.0 * 9.81, slip=1e-4))
    solution = scene.problem((0.0, 0.5)).integrate(h=1e-4)
    assert np.hypot(*solution.v[-1]) == pytest.approx(5 - 0.5 * 9.81 * 0.5, rel=1e-6)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_block_slides_down_a_rough_slope(dimension):
    """With g (sin - friction cos) of the slope, from where the plane bears it; and in the air nothing rubs."""
    slope, friction = 0.6, 0.3
    up = unit(dimension)
    down = np.roll(up, 1)
    field = 9.81 * (math.sin(slope) * down - math.cos(slope) * up)
    scene = Scene(dimension)
    block = scene.mass(2.0, -((2.0 * 9.81 * math.cos(slope) / 1e6) ** (2 / 3)) * up)
    scene.add(PlaneContact(1e6, up, damping=1.0, friction=friction, slip=1e-4))
    scene.add(Gravity(field))
    solution = scene.problem((0.0, 1.0)).integrate(h=1e-5, save_every=1000)
    speed = block.of(solution.v) @ down
    rate = (speed[-1] - speed[50]) / (solution.t[-1] - solution.t[50])
    assert rate == pytest.approx(9.81 * (math.sin(slope) - friction * math.cos(slope)), rel=1e-6)
    flying = Scene(dimension)
    ball = flying.mass(2.0, up, down)
    flying.add(PlaneContact(1e6, up, friction=friction))
    assert ball.of(flying.problem((0.0, 1.0)).integrate(h=1e-3).v[-1]) == pytest.approx(down)
