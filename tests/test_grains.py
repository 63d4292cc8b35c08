"""Grains: spin, friction, and the springs between surfaces that touch, which are a part of the state of a run."""

import ast
import copy
import inspect
from dataclasses import dataclass, replace

import numpy as np
import pytest

import eig3
from eig3 import effects, problems
from eig3.effects.hertz_mindlin import damping_ratio
from eig3.scene import Scene, pair_force

from .conftest import acceleration, assert_same, refusals
from .test_neighbours import by_python

R, M = 0.1, 0.02
SPHERE, DISC = 0.4 * M * R * R, 0.5 * M * R * R


def hertz_mindlin(**fields):
    return effects.HertzMindlin(**{"E": 1e7, "nu": 0.3, "contact_distance": 2 * R, "friction": 0.4, **fields})


@dataclass(frozen=True, eq=False)
class Block(effects.FrictionalContact):
    """Linear springs across the surfaces and along them."""

    stiffness: float
    shear: float
    contact_distance: float
    friction: float
    wall_radius: float = R
    loss: float = 0.0

    tension = eig3.jit(lambda r, stiffness, contact_distance: -stiffness * (contact_distance - r))
    shear_stiffness = eig3.jit(lambda shear: shear)
    shear_damping = eig3.jit(lambda loss: loss)


def of_two(places, speeds, spins, stiffness=0.01, **fields):
    """Two spheres in a plane, and a spring between them: a weak one holds 1 % of the energy."""
    scene = Scene(2)
    pair = scene.mass(M, places, speeds, inertia=SPHERE, angular_velocity=spins)
    scene.add(hertz_mindlin(**fields), pair)
    scene.add(effects.LinearSpring(stiffness, rest_length=0.1), pair[0], pair[1])
    return scene


def oblique(dimension=2, spin=0.0, **fields):
    """Two spheres that strike each other obliquely, in space beside a third one."""
    if dimension == 2:
        return of_two([[0, 0], [0.19, 0.08]], [[0.5, 0], [-0.5, 0]], spin, **fields)
    places, speeds = [[0, 0, 0], [0.19, 0.08, 0.03], [0, 9, 0]], [[0.5, 0, 0], [-0.5, 0, 0], [0, 0, 0]]
    spins = spin * np.array([[1.0, 0.5, -1.0], [0.0, 1.0, 1.0], [0.0, 0.0, 0.0]])
    sizes = np.array([1.0, 1.0, 2.0])  # equal ones would have a code of their own
    return of_three(M * sizes, places, speeds, spins, contact_distance=2 * R * sizes, **fields)


def heap(n=6, dimension=2, **fields):
    """Spheres that fall on a row of fixed ones, and collide."""
    scene, rng = Scene(dimension), np.random.default_rng(2)
    axes = [np.arange(n) * 2.1 * R, *[np.arange(2) * 2.1 * R] * (dimension - 2), 0.3 + np.arange(n) * 2.1 * R]
    x = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, dimension)
    x += rng.uniform(-0.005, 0.005, x.shape)
    grains = scene.mass(M, x, rng.normal(size=x.shape) * 0.5, inertia=SPHERE)
    floor = [np.arange(-2, n + 2) * 1.5 * R, *[np.arange(-1, 3) * 1.5 * R] * (dimension - 2), [0.0]]
    posts = scene.fixed(np.stack(np.meshgrid(*floor), axis=-1).reshape(-1, dimension))
    effect = hertz_mindlin(E=1e6, restitution=0.5, **fields)
    scene.add(effect, grains)
    scene.add(effect, grains, others=posts)
    scene.add(effects.Gravity((*[0] * (dimension - 1), -9.81)))
    return scene


def on_a_post(effect, m, place, speed, post, inertia=SPHERE, field=(0.0, 0.0)):
    """A grain beside a fixed one."""
    scene = Scene(2)
    scene.add(effect, scene.mass(m, [place], [speed], inertia=inertia), others=scene.fixed([post]))
    scene.add(effects.Gravity(field))
    return scene


def of_three(m, places, speeds, spins=0.0, **fields):
    """Three spheres in space with radii of their own."""
    scene = Scene(3)
    grains = scene.mass(m, places, speeds, inertia=SPHERE * np.array([1.0, 2.0, 3.0]), angular_velocity=spins)
    scene.add(hertz_mindlin(**fields), grains)
    return scene


