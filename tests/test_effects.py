"""Each effect alone: its force and potential, its arguments, and whether it conserves or dissipates energy."""

import dataclasses
import functools
import math
import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eig3 import effects, jit
from eig3.effects import (
    BreakingString,
    Cable,
    Coulomb,
    CoulombFriction,
    Gap,
    Gravity,
    HardeningSpring,
    HertzContact,
    LinearDamper,
    LinearSpring,
    MassImpact,
    Motor,
    PlaneContact,
    QuadraticDrag,
    RigidStop,
    RotatingFrame,
    SampledAcceleration,
    SampledMotion,
    SofteningSpring,
    Torque,
)
from eig3.problems.hertz_impact import contact_time
from eig3.scene import Scene
from eig3.scene.names import words

from .conftest import ROOT, acceleration, refusals, shaken


def unit(dimension):
    return np.eye(dimension)[-1]


running = jit(lambda t: 0.7 + t)
running_in_space = jit(lambda t: (0.2, t, -0.4))


def rows_of_the_table():
    """The effects of the README's table, as they stand there."""
    names = {**vars(effects), "motion": shaken, "torque": running, "distance": shaken}
    rows = re.findall(r"^\| `(\w+\(.*?\))` ", (ROOT / "eig3/scene/README.md").read_text(), flags=re.MULTILINE)
    return [eval(row, names) for row in rows]


def in_dimension(effect, d):
    """An effect in the plane for another dimension: the last axis stays the last one."""
    changed = {}
    for name in effect.vectors if d != 2 and not isinstance(effect, effects.Link) else ():  # a link has lists of points
        vector = np.atleast_1d(getattr(effect, name))
        of_turning = vector.size == 1  # about an axis, which in the plane is across it
        changed[name] = vector * (0.3, -0.6, 1.0) if of_turning else [0.0, *vector] if d == 3 else vector[1:]
    return dataclasses.replace(effect, **changed)


ELSEWHERE = (
    effects.Cell | effects.Constraint | effects.FrictionalContact | effects.Ewald
)  # these have tests in other files
OTHER_FORMS = {
    "linear spring without length": lambda d: LinearSpring(50.0),
    "damped plane contact": lambda d: PlaneContact(400.0, unit(d), 1.4, damping=0.1),
    "rough plane contact": lambda d: PlaneContact(400.0, unit(d), 1.4, friction=0.3),
    "damped rough plane contact": lambda d: PlaneContact(400.0, unit(d), 1.4, damping=0.1, friction=0.3),
    "damped hertz contact": lambda d: HertzContact(400.0, 1.4 + 0.3 * d, damping=0.1),
    "damped cable": lambda d: Cable(50.0, 0.8, 2.0),
    "damped gap": lambda d: Gap(50.0, 0.1, 2.4, 2.0),
    "damped coulomb": lambda d: Coulomb(2.0, 0.5, 4.0),
    "friction on a plane": lambda d: CoulombFriction(0.3, 9.81, 0.05, unit(d)),
    "motor": lambda d: Motor(running if d == 2 else running_in_space),
}
#: Every effect of the table that is tested here, and its other forms, as a function of the dimension of the scene.
CATALOGUE = {
    words(effect.title): functools.partial(in_dimension, effect)
    for effect in rows_of_the_table()
    if not isinstance(effect, ELSEWHERE)
} | OTHER_FORMS
PLANAR = (
    "rotating frame",
    "torque",
    "motor",
    "friction on a plane",
    "rough plane contact",
    "damped rough plane contact",
)  # need a second dimension
OF_BODIES = "torque", "motor"  # the reactions of rigid bodies always depend on the velocity
MASSES = (1.5, 0.7)
CASES = [(name, d) for name in CATALOGUE for d in (1, 2, 3) if d > 1 or name not in PLANAR]


