"""Periodic boxes, also those that shear: links act between the nearest images, and lists of neighbours miss nothing."""

import inspect
import itertools

import numpy as np
import pytest

from eig3 import effects
from eig3.kernels import neighbours
from eig3.scene import Scene

from .test_neighbours import by_python, energy_by_python

BOX, SHEAR = np.array([3.1, 2.3, 2.0]), 1.7
STIFFNESS, REACH, DAMPING = 50.0, 0.6, 0.1


def flowing(dimension, n=40, seed=1):
    """Points anywhere in space, which move with the flow and by themselves."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(-7, 9, (n, dimension))
    v = rng.normal(size=(n, dimension))
    v[:, 0] += SHEAR * x[:, 1]
    return x, v


def sheared(x, v, of_all_pairs=False, **contact):
    dimension = x.shape[1]
    scene = Scene(dimension, box=BOX[:dimension], shear=SHEAR)
    points = scene.mass(1.0, x, v)
    contact = effects.HertzContact(**{"stiffness": STIFFNESS, "contact_distance": REACH, "damping": DAMPING, **contact})
    if of_all_pairs:
        i, j = np.triu_indices(len(x), 1)
        scene.add(contact, points[i], points[j])
    else:
        scene.add(contact, points)
    return scene, points


def acceleration(problem, t, u, v, params):
    a = np.full(u.size, np.nan)
    problem.rhs(t, u, v, params, a)
    return a


def over_images(t, x, v):
    """The accelerations from a sum over images."""
    a = np.zeros_like(x)
    dimension = x.shape[1]
    lattice = np.diag(BOX[:dimension])
    lattice[1, 0] = SHEAR * BOX[1] * t
    way, rate = x[None] - x[:, None], v[None] - v[:, None]
    turns = np.rint(way[:, :, 1] / BOX[1])
    way -= turns[..., None] * lattice[1]
    rate[:, :, 0] -= turns * SHEAR * BOX[1]
    for axis in {0, dimension - 1} - {1}:
        way[:, :, axis] -= BOX[axis] * np.rint(way[:, :, axis] / BOX[axis])
    for steps in itertools.product((-2, -1, 0, 1, 2), (-1, 0, 1), *[(-1, 0, 1)] * (dimension - 2)):
        d = way + np.array(steps) @ lattice
        e = rate.copy()
        e[:, :, 0] += steps[1] * SHEAR * BOX[1]
        r = np.sqrt((d**2).sum(axis=2))
        r[r == 0] = np.inf
        speed = (d * e).sum(axis=2) / r
        push = STIFFNESS * np.maximum(REACH - r, 0) ** 1.5 * np.maximum(1 - DAMPING * speed, 0)
        a -= ((push / r)[..., None] * d).sum(axis=1)
    return a


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("of_all_pairs", [False, True], ids=["near pairs", "all pairs"])
def test_forces_are_those_between_images(dimension, of_all_pairs):
    x, v = flowing(dimension)
    problem = sheared(x, v, of_all_pairs)[0].problem((0, 1))
    params = problem.params.copy()
    for t in (0.0, 0.37, -20.0):
        expected = over_images(t, x, v)
        assert np.abs(expected).max() > 10
        found = by_python(problem, params=params, t=t)
        np.testing.assert_allclose(found, expected.T.ravel(), rtol=0, atol=1e-10 * np.abs(expected).max())


def test_a_list_follows_the_flow():
    """The forces have the bits of a new list, for points that move with the flow, against it or not at all."""
    x, v = flowing(2, 60)
    problem = sheared(x, v)[0].problem((0, 1))
    kept = problem.params.copy()
    place = np.flatnonzero(kept == 60)[0]
    rng = np.random.default_rng(3)
    for flow in (1.0, -1.0, 0.0):
        u, t = problem.u0.copy(), 0.0
        for _ in range(60):
            dt = rng.uniform(0, 0.02)
            u[:60] += flow * SHEAR * dt * u[60:]
            u += rng.uniform(-0.003, 0.003, u.size)
            t += dt
            found = acceleration(problem, t, u, problem.v0, kept)
            fresh = kept.copy()
            fresh[place + neighbours.LISTED] = 0
            np.testing.assert_array_equal(found, acceleration(problem, t, u, problem.v0, fresh))


def test_a_lattice_in_the_flow_stays_in_it():
    """The forces on each point cancel at each time, whatever the strain."""
    n = 4
    x = np.stack(np.divmod(np.arange(n * n), n), axis=1) * BOX[:2] / n
    v = np.column_stack([SHEAR * x[:, 1], 0 * x[:, 1]])
    scene, points = sheared(x, v, contact_distance=1.0)
    run = scene.problem((0.0, 2.0)).integrate(h=1e-3, save_every=500)
    for t, u in zip(run.t, points.positions(run.u), strict=True):
        np.testing.assert_allclose(u, x + t * v, rtol=0, atol=1e-9)


def test_momentum_is_kept_and_the_work_is_that_of_the_images():
    """The images pull through springs and contacts, with a potential and without; the error falls with the step."""
    x, v = flowing(2, 24, seed=5)
    scene, points = sheared(x, v, damping=0.0)
    scene.add(effects.LinearSpring(5.0, 0.3), points[:6], points[6:12])
    scene.add(effects.LinearDamper(0.5), points[:6], points[12:18])
    scene.add(effects.HertzContact(STIFFNESS, 0.5, damping=0.2), points[:12], others=points[12:])
    problem = scene.problem((0.0, 0.5), work=True)
    runs = [problem.integrate(h=h, method="rk4", save_every=None) for h in (2e-3, 5e-4)]
    assert abs(runs[1].z["work"][-1]) > 1
    assert runs[1].drift["energy"] < 1e-4
    assert runs[1].drift["energy"] < 0.1 * runs[0].drift["energy"]
    momentum = points.velocities(runs[0].v).sum(axis=1)
    np.testing.assert_allclose(momentum[-1], momentum[0], rtol=0, atol=1e-10)


@pytest.mark.parametrize("length", [0.2, 0.5])
def test_a_link_on_a_line_acts_across_the_border(length):
    """The masses at 0.1 m and 9.9 m of a box of 10 m are 0.2 m apart."""
    scene = Scene(1, box=(10.0,))
    scene.add(effects.LinearSpring(100.0, rest_length=length), scene.mass(1.0, 0.1), scene.mass(2.0, 9.9))
    problem = scene.problem((0, 1))
    pull = 100 * (0.2 - length)
    np.testing.assert_allclose(
        by_python(problem), [-pull, pull / 2], rtol=0, atol=1e-11
    )  # round-off of 10 m times 100 N/m
    assert energy_by_python(problem) == pytest.approx(50 * (0.2 - length) ** 2, abs=1e-12)


def test_links_are_checked_between_the_nearest_images():
    """The ends are 0.4 m apart in a box of 10 m, 9.6 m without it, and the last ones coincide."""
    scene = Scene(2, box=(10.0, None))
    one, other, image = scene.mass(1.0, (0.2, 0.5)), scene.mass(1.0, (9.8, 0.5)), scene.mass(1.0, (-9.8, 0.5))
    scene.add(effects.Breaking(effects.LinearSpring(10.0, 0.3), max_stretch=0.2), one, other)
    with pytest.raises(ValueError, match="Breaking is broken at the start"):
        scene.add(effects.Breaking(effects.LinearSpring(10.0, 0.8), min_stretch=-0.1), one, other)
    with pytest.raises(ValueError, match="has no direction where its ends coincide"):
        scene.add(effects.LinearSpring(10.0, 0.8), one, image)


def test_a_row_on_a_line_oscillates_as_a_ring():
    """A wave along n masses has the frequency 2 sqrt(k/m) sin(pi q / n), also across the border."""
    n, q, stiffness = 12, 2, 40.0
    scene = Scene(1, box=(float(n),))
    wave = 1e-3 * np.cos(2 * np.pi * q * np.arange(n) / n)
    ring = scene.mass(1.0, np.arange(n) + wave)
    scene.add(effects.LinearSpring(stiffness, rest_length=1.0), ring, ring[(np.arange(n) + 1) % n])
    period = np.pi / (np.sqrt(stiffness) * np.sin(np.pi * q / n))
    run = scene.problem((0.0, period)).integrate(rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(run.u[-1], run.u[0], rtol=0, atol=1e-9)
    assert np.abs(run.u - run.u[0]).max() > 1e-3


def test_a_box_without_shear_has_no_code_for_it():
    scene = Scene(2, box=(3.0, 3.0))
    scene.add(effects.HertzContact(STIFFNESS, REACH), scene.mass(1.0, flowing(2)[0]))
    source = inspect.getsource(scene.problem((0, 1)).rhs.py_func)
    assert not any(word in source for word in ("turns", "image"))


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (lambda: Scene(1, box=(1.0,), shear=1.0), "shear needs a box with sides along x and y"),
        (lambda: Scene(3, box=(1.0, None, 1.0), shear=1.0), "shear needs a box with sides along x and y"),
        (lambda: Scene(2, box=(1.0, 1.0), shear=np.nan), "shear must be finite"),
        (lambda: _near_fixed(Scene(2, box=(3.0, 3.0), shear=1.0)), "which do not move with a box that shears"),
        (lambda: _across_the_border(effects.Rod(), 2), "Rod 2 has points more than half a side of the box apart"),
        (lambda: _across_the_border(effects.HarmonicAngle(1.0, 3.0), 3), "HarmonicAngle 1 has points more than half"),
    ],
)
def test_errors(act, message):
    with pytest.raises(ValueError, match=message):
        act()


def _near_fixed(scene):
    scene.add(effects.HertzContact(STIFFNESS, REACH), scene.mass(1.0, [(0.0, 0.0)]), others=scene.fixed([(1.0, 0.0)]))


def _across_the_border(effect, count):
    """Four atoms in a row, of which the last is wrapped into the box; along y, the box is not periodic."""
    scene = Scene(2, box=(4.0, None))
    atoms = scene.mass(1.0, [(1.4, 9.0), (2.5, 0.0), (3.6, 9.0), (0.7, 0.0)])
    scene.add(effect, *(atoms[k : k + 5 - count] for k in range(count)))