@pytest.mark.parametrize(("inertia", "part"), [(DISC, 2 / 3), (SPHERE, 5 / 7)], ids=["disc", "sphere"])
def test_a_grain_that_slides_then_rolls(inertia, part):
    """On a fixed grain so large that it is nearly a plane. While it slides, friction is mu times the weight."""
    large, v0 = 1e5, 1.0
    sink = (M * 9.81 / (4 / 3 * 1e7 / (2 * (1 - 0.3**2)) * np.sqrt(R))) ** (2 / 3)  # the indentation at rest
    effect = hertz_mindlin(contact_distance=R + large, wall_radius=large)
    problem = on_a_post(effect, M, (0.0, R - sink), (v0, 0.0), (0.0, -large), inertia, (0, -9.81)).problem((0, 0.2))
    # Hertz's force at this indentation carries the weight
    assert abs(acceleration(problem, problem.u0, problem.v0)[1]) < 1e-4 * 9.81
    run = problem.integrate(h=2e-5, method="rk4", save_every=100)
    v, _, spin = run.v.T
    slides = 0.4 * 9.81 * run.t < 0.9 * v0 * (1 - part)
    np.testing.assert_allclose(v[slides], v0 - 0.4 * 9.81 * run.t[slides], rtol=0, atol=2e-4)
    assert v[-20:].mean() == pytest.approx(part * v0, abs=3e-3)
    assert -R * spin[-20:].mean() == pytest.approx(part * v0, abs=3e-3)


def test_the_stiffness_along_the_surfaces_is_mindlins_part_of_hertzs():
    """2 (1 - nu) / (2 - nu) of dF/dd = 2 E* sqrt(R d). Both have the damping of one ratio."""
    nu, d, step, size = 0.3, 1e-3, 1e-8, (R / 2, M / 2, 2 * R)
    effect = hertz_mindlin(nu=nu, restitution=0.5)

    def push(d, rate=0.0):
        return -effect.tension.py_func(2 * R - d, rate, *size, effect.plane_modulus, effect.loss)

    across = (push(d + step) - push(d - step)) / (2 * step)
    assert across == pytest.approx(2 * 1e7 / (2 * (1 - nu**2)) * np.sqrt(R / 2 * d), rel=1e-6)
    along = effect.shear_stiffness.py_func(2 * R - d, R / 2, 2 * R, effect.shear_modulus)
    assert along == pytest.approx(2 * (1 - nu) / (2 - nu) * across, rel=1e-6)
    damping = effect.shear_damping.py_func(2 * R - d, *size, effect.shear_modulus, effect.loss)
    for k, c in ((across, push(d) - push(d, 1.0)), (along, damping)):
        assert c == pytest.approx(2 * np.sqrt(5 / 6) * damping_ratio(0.5) * np.sqrt(k * M / 2), rel=1e-6)


def pressed(v=0.0, angle=0.0, weight=M * 9.81, **fields):
    """A block on a fixed grain so large that it is a slope."""
    large, load = 1e6, weight * np.cos(angle)
    effect = Block(contact_distance=R + large, wall_radius=large, **fields)
    field = np.array([weight * np.sin(angle), -load]) / M
    return on_a_post(effect, M, (0.0, R - load / effect.stiffness), (v, 0.0), (0.0, -large), None, field)


def test_a_spring_that_sticks_oscillates():
    """A grain that is pressed on a fixed one by a constant force: the period is that of the spring and the mass."""
    k = 50.0
    scene = pressed(1e-3, weight=1.0, stiffness=1e3, shear=k, friction=10.0)
    omega = np.sqrt(k / M)
    errors = []
    for method in ("eig3", "rk4", "cd"):
        x, v = [], []
        for h in (2e-3, 1e-3, 5e-4):
            run = scene.problem((0, 0.5)).integrate(h=h, method=method, save_every=None)
            x.append(run.u[-1, 0]), v.append(run.v[-1, 0])
        exact = 1e-3 / omega * np.sin(omega * 0.5), 1e-3 * np.cos(omega * 0.5)
        assert x[-1] == pytest.approx(exact[0], abs=1e-2 * 1e-3 / omega)
        assert v[-1] == pytest.approx(exact[1], abs=1e-2 * 1e-3)
        errors.append([np.hypot((a - exact[0]) * omega, b - exact[1]) for a, b in zip(x, v, strict=True)])
    for e in errors:
        assert 3.5 < e[0] / e[1] < 4.6
        assert 3.5 < e[1] / e[2] < 4.6


def test_names_in_ones_own_contact_do_not_clash_with_those_of_the_code():
    @dataclass(frozen=True, eq=False)
    class Within(Block):
        limit: float = 2.0

        shear_damping = eig3.jit(lambda loss, limit: loss * limit)

    scene = Scene(2)
    scene.add(Within(1e3, 50.0, 2 * R, 0.4), scene.mass(M, [(0.0, 0.0), (0.15, 0.1)]))
    share = scene.problem((0, 1)).rhs.py_func.__globals__["share"]
    nodes = list(ast.walk(ast.parse(inspect.getsource(share.py_func))))
    written = {node.id for node in nodes if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}
    called = {node.func.id for node in nodes if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)}
    assert "within_limit" in called
    assert not written & called