def scene_with(*names, dimension=2, work=False, seed=0):
    """Two masses and a fixed point with effects. A motion moves the fixed point, which a spring joins to a mass."""
    rng = np.random.default_rng(seed)
    scene = Scene(dimension)
    places = np.arange(3)[:, None] * np.ones(dimension) + 0.2 * rng.standard_normal((3, dimension))
    places, speeds = (x[:, 0] if dimension == 1 else x for x in (places, rng.standard_normal((3, dimension))))
    post = scene.fixed(places[0])
    masses = scene.mass(MASSES, places[1:], speeds[1:])
    for effect in (CATALOGUE[name](dimension) for name in names):
        if isinstance(effect, effects.Motion):
            scene.add(effect, post)
            scene.add(LinearSpring(50.0, 0.8), post, masses[0])
        elif isinstance(effect, effects.Link):
            scene.add(effect, masses[0], masses[1])
            scene.add(effect, post, masses[0])
        elif isinstance(effect, Torque | Motor):
            inertia = 0.3 if dimension == 2 else (0.3, 0.4, 0.5)
            scene.add(effect, scene.body(1.0, inertia, np.zeros(dimension)).axes)
        else:
            scene.add(effect)
    return scene.problem((0.0, 2.0), work=work)


def test_the_table_has_a_row_for_every_effect():
    """The other classes are those that effects of one's own derive from, without fields, and links of structures."""
    given = {name: getattr(effects, name) for name in effects.__all__}
    known = {name for name, each in given.items() if dataclasses.is_dataclass(each) and each.directions == 1}
    assert sorted(effect.title for effect in rows_of_the_table()) == sorted(known)
    assert all(build(2).source for build in CATALOGUE.values())


@pytest.mark.parametrize(("name", "dimension"), CASES)
def test_a_force_is_minus_the_gradient_of_its_potential(name, dimension):
    """By central differences; their error is some 1e-9 of the largest second derivative here.

    Python runs the code of the scene here and in the next test. The one after it compiles the force and the energy.
    """
    has_potential = "potential" in CATALOGUE[name](dimension).functions()
    problem = scene_with(name, dimension=dimension, work=has_potential)
    if not has_potential:
        assert problem.energy is None or problem.energy_of(problem.u0, 0 * problem.v0) == 0
        return
    u, rest, step = problem.u0, np.zeros(problem.u0.size), 1e-6
    coordinates = np.arange(2 * dimension)  # a state may follow
    energy, a = problem.energy.py_func, np.full(u.size, np.nan)
    gradient = [
        (energy(0.0, u + step * e, rest, problem.params) - energy(0.0, u - step * e, rest, problem.params)) / (2 * step)
        for e in np.eye(u.size)[coordinates]
    ]
    problem.rhs.py_func(0.0, u, rest, problem.params, a)
    force = a[coordinates] * np.tile(MASSES, dimension)
    assert np.abs(force).max() > 0.1
    np.testing.assert_allclose(force, -np.array(gradient), rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(("name", "dimension"), [case for case in CASES if case[0] not in OF_BODIES])
def test_the_force_depends_on_the_velocity_if_the_effect_reads_it(name, dimension):
    problem = scene_with(name, dimension=dimension)
    rhs, speeds = problem.rhs.py_func, (problem.v0, problem.v0 + 1.0)
    moving, other = (acceleration(problem, problem.u0, v, rhs=rhs) for v in speeds)
    assert (moving != other).any() == problem.uses_velocity


DISSIPATIVE = "linear damper", "quadratic drag", "coulomb friction", "friction on a plane"
KINKS = "contact", "cable", "gap"
#: Effects with a smooth force and no event, which are compiled in one scene. A repulsion is too steep for others.
SMOOTH = [
    name
    for name in CATALOGUE
    if not isinstance(CATALOGUE[name](2), effects.Motion | Torque | Motor)
    and "event" not in CATALOGUE[name](2).functions()
    and name not in (*DISSIPATIVE, "lennard jones")
    and not any(kind in name for kind in KINKS)
]


#: Scenes whose effects do not keep each other from acting: each scene takes time to compile.
TOGETHER = [
    SMOOTH,
    ["elastic plastic", "giuffre menegotto pinto", "multilinear", "breaking", "breaking string", "mass impact"],
    ["support motion", "sampled acceleration"],
    ["torque", "motor"],
    ["cable", "damped cable", "gap", "damped gap"],
    ["plane contact", "hertz contact"],
    ["damped plane contact", "damped hertz contact"],
]
ALONE = [[name] for name in CATALOGUE if not any(name in names for names in TOGETHER)]


@pytest.mark.parametrize("names", TOGETHER + ALONE, ids=", ".join)
def test_the_change_of_energy_is_the_work_done(names):
    """With RK4 at h = 1e-4 and energies of some 10 J.

    The error is round-off where the force is smooth. The kink of a contact, cable or gap leaves some h^2, and a jump of
    the velocity of the support leaves h times the jump of the power.
    """
    seed = 13 if "elastic plastic" in names else 0  # links that start beyond yield must not move back
    solution = scene_with(*names, work=True, seed=seed).integrate(h=1e-4, method="rk4", save_every=10)
    has_kink = any(kind in names[0] for kind in KINKS)
    bound = 1e-3 if names == ["sampled motion"] else 1e-6 if has_kink else 1e-9
    assert solution.drift["energy"] <= bound
    if names[0] in DISSIPATIVE:
        work = solution.z["work"]
        assert work[-1] < -0.01
        assert (np.diff(work) <= 1e-15).all()


def test_coriolis_does_no_work():
    rng = np.random.default_rng(1)
    for dimension in (2, 3):
        problem = scene_with("rotating frame", dimension=dimension)
        v = rng.standard_normal(problem.v0.size)
        moving, still = (acceleration(problem, problem.u0, w, rhs=problem.rhs.py_func) for w in (v, 0 * v))
        coriolis = moving - still
        # the round-off of the sum
        assert abs(coriolis @ v) <= 1e-15 * np.abs(coriolis).max() * np.abs(v).sum()
        assert np.abs(coriolis).max() > 0.1


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_straight_line_seen_from_a_rotating_frame(dimension):
    """The motion of a free mass is exactly known, and EIG-3 approaches it with order 2."""
    rate = np.array([0.0, 0.0, 0.7]) if dimension == 2 else np.array([0.2, -0.4, 0.7])
    x0, v0 = np.array([1.0, 0.5, 0.3 * (dimension == 3)]), np.array([-0.3, 0.6, 0.2 * (dimension == 3)])
    scene = Scene(dimension)
    ball = scene.mass(2.0, x0[:dimension], (v0 - np.cross(rate, x0))[:dimension])
    scene.add(RotatingFrame(rate[-1] if dimension == 2 else rate))
    problem = scene.problem((0.0, 5.0))
    exact = Rotation.from_rotvec(-5.0 * rate).apply(x0 + 5.0 * v0)[:dimension]
    errors = [np.abs(ball.positions(problem.integrate(h=h).u[-1]) - exact).max() for h in (0.01, 0.005)]
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.05)
    assert errors[1] < 1e-3
    drifts = [problem.integrate(h=h).drift["energy"] for h in (0.01, 0.005)]
    assert drifts[1] < drifts[0] / 3.5  # Jacobi's integral