@pytest.mark.parametrize("method", ["eig3", "rk4"])
def test_the_order_is_two_while_a_contact_holds(method):
    """Spheres that touch at the start, are pulled together by a spring, and roll on each other.

    The indentation grows all the time. Where it turns within a step, the error of the spring is of the order of h^2
    too, but depends on the place within the step.
    """
    ends = []
    for h in (4e-5, 2e-5, 1e-5):
        scene = of_two([[0, 0], [0.195, 0.01]], [[0, 0.02], [0, -0.03]], [0.3, -0.5], 300.0, E=5e5, friction=50.0)
        ends.append(scene.problem((0, 0.002)).integrate(h=h, method=method, save_every=None).v[-1])
    ratio = np.linalg.norm(ends[0] - ends[1]) / np.linalg.norm(ends[1] - ends[2])
    assert 3.5 < ratio < 4.7


def test_an_accuracy_holds_for_springs_of_low_order():
    """The reference has 20 times as many steps as the run. The smallest tolerance has an error of 7e-4 here."""
    problem = oblique().problem((0.0, 0.05))
    run = problem.integrate(accuracy=1e-4)
    exact = problem.integrate(h=run.h / 20, save_every=None).u[-1]
    assert run.success
    assert np.abs(run.u[-1] - exact).max() <= 1e-4 * np.abs(run.u).max()
    checked = problem.integrate(rtol=1e-7, check=True)
    (note,) = (note for note in (*checked.notes, *checked.error.notes) if "springs" in note)
    assert "their estimate may be several times too small: give h" in note
    with pytest.raises(ValueError, match="accuracy of an ensemble needs tolerances, which do not bound"):
        problem.ensemble(accuracy=1e-4, v0=[problem.v0])


@pytest.mark.parametrize("is_fixed", [False, True], ids=["both move", "one is fixed"])
def test_spheres_that_strike_each_other_have_the_restitution(is_fixed):
    """At every speed, size and stiffness, and from hardly any rebound to an elastic one, in scenes of other tests."""
    for e in (0.03, 0.1, 0.5, 0.9, 1.0):
        for speed, radii, E in ((0.01, (R, 1.5 * R), 1e7), (3.0, (R, 3 * R), 1e5), (0.5, (2 * R, 0.1 * R), 1e9)):
            m = M * (np.array(radii) / R) ** 3
            mass = m[0] if is_fixed else m[0] * m[1] / m.sum()
            modulus, radius = E / (2 * (1 - 0.3**2)), radii[0] * radii[1] / sum(radii)
            duration = 2.87 * (mass**2 / (radius * modulus**2 * speed)) ** 0.2  # of an elastic contact: Hertz
            if is_fixed:
                effect = hertz_mindlin(E=E, contact_distance=sum(radii), wall_radius=radii[1], restitution=e)
                scene = on_a_post(effect, m[0], (0.0, 0.0), (speed, 0.0), (sum(radii), 0.0))
            else:
                places, speeds = [(0, 0, 0), (sum(radii), 0, 0), (0, 9, 0)], [(speed, 0, 0), (0, 0, 0), (0, 0, 0)]
                distances = 2 * np.array([*radii, R])
                scene = of_three(np.array([*m, M]), places, speeds, E=E, contact_distance=distances, restitution=e)
            problem = scene.problem((0, 3 * duration), work=not is_fixed)  # as in other tests with this scene
            run = problem.integrate(h=duration / 500, method="rk4", save_every=None)
            after = (0.0 if is_fixed else run.v[-1, 1]) - run.v[-1, 0]
            assert after == pytest.approx(e * speed, rel=1e-2)


CASES = [(2, {}), (2, {"friction": 2.0}), (3, {"restitution": 0.6})]