def test_two_balls_part_after_hertz_contact_time():
    """Their distance moves as one reduced mass. The end of the contact is known to a step, hence 2 h."""
    k, m, speed, h = 1e6, np.array([0.5, 2.0]), 1.3, 1e-6
    reduced = m.prod() / m.sum()
    scene = Scene(1)
    balls = scene.mass(m, [0.0, 0.1], [speed, 0.0])
    scene.add(HertzContact(k, 0.1), *balls)
    time = contact_time(k / reduced, speed)
    solution = scene.problem((0.0, 2 * time)).integrate(h=h, method="rk4")
    gap = np.diff(balls.positions(solution.u))[:, 0] - 0.1
    parted = solution.t[np.flatnonzero(gap < 0)[-1]]
    assert parted == pytest.approx(time, abs=2 * h)
    rate = np.diff(balls.velocities(solution.v))[:, 0]
    assert rate[-1] / speed == pytest.approx(1, abs=1e-6)


def test_a_damped_contact_takes_energy_and_never_pulls():
    scene = Scene(1)
    ball = scene.mass(1.0, 0.0, -2.0)
    scene.add(PlaneContact(1e6, 1.0, damping=0.3))
    problem = scene.problem((0.0, 0.02))
    solution = problem.integrate(h=1e-6, method="rk4")
    assert (np.diff(ball.velocities(solution.v)) >= 0).all()  # pushed away from the plane throughout
    assert 0.3 < ball.velocities(solution.v)[-1] / 2.0 < 0.9