@pytest.mark.parametrize(("dimension", "fields"), CASES, ids=["elastic", "sticks", "damped"])
def test_momentum_and_angular_momentum_are_kept_and_no_energy_is_made(dimension, fields):
    problem = oblique(dimension, spin=4.0, **fields).problem((0, 0.1), work=True)
    run = problem.integrate(h=5e-6, save_every=200)
    n = dimension * dimension  # as many spheres as directions
    x, v = (values[:, :n].reshape(-1, dimension, dimension) for values in (run.u, run.v))
    spins = run.v[:, n:].reshape(len(run.t), -1, dimension)
    inertia = SPHERE if dimension == 2 else SPHERE * np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(v.sum(axis=2), v[:1].sum(axis=2).repeat(len(v), 0), rtol=0, atol=1e-12)
    if dimension == 2:
        orbital = M * (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0]).sum(axis=1)[:, None]
    else:
        orbital = M * np.cross(x, v, axis=1).sum(axis=2)
    angular = orbital + (inertia * spins).sum(axis=2)
    assert np.abs(spins[-1] - spins[0]).max() > 0.5
    # EIG-3 keeps x and v of one time only to its order: the part of the orbits has an error of this size
    scale = np.abs(orbital).max()
    np.testing.assert_allclose(angular, angular[:1].repeat(len(angular), 0), rtol=0, atol=1e-4 * scale)
    energy = problem.energy_of(run.u, run.v)
    assert energy.max() <= energy[0] * (1 + 1e-6)
    assert run.drift["energy"] < 3e-4 * energy[0]


def test_torques_balance_the_moments_of_forces():
    """In each evaluation, to round-off: the springs, the damping and the tension, with three spheres in space."""
    rng, x = np.random.default_rng(1), np.array([[0, 0, 0], [0.19, 0.02, 0.01], [0.1, 0.16, 0.03]])
    inertia, m = SPHERE * np.array([1.0, 2.0, 3.0]), M * np.array([1.0, 2.0, 3.0])
    speeds, spins, distances = rng.normal(size=(3, 3)), rng.normal(size=(3, 3)) * 5, 2 * R * np.array([1.0, 1.02, 0.97])
    scene = of_three(m, x, speeds, spins, contact_distance=distances, restitution=0.7)
    stepper = scene.problem((0, 1), work=True).stepper(h=1e-6, method="rk4")
    stepper.advance(200)
    a = stepper.acceleration(stepper.t + 3e-7, stepper.u, stepper.v)
    forces, torques = a[:9].reshape(3, 3).T * m[:, None], a[9:].reshape(3, 3).T * inertia[:, None]
    x = stepper.u[:9].reshape(3, 3).T
    size = np.abs(forces).max()
    assert np.abs(torques).max() > 1e-3 * R * size
    np.testing.assert_allclose(forces.sum(axis=0), 0, atol=1e-13 * size)
    np.testing.assert_allclose((np.cross(x, forces) + torques).sum(axis=0), 0, atol=1e-13 * size)


def test_friction_is_at_most_mu_times_the_load():
    """A grain on a slope that is less or more steep than the friction: it stays, or slides down at g (sin - mu cos)."""
    for slope, slides in ((0.35, False), (0.45, True)):
        angle = np.arctan(slope)
        scene = pressed(angle=angle, stiffness=200 * M * 9.81, shear=500.0, friction=0.4, loss=6.3)
        run = scene.problem((0, 0.5)).integrate(h=1e-4, save_every=None)
        expected = 9.81 * (np.sin(angle) - 0.4 * np.cos(angle)) * 0.5
        if slides:
            assert run.v[-1, 0] == pytest.approx(expected, rel=0.05)
        else:
            assert abs(run.u[-1, 0]) < 2 * M * 9.81 * np.sin(angle) / 500.0


@pytest.mark.parametrize("method", ["eig3", "rk4"])
def test_the_springs_are_a_part_of_the_state(method, tmp_path, monkeypatch):
    """Chunks, `extend`, files, forks and lists of other skins have the same bits."""
    options = {"h": 1e-4, "method": method, "save_every": 50}
    problem = heap().problem((0.0, 0.6))
    run = problem.integrate(**options)
    assert run.success
    halves = problem.with_(t_span=(0.0, 0.3)).integrate(**options).extend(0.6)
    assert_same(halves, run)
    halves.save(tmp_path / "run.npz")
    assert_same(problem.load(tmp_path / "run.npz").extend(0.7), run.extend(0.7))
    stepper = problem.stepper(h=run.h, method=method)
    stepper.advance(1234)
    fork = copy.copy(stepper)
    fork.advance(777)
    fork.advance(6000 - 1234 - 777)
    np.testing.assert_array_equal(fork.u, run.u[-1])
    stepper.advance(1000)
    stepper.back()
    if method == "rk4":  # which starts anew as it goes on
        stepper.params = problem.params
    stepper.advance(6000 - 1234)
    np.testing.assert_array_equal(stepper.u, run.u[-1])
    stepper.params = problem.params
    with pytest.raises(RuntimeError, match="go back before you change params"):
        stepper.back()
    parts = problem.integrate(**options, save_to=tmp_path / "parts")
    np.testing.assert_array_equal(parts.u, run.u)
    for skin in (0.01, 0.7):
        monkeypatch.setattr(pair_force, "_SKIN", skin)
        np.testing.assert_array_equal(heap().problem((0.0, 0.6)).integrate(**options).u, run.u)


def test_what_a_run_saves_and_looks_for_does_not_change_it():
    """Wanted times, outputs and events within steps are no steps: no spring advances there."""
    first = eig3.jit(lambda t, u, v, p: v[0])
    problem = heap().problem((0.0, 0.5))
    plain = problem.integrate(h=1e-4, save_every=None)
    looks = {"outputs": {"first": first}, "events": {"turn": eig3.Event(first)}}
    run = problem.integrate(h=1e-4, t_eval=np.linspace(0.0, 0.5, 777), **looks)
    np.testing.assert_array_equal(run.u[-1], plain.u[-1])
    tight = problem.integrate(rtol=1e-6, method="rk5", t_end=0.3, save_every=None)
    wanted = problem.integrate(rtol=1e-6, method="rk5", t_end=0.3, t_eval=[0.1, 0.2, 0.3], **looks)
    np.testing.assert_array_equal(tight.u[-1], wanted.u[-1])
    half = problem.integrate(rtol=1e-6, method="rk5", t_end=0.2).extend(0.3)
    np.testing.assert_array_equal(half.u[-1], tight.u[-1])


def test_runs_and_members_of_an_ensemble_have_springs_of_their_own():
    problem = oblique(spin=3.0).problem((0.0, 0.05))
    expected = problem.integrate(h=1e-5, save_every=None)
    np.testing.assert_array_equal(problem.integrate(h=1e-5, save_every=None).v, expected.v)
    np.testing.assert_array_equal(problem.integrate(h=1e-5, save_every=None, inline=True).v, expected.v)
    together = problem.ensemble(h=1e-5, v0=np.stack([problem.v0, 0.5 * problem.v0]), save_every=None)
    np.testing.assert_array_equal(together.v[0, -1], expected.v[-1])


def test_grains_that_part_and_meet_again_have_a_new_spring():
    """The second contact does what the first does, whatever was before: a table has the last contacts only."""
    problem = of_two([[0, 0], [0.195, 0.0]], [[0, 0], [0.0, 0.4]], 0.0).problem((0.0, 0.01))
    stepper = problem.stepper(h=1e-5)
    apart = np.array([0.0, 0.3, 0.0, 0.0, 0.0, 0.0])
    stepper.advance(20)
    before = stepper.acceleration(stepper.t, stepper.u, stepper.v)
    assert abs(before[4]) > 1.0
    advance, params = problem.rhs.py_func.history.advance, stepper.params.copy()
    advance(stepper.t + 1e-5, apart, 0 * apart, params)
    a = np.zeros(6)
    problem.rhs(stepper.t + 1e-5, np.array(stepper.u), 0 * apart, params, a)
    np.testing.assert_allclose(a[4:], 0.0, atol=1e-12)


def masses(**options):
    scene = Scene(2)
    return scene, scene.mass(M, [(0, 0), (1, 0), (2, 0), (3, 0)], **options)


def pairs(act):
    scene, grains = masses()
    act(scene, grains[:2], grains[2:])


BAD_VALUES = {
    "E of HertzMindlin must be positive": lambda: hertz_mindlin(E=0.0),
    "nu of HertzMindlin must not be above 0.5": lambda: hertz_mindlin(nu=0.6),
    "restitution of HertzMindlin must be above 0": lambda: hertz_mindlin(restitution=0.0),
    "friction of HertzMindlin must not be negative": lambda: hertz_mindlin(friction=-0.1),
    "wall_radius of HertzMindlin must be positive and at most the contact_distance": lambda: hertz_mindlin(
        wall_radius=1.0
    ),
    "radii of HertzMindlin must not be negative": lambda: hertz_mindlin(contact_distance=None, radii=-R),
    "HertzContact does not know the radius of the others, because its points have several": lambda: pairs(
        lambda scene, a, b: scene.add(effects.HertzContact(1.0, radii=[R, 2 * R]), a, others=b)
    ),
    "inertia of masses must be positive": lambda: masses(inertia=0.0),
    "angular_velocity of masses needs their inertia": lambda: masses(angular_velocity=1.0),
    "nothing spins on a line": lambda: Scene(1).mass(M, 0.0, inertia=1.0),
    "others of HertzMindlin must be fixed points": lambda: pairs(
        lambda scene, a, b: scene.add(hertz_mindlin(), a, others=b)
    ),
}
BAD_TYPES = {
    "HertzMindlin needs the radii of its points, or the contact_distance": lambda: hertz_mindlin(contact_distance=None),
    "contact_distance and radii of HertzContact exclude each other": lambda: effects.HertzContact(1.0, 0.3, radii=R),
    "HertzMindlin takes one array of points": lambda: pairs(lambda scene, a, b: scene.add(hertz_mindlin(), a, b)),
}
test_bad_grains = refusals(BAD_VALUES, BAD_TYPES)