@pytest.mark.parametrize("times", [np.linspace(0.0, 2.0, 21), np.sort(np.random.default_rng(3).uniform(0, 2, 40))])
def test_a_record_is_interpolated_and_constant_outside(times):
    values = np.random.default_rng(4).standard_normal(times.size)
    motion = SampledMotion(times, values)
    at = np.concatenate([np.linspace(-1, 3, 1001), times])
    found = np.array([motion.motion(t, times, values) for t in at])
    np.testing.assert_allclose(found[:, 0], np.interp(at, times, values), rtol=0, atol=1e-13)
    before = np.searchsorted(times, at, side="right") - 1
    inside = (before >= 0) & (before < times.size - 1)
    slopes = np.append(np.diff(values) / np.diff(times), 0.0)
    np.testing.assert_array_equal(found[:, 1], np.where(inside, slopes[before], 0.0))


RECORD = [0.0, 0.3, 0.5, 1.1, 1.6], [1.0, -2.0, 4.0, 0.5, -1.0]  # s, m/s^2; unequal intervals


def test_an_acceleration_is_integrated_exactly():
    """Displacement and velocity against polynomials by NumPy; the rate of the displacement is the velocity."""
    record = SampledAcceleration(*RECORD)
    times, values = map(np.array, RECORD)

    def motion(t):
        return record.motion(t, times, values, record.velocities, record.displacements)

    assert motion(-1.0) == (0.0, 0.0)
    x, v = 0.0, 0.0
    for k in range(4):
        length = times[k + 1] - times[k]
        a = np.polynomial.Polynomial([values[k], (values[k + 1] - values[k]) / length])
        speed, place = a.integ(k=v), a.integ(k=v).integ(k=x)
        for s in (0.0, 0.3 * length, 0.9 * length):
            assert motion(times[k] + s) == pytest.approx((place(s), speed(s)), rel=1e-13, abs=1e-15)
        x, v = place(length), speed(length)
    assert motion(3.0) == pytest.approx((x + 1.4 * v, v), rel=1e-13)  # no acceleration after the record


def test_a_building_on_a_sampled_acceleration_follows_the_exact_solution():
    """The relative displacement z follows z'' + 2 xi omega z' + omega^2 z = -a(t), and a is linear between samples.

    There (2 xi a' / omega - a) / omega^2 is a particular solution, and the difference from it is a damped oscillation.
    RK4 has steps that end at the samples, so its order is 4.
    """
    omega, xi, m = 12.0, 0.05, 3.0
    damped = omega * np.sqrt(1 - xi**2)
    times, values = map(np.array, RECORD)
    z = np.zeros(2)
    for k in range(4):
        length = times[k + 1] - times[k]
        slope = (values[k + 1] - values[k]) / length

        def particular(a, slope=slope):
            return np.array([(2 * xi / omega * slope - a) / omega**2, -slope / omega**2])

        rest = z - particular(values[k])
        c, s = np.cos(damped * length), np.sin(damped * length)
        other = (rest[1] + xi * omega * rest[0]) / damped
        q = rest[0] * c + other * s
        oscillation = np.array([q, -xi * omega * q + damped * (other * c - rest[0] * s)])
        z = np.exp(-xi * omega * length) * oscillation + particular(values[k + 1])
    scene = Scene(1)
    ground, floor = scene.fixed(0.0), scene.mass(m, 0.0)
    record = SampledAcceleration(times, values)
    scene.add(record, ground)
    scene.add(LinearSpring(m * omega**2), ground, floor)
    scene.add(LinearDamper(2 * xi * omega * m), ground, floor)
    problem = scene.problem((0.0, times[-1]))
    exact = z + np.array([record.displacements[-1], record.velocities[-1]])
    ends = [problem.integrate(h=h, method="rk4", save_every=None) for h in (2e-3, 1e-3)]
    errors = [np.abs([end.u[-1, 0], end.v[-1, 0]] - exact).max() for end in ends]
    assert errors[0] / errors[1] == pytest.approx(16, rel=0.1)
    assert errors[1] < 1e-8