@pytest.mark.parametrize("radii", [R, R * np.array([1.0, 0.5, 2.0])], ids=["one", "each"])
def test_points_touch_at_the_sum_of_their_radii(radii):
    """Pairs and walls push from there on and not before, whether the radii are given or the contact distances."""
    r = np.broadcast_to(radii, 3)
    x = np.array([(0.0, 0.0), (r[0] + r[1], 0.0), (r[0] + 2 * r[1] + r[2], 0.0)])
    for wall in (None, 3 * R):
        w = wall or r.min()
        posts = x[[0, 2]] + np.array([(0.0, 1.0), (0.0, -1.0)]) * (r[[0, 2], None] + w)
        by_radii = replace(hertz_mindlin(contact_distance=None, radii=radii, wall_radius=wall), friction=0.1)
        distances = {"contact_distance": 2 * r}, {"contact_distance": r + w, "wall_radius": w}

        def problem(scale, of_pairs, of_walls, x=x, posts=posts):
            scene = Scene(2)
            grains = scene.mass(M, x * scale, inertia=SPHERE)
            scene.add(of_pairs, grains)
            scene.add(of_walls, grains, others=scene.fixed(posts * scale))
            return scene.problem((0.0, 1.0))

        close, far = (problem(scale, by_radii, by_radii) for scale in (0.999, 1 + 1e-6))
        same = problem(0.999, replace(by_radii, wall_radius=None), by_radii)
        by_distances = problem(0.999, *(hertz_mindlin(**fields, friction=0.1) for fields in distances))
        assert by_distances.rhs is same.rhs is close.rhs
        np.testing.assert_array_equal(by_distances.params, same.params)
        np.testing.assert_array_equal(by_python(far), 0.0)
        pushed = [0, 2, 3, 5] if radii is R else [0, 1, 2, 3, 5]  # equal ones push the middle one to no side
        np.testing.assert_array_equal(np.flatnonzero(np.abs(by_python(close)) > 1.0), pushed)


@eig3.jit
def steadily(t):
    return t, 1.0


def test_a_bed_on_a_floor_that_moves_steadily_is_a_bed_at_rest():
    """The laws are the same in both frames."""
    speed, count, rng = np.array([0.5, -0.25, 0.125]), 50, np.random.default_rng(3)
    along = 0.21 * np.arange(5)
    places = np.stack(np.meshgrid(along, along, [0.195, 0.4], indexing="ij"), axis=-1).reshape(count, 3)
    places += rng.uniform(-0.005, 0.005, places.shape)
    speeds, spins = rng.uniform(-0.3, 0.3, places.shape), rng.uniform(-2.0, 2.0, places.shape)
    runs = []
    for moves in (False, True):
        scene = Scene(3)
        tiles = np.stack(np.meshgrid(*[0.2 * np.arange(6)] * 2, [0.0], indexing="ij"), axis=-1).reshape(-1, 3)
        floor = scene.fixed(tiles)
        bed = scene.mass(M, places, speeds + moves * speed, inertia=SPHERE, angular_velocity=spins)
        scene.add(hertz_mindlin(restitution=0.8), bed)
        scene.add(hertz_mindlin(restitution=0.8), bed, others=floor)
        scene.add(effects.Gravity((0.0, 0.0, -9.81)))
        scene.add(effects.SupportMotion(steadily, moves * speed), floor)
        runs.append(scene.problem((0.0, 0.05), work=True).integrate(h=1e-4))
    rest, moving = runs
    way = np.concatenate([np.repeat(speed, count), np.zeros(3 * count)]) * moving.t[:, None]
    np.testing.assert_allclose(moving.u - way, rest.u, atol=1e-9)  # round-off of 0.02 m, in contacts of 1e7 Pa
    np.testing.assert_allclose(moving.drift["energy"], rest.drift["energy"], rtol=1e-3)
    assert abs(moving.z["work"][-1] - rest.z["work"][-1]) > 0.01  # the floor works on the bed