def test_friction_at_high_speed_is_its_limit():
    """A sliding mass loses speed at the rate coefficient load / m while its speed is far above slip."""
    scene = Scene(2)
    scene.mass(2.0, (0.0, 0.0), (3.0, 4.0))
    scene.add(CoulombFriction(0.5, 2.0 * 9.81, regularization_speed=1e-4))
    solution = scene.problem((0.0, 0.5)).integrate(h=1e-4)
    assert np.hypot(*solution.v[-1]) == pytest.approx(5 - 0.5 * 9.81 * 0.5, rel=1e-6)
    scene = Scene(2)
    scene.mass(2.0, (0.0, 0.0), (3.0, 4.0))
    scene.add(CoulombFriction(0.5, 2.0 * 9.81, regularization_speed=1e-4, normal=(0.0, 1.0)))
    problem = scene.problem((0.0, 0.5))
    a = acceleration(problem, problem.u0, problem.v0, rhs=problem.rhs.py_func)
    assert a == pytest.approx([-0.5 * 9.81, 0.0], rel=1e-6)  # along the plane only


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_block_slides_down_a_rough_slope(dimension):
    """Its acceleration is g (sin - friction cos) of the slope's angle, and a mass off the plane feels no friction."""
    slope, friction = 0.6, 0.3
    up = unit(dimension)
    down = np.roll(up, 1)
    field = 9.81 * (math.sin(slope) * down - math.cos(slope) * up)
    scene = Scene(dimension)
    block = scene.mass(2.0, -((2.0 * 9.81 * math.cos(slope) / 1e6) ** (2 / 3)) * up)
    scene.add(PlaneContact(1e6, up, damping=1.0, friction=friction, regularization_speed=1e-4))
    scene.add(Gravity(field))
    solution = scene.problem((0.0, 1.0)).integrate(h=1e-5, save_every=1000)
    speed = block.velocities(solution.v) @ down
    rate = (speed[-1] - speed[50]) / (solution.t[-1] - solution.t[50])
    assert rate == pytest.approx(9.81 * (math.sin(slope) - friction * math.cos(slope)), rel=1e-6)
    flying = Scene(dimension)
    ball = flying.mass(2.0, up, down)
    flying.add(PlaneContact(1e6, up, friction=friction))
    assert ball.positions(flying.problem((0.0, 1.0)).integrate(h=1e-3).v[-1]) == pytest.approx(down)


def between_points(link):
    scene = Scene(1)
    scene.add(link, *scene.mass(1.0, [0.0, 1.0]))


BAD_VALUES = {
    "stiffness of LinearSpring must not be negative.": lambda: LinearSpring(-1.0),
    "stiffness of LinearSpring must not be": lambda: LinearSpring([2.0, -1.0]),
    "rest_length of LinearSpring must not be negative.": lambda: between_points(LinearSpring(1.0, -1.0)),
    "damping of LinearDamper must not be negative.": lambda: LinearDamper(-1.0),
    "drag of QuadraticDrag must not be negative.": lambda: QuadraticDrag(-1.0),
    "stiffness of HertzContact must not be": lambda: HertzContact(-1.0, 1.0),
    "contact_distance of HertzContact must not be negative.": lambda: HertzContact(1.0, -1.0),
    "stiffness of PlaneContact must not be": lambda: PlaneContact(-1.0, 1.0),
    "mu of CoulombFriction must not": lambda: CoulombFriction(-0.1, 1.0),
    "stiffness of HardeningSpring must not be negative.": lambda: HardeningSpring(-1.0, 1.0),
    "stiffness of SofteningSpring must not be negative.": lambda: SofteningSpring(-1.0),
    "saturation of SofteningSpring must be positive.": lambda: SofteningSpring(1.0, 0.0),
    "restitution of RigidStop must not be": lambda: RigidStop(1.0, 0.0, -0.1),
    "restitution of MassImpact must not be above 1.": lambda: MassImpact(0.0, 1.1),
    "rest_speed of MassImpact must be positive.": lambda: MassImpact(0.0, 1.0, 0.0),
    "normal of RigidStop must be a unit vector.": lambda: RigidStop((1.0, 1.0)),
    "strength of BreakingString must not": lambda: BreakingString(1.0, 1.0, -1.0),
    "damping of LinearDamper must be finite.": lambda: LinearDamper(math.nan),
}
BAD_TYPES = {
    "stiffness of LinearSpring must be made of real numbers": lambda: LinearSpring("soft"),
    "field of Gravity must be made of real numbers": lambda: Gravity(("0", "-9.81")),
    "values of SampledAcceleration must be made of real numbers": lambda: SampledAcceleration([0, 1], ["a", "b"]),
}


test_bad_parameters = refusals(BAD_VALUES, BAD_TYPES)