def test_spin_is_a_degree_of_freedom():
    problem = oblique(spin=2.0).problem((0, 0.01))
    assert problem.names == ("x0", "x1", "y0", "y1", "angle0", "angle1")
    assert problem.unit("u", 4) == "rad"
    assert problem.unit("v", 4) == "rad/s"
    np.testing.assert_array_equal(problem.v0[4:], 2.0)
    free = problem.integrate(h=1e-4, method="rk4", save_every=None, t_end=0.001)
    np.testing.assert_allclose(free.u[-1, 4:], 0.002, rtol=1e-12)


def test_more_contacts_than_there_is_room_for_are_refused():
    """Springs that are left out would change the motion: the run ends with an error that names the remedy."""
    x, scene = np.random.default_rng(0).uniform(0, R, (2, 36)), Scene(2)
    crowded = heap().problem((0, 1e-3)).with_(u0=[*x[0], *x[1], *np.zeros(36)])
    with pytest.raises(ValueError, match="give neighbor_capacity="):
        crowded.integrate(h=1e-4)
    scene.add(hertz_mindlin(E=1e3), scene.mass(M, x.T, inertia=SPHERE), neighbor_capacity=36)
    assert scene.problem((0, 1e-3)).integrate(h=1e-4).success


def test_a_column_spreads_as_far_as_measured():
    """Lube et al. (2004): 1 + 1.6 sqrt(height / radius) times as far, for many grains, to 25 per cent for 1000 spheres.

    It comes to rest, in which a column without friction does not.
    """
    reached = {}
    for friction in (0.5, 1e-12):  # both have the code of a floor with friction
        run = problems.sand_column(1000, friction).integrate(h=1e-4, save_every=500)
        x, y, z = run.u[:, :3000].reshape(-1, 3, 1000).transpose(1, 0, 2)
        r = np.quantile(np.hypot(x, y), 0.99, axis=1)
        reached[friction] = r[-1] / r[0], r[-1] - r[-2]
    slenderness = z[0].max() / r[0]
    assert reached[0.5][0] == pytest.approx(1 + 1.6 * np.sqrt(slenderness), rel=0.25)
    # the last spheres come to rest at times that round-off changes: then the run-out grows by 2e-5 to 2.5e-3 m
    assert reached[0.5][1] < 0.1 * reached[1e-12][1]
    assert reached[1e-12][0] > 1.5 * reached[0.5][0]


def test_a_hopper_empties_at_a_constant_rate():
    """It does not depend on the height of the discs above the opening, as that of a fluid does."""
    counts = {}
    for friction in (0.5, 1e-12):
        run = problems.hopper(800, friction=friction, t_end=0.3).integrate(h=1e-4, save_every=500)
        counts[friction] = np.diff((run.u[:, 800:1600] < 0).sum(axis=1))
    np.testing.assert_allclose(counts[0.5][2:], counts[0.5][2:].mean(), rtol=0.15)  # of some 45 discs
    assert counts[0.5][2:].sum() < 0.8 * counts[1e-12][2:].sum()


@pytest.mark.parametrize("far", [3.3, 10.0])
def test_no_step_jumps_over_an_impact(far):
    """The balls meet at 0.05 m from the middle. They had passed through each other before a step ended."""
    scene = Scene(dimension=2)
    balls = scene.mass([1.0, 1.0], [(-far, 0), (far, 0)], [(1.0, 0), (-1.0, 0)])
    scene.add(effects.MassImpact(contact_distance=0.1, restitution=0.5), *balls)
    problem = scene.problem((0, 2 * far))
    members = problem.ensemble(rtol=1e-9, v0=np.tile(problem.v0, (2, 1)))
    for run in (problem.integrate(rtol=1e-6), members[1]):
        np.testing.assert_allclose(run.events["mass impact 0"].t, [far - 0.05], rtol=1e-12)
        np.testing.assert_allclose(balls.velocities(run.v)[-1], [(-0.5, 0), (0.5, 0)], atol=1e-12)


def test_the_limit_of_a_very_short_contact_distance_is_noted():
    """Two points pass each other at a distance of 1 m: with steps of 1e-4/8 m the run takes at least 32,000 steps."""
    scene = Scene(dimension=2)
    balls = scene.mass([1.0, 1.0], [(0, 0), (0.2, 1)], [(1.0, 0), (0, 0)])
    scene.add(effects.MassImpact(contact_distance=1e-4, restitution=0.5), *balls)
    problem = scene.problem((0, 0.4))
    run, longer = (problem.integrate(rtol=1e-6, save_every=None, h_max=h_max) for h_max in (None, 0.1))
    (note,) = run.notes
    assert "contact distance or cutoff limits the steps, and not rtol" in note
    assert run.n_steps >= 32_000
    members = problem.ensemble(rtol=1e-6, v0=[problem.v0, 0.1 * problem.v0])
    assert members.notes == (f"{note} This is member 0.",)
    assert longer.notes == ()
    assert longer.n_steps < 100
    np.testing.assert_allclose(longer.u[-1], run.u[-1], rtol=1e-12)


@pytest.mark.parametrize("effect", [effects.MassImpact(contact_distance=0.1), effects.HertzContact(1e4, 0.1)])
def test_a_fixed_step_that_may_jump_over_a_contact_has_a_note(effect):
    """Two balls had passed through each other without a word. No contact acts on the third ball, which is fast."""
    scene = Scene(dimension=2)
    balls = scene.mass(1.0, [(-3.3, 0), (3.3, 0), (0, 9)], [(1.0, 0), (-1.0, 0), (0, 100.0)])
    scene.add(effect, *balls[:2])
    problem, note = scene.problem((0, 6.6)), "a point moves by 0.13 in a step, and may pass through another"
    run, members = problem.integrate(h=0.13), problem.ensemble(h=0.13, v0=np.tile(problem.v0, (2, 1)))
    np.testing.assert_array_equal(run.v[-1], problem.v0)
    assert [note in " ".join(each.notes) for each in (run, members)] == [True, True]
    assert not [each for each in problem.integrate(h=0.01).notes if "a point moves" in each]


def test_neither_an_accuracy_nor_a_plan_is_reached_by_steps_that_jump_over_an_impact():
    """Without the impact, 250 to 1500 steps show no error. In the impact, the balls exchange their velocities."""
    scene = Scene(dimension=2)
    balls = scene.mass([1.0, 1.0], [(0, 0), (1.0017, 0)], [(1.0, 0), (0, 0)])
    scene.add(effects.MassImpact(contact_distance=1e-4, restitution=1.0), *balls)
    problem = scene.problem((0, 2))
    run = problem.integrate(accuracy=1e-4, method="eig3", save_every=None)
    np.testing.assert_allclose(run.u[-1], [1.0016, 2.0001, 0, 0], atol=1e-4)
    assert run.success
    assert run.h <= 0.5e-4  # half of the contact distance in a step
    (prediction,) = eig3.plan(problem, 1e-4, methods=["eig3"]).predictions
    assert prediction.h <= 0.5e-4
    assert "limited by stability or by contacts" in prediction.note
    params = np.where(problem.params == 1e-4, 1e-9, problem.params)
    smaller = problem.with_(params=params).integrate(accuracy=1e-4, method="eig3", save_every=None)
    assert "because a point may pass through another in a step of more than 1.3e-10" in smaller.message
    assert smaller.n_steps < 1e6  # and not the 1e10 of such a step


def test_no_step_jumps_over_a_contact():
    """Nothing bends the paths of two spheres before they meet: the error would allow a step beyond the contact. In an
    elastic impact of equal masses, the first stops and the second goes on. An error of 1e-9 m is 3e-5 of the largest
    overlap, 33 micrometres. The springs between grains have errors that rtol does not bound, as a note says."""
    stiffness, tolerance = 1e8, {"atol": 1e-4}
    grains = effects.HertzMindlin(stiffness, 0.3, 0.5, radii=0.005)
    for effect, inertia in ((effects.HertzContact(stiffness, radii=0.005), {}), (grains, {"inertia": 1e-8})):
        scene = Scene(dimension=2)
        balls = scene.mass(1e-3, [(0, 0), (1, 0)], [(1.0, 0), (0, 0)], **inertia)
        scene.add(effect, balls)
        run = scene.problem((0, 2)).integrate(rtol=1e-9)
        np.testing.assert_allclose(balls.velocities(run.v)[-1], [(0, 0), (1, 0)], **tolerance)
        assert np.abs(np.diff(balls.positions(run.u), axis=0)).max() <= 0.01 / 8
        assert [note[:19] for note in run.notes] == ["rtol does not bound"] * bool(inertia)
    assert scene.problem((0, 2)).integrate(rtol=1e-9, h_max=1.0).n_steps < 100
    linked = Scene(dimension=2)
    one, other = linked.mass([1e-3] * 2, [(0, 0), (1, 0)], [(1.0, 0), (0, 0)])
    linked.add(effects.HertzContact(stiffness, contact_distance=0.01), one, other)
    members = linked.problem((0, 2)).ensemble(rtol=1e-9, v0=np.tile([1.0, 0.0, 0.0, 0.0], (20, 1)))
    np.testing.assert_allclose(members.v[:, -1], np.tile([0.0, 1.0, 0.0, 0.0], (20, 1)), **tolerance)
