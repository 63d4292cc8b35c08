"""Scenes: the compiled problem contains exactly the effects of the scene, and bad scenes are refused."""

import inspect
import math
import pickle
from dataclasses import dataclass
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import eig3
from eig3 import problems
from eig3.bench.article import TABLES
from eig3.effects import (
    Body,
    CoulombFriction,
    Gravity,
    HardeningSpring,
    HarmonicForce,
    HertzContact,
    LinearDamper,
    LinearSpring,
    Link,
    Motion,
    PlaneContact,
    QuadraticDrag,
    RotatingFrame,
    SampledMotion,
    SofteningSpring,
    StVenantKirchhoffMembrane,
    SupportMotion,
)
from eig3.scene import Scene, codegen

from .conftest import acceleration, refusals, shaken


def code(problem):
    return inspect.getsource(inspect.unwrap(problem.rhs.py_func))


def at_start(problem, t=0.0):
    """The acceleration as Python computes it from the code, which takes no time to compile."""
    return acceleration(problem, problem.u0, problem.v0, t, problem.rhs.py_func)


# The compiled right-hand side against a sum computed pair by pair


class Sum:
    """Adds up the forces of a scene's effects for one pair of points at a time, in the order given."""

    def __init__(self, dimension, masses, positions, velocities):
        self.dimension, self.masses = dimension, masses
        self.x, self.v, self.start = positions, velocities, positions.copy()
        self.force = np.zeros_like(positions)

    def link(self, i, j, tension):
        d, e = self.x[j] - self.x[i], self.v[j] - self.v[i]
        if self.dimension == 1:
            along = np.ones(1) if self.start[j] >= self.start[i] else -np.ones(1)
        else:
            along = d / np.linalg.norm(d)
        pull = tension(d @ along, e @ along)
        self.force[i] += pull * along
        self.force[j] -= pull * along


def topology(dimension, n, seed, part_fixed, strides, scattered, is_shuffled):
    """Points, some of them fixed, and pairs of them: neighbours, pairs at equal index distances, and random pairs."""
    rng = np.random.default_rng(seed)
    is_fixed = rng.random(n) < part_fixed
    is_fixed[rng.integers(n)] = False
    pairs = [(i, i + stride) for stride in strides for i in range(n - stride)]
    pairs = np.array([*pairs, *rng.integers(0, n, (scattered, 2)).tolist()], dtype=np.int64).reshape(-1, 2)
    flip = rng.random(len(pairs)) < 0.3
    pairs[flip] = pairs[flip, ::-1]
    pairs = pairs[(pairs[:, 0] != pairs[:, 1]) & ~(is_fixed[pairs[:, 0]] & is_fixed[pairs[:, 1]])]
    if is_shuffled:
        rng.shuffle(pairs)
    return dimension, is_fixed, pairs, rng


def test_a_scene_is_the_sum_of_its_effects():
    many = topology(3, 40, 1, 0.2, [1, 5], 30, is_shuffled=True)
    check_sum(lambda problem: problem.rhs, *many, same_masses=False, same_springs=False)


@settings(max_examples=60, deadline=None)
@given(
    st.builds(
        topology,
        st.integers(1, 3),
        st.sampled_from([2, 3, 7, 40]),
        st.integers(0, 2**32 - 1),
        st.sampled_from([0.0, 0.2]),
        st.lists(st.sampled_from([1, 2, 5]), unique=True),
        st.sampled_from([0, 3, 30]),
        st.booleans(),
    ),
    st.booleans(),
    st.booleans(),
)
def test_the_code_of_a_scene_is_the_sum_of_its_effects(topology, same_masses, same_springs):
    """As Python runs it, which takes no time to compile: more scenes than above."""
    check_sum(lambda problem: problem.rhs.py_func, *topology, same_masses, same_springs)


def check_sum(rhs_of, dimension, is_fixed, pairs, rng, same_masses, same_springs):
    """Compare a right-hand side with the forces of each pair of points, added one by one."""
    n = is_fixed.size
    masses = np.ones(n) * 1.7 if same_masses else rng.uniform(0.5, 2, n)
    x, v = rng.standard_normal((2, n, dimension))
    v[is_fixed] = 0
    scene, points = Scene(dimension), []
    for k in range(n):
        place, speed = (x[k, 0], v[k, 0]) if dimension == 1 else (x[k], v[k])
        points.append(scene.fixed(place) if is_fixed[k] else scene.mass(masses[k], place, speed))
    total = Sum(dimension, masses, x, v)
    motion = SampledMotion([0.0, 1.0], [0.3, 0.8], np.eye(dimension)[0])
    if is_fixed.any():
        moved = np.flatnonzero(is_fixed)[0]
        scene.add(motion, points[moved])
        total.x[moved, 0] += 0.3 + 0.5 * 0.25
        total.v[moved, 0] += 0.5
    k, c = rng.uniform(1, 2, (2, len(pairs)))
    if same_springs:
        k[:] = 1.5
    for s, (i, j) in enumerate(pairs):
        scene.add(LinearSpring(k[s], 0.4), points[i], points[j])
        total.link(i, j, lambda r, rate, s=s: k[s] * (r - 0.4))
        if s % 3:
            scene.add(LinearDamper(c[s]), points[j], points[i])
            total.link(i, j, lambda r, rate, s=s: c[s] * rate)
    scene.add(QuadraticDrag(0.2))
    total.force -= 0.2 * np.linalg.norm(v, axis=1, keepdims=True) * v
    pushed = np.flatnonzero(~is_fixed)[::2]
    for i in pushed:
        scene.add(HarmonicForce(np.ones(dimension), 2.0), points[i])
        total.force[i] += math.cos(2.0 * 0.25)
    field = np.arange(1.0, dimension + 1)
    scene.add(Gravity(field))
    problem = scene.problem((0.0, 1.0))
    found = np.full(problem.u0.size, np.nan)
    rhs_of(problem)(0.25, problem.u0, problem.v0, problem.params, found)
    expected = (total.force / masses[:, None] + field)[~is_fixed].T.ravel()
    # sums of up to some 80 terms of size 10, in another order
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-11)


# Known motions


def cartesian_pendulum(t_end=5.0):
    scene = Scene(2)
    pivot, bob = scene.fixed((0.0, 0.0)), scene.mass(1.0, (0.75, 0.0))
    scene.add(LinearSpring(98.1, 0.5), pivot, bob)
    scene.add(Gravity((0.0, -9.81)))
    return scene.problem((0.0, t_end)), bob


@pytest.mark.parametrize(("method", "order"), [("eig3", 2), ("rk4", 4)])
def test_the_pendulum_is_the_polar_one(method, order):
    """Both converge to one motion: their difference falls with the order, as does the drift of the energy."""
    apart, drifts = [], []
    for h in (2e-3, 1e-3):
        problem, bob = cartesian_pendulum()
        ours = problem.integrate(h=h, method=method)
        polar = problems.spring_pendulum(t_end=5.0).integrate(h=h, method=method)
        r, theta = polar.u.T
        apart.append(np.abs(bob.positions(ours.u) - np.column_stack([r * np.sin(theta), -r * np.cos(theta)])).max())
        drifts.append(ours.drift["energy"])
    assert apart[0] / apart[1] == pytest.approx(2**order, rel=0.2)
    assert apart[1] < (1e-2 if order == 2 else 1e-6)
    # RK4's drift is of order five: the leading term of its error oscillates
    assert drifts[0] / drifts[1] > 0.8 * 2**order


ARTICLE = (TABLES[1], HardeningSpring(100.0, 10.0)), (TABLES[2], SofteningSpring(100.0))


@pytest.mark.parametrize(("table", "effect"), ARTICLE, ids=["table2", "table3"])
def test_springs_give_tables_2_and_3_of_the_article(table, effect):
    """With a mass of 1 kg, as the problem written by hand. The recomputed values have three digits."""
    by_hand = table.problem()
    scene = Scene(1)
    wall, mass = scene.fixed(0.0), scene.mass(1.0, by_hand.u0)
    scene.add(effect, wall, mass)
    problem = scene.problem(by_hand.t_span)
    for h, entry in zip(table.steps[:3], table.entries["eig3"], strict=False):
        options = {"h": h, "save_every": 100, "invariants_every": 1}
        ours, theirs = (x.integrate(**options) for x in (problem, by_hand))
        assert ours.drift["energy"] == pytest.approx(entry.recomputed, rel=0.02)
        assert ours.n_rhs == theirs.n_rhs
        np.testing.assert_allclose(mass.positions(ours.u), theirs.u, rtol=0, atol=1e-6)  # round-off


def free_net():
    rng = np.random.default_rng(5)
    scene = Scene(3)
    net = scene.mass(rng.uniform(0.5, 2, (6, 5)), rng.standard_normal((6, 5, 3)), rng.standard_normal((6, 5, 3)))
    for a, b in ((net[:-1], net[1:]), (net[:, :-1], net[:, 1:])):
        scene.add(HardeningSpring(3.0, 0.1, 0.5), a, b)
    scene.add(HertzContact(50.0, 0.8), net[0, 0], net[5, 4])
    return scene, net


def momenta(net, masses, solution):
    x, v = net.positions(solution.u), net.velocities(solution.v)
    p = masses[..., None] * v
    return p.sum(axis=(1, 2)), np.cross(x, p).sum(axis=(1, 2))


@pytest.mark.parametrize("method", ["eig3", "cd", "rk4"])
def test_a_free_net_keeps_its_momentum(method):
    """Every method keeps the momentum, which is linear, to the round-off of 5000 steps.

    Central difference, whose v is (u_{n+1} - u_{n-1}) / 2h, also keeps the angular momentum, except in its first step,
    and EIG-3 keeps it to its second order.
    """
    scene, net = free_net()
    masses, drifts = scene._cloud().masses.reshape(6, 5), []
    for h in (1e-3, 5e-4):
        p, angular = momenta(net, masses, scene.problem((0.0, 5.0)).integrate(h=h, method=method))
        assert np.abs(p - p[0]).max() < 1e-11
        drifts.append(np.abs(angular - angular[0]).max())
    assert method != "cd" or max(drifts) < 1e-10
    assert method != "eig3" or drifts[0] / drifts[1] > 3.5


@pytest.mark.parametrize(("method", "order"), [("eig3", 2), ("cd", 2), ("rk4", 4)])
def test_the_balance_of_a_damped_and_driven_scene(method, order):
    scene = Scene(2)
    post = scene.fixed((0.0, 0.0))
    masses = scene.mass([1.0, 2.0], [(1.0, 0.0), (2.0, 0.1)], [(0.0, 1.0), (0.5, 0.0)])
    scene.add(LinearSpring(60.0, 0.9), post, masses[0])
    scene.add(HardeningSpring(60.0, 0.5, 0.9), *masses)
    scene.add(LinearDamper(0.8), post, masses[0])
    scene.add(SupportMotion(shaken, (0.6, 0.8)), post)
    scene.add(HarmonicForce((1.0, 2.0), 4.0), masses[1])
    scene.add(QuadraticDrag(0.1))
    scene.add(Gravity((0.0, -9.81)))
    assert scene.problem((0.0, 3.0)).energy is None
    problem = scene.problem((0.0, 3.0), work=True)
    runs = [problem.integrate(h=h, method=method, invariants_every=1) for h in (4e-3, 2e-3)]
    drifts = [run.drift["energy"] for run in runs]
    assert drifts[0] / drifts[1] > 0.8 * 2**order
    energy, work = (problem.energy_of(runs[1].u, runs[1].v, runs[1].t), runs[1].z["work"])
    assert np.ptp(energy - work) == pytest.approx(drifts[1], rel=1.0)  # of saved states, from their own mean
    assert abs(work[-1]) > 1
    without = scene.problem((0.0, 3.0)).integrate(h=2e-3, method=method)
    # central difference solves for v with one more unknown, the work's: to 1e-12 of v in each of 1500 steps
    tolerance = 1e-10 if method == "cd" else 0.0
    np.testing.assert_allclose(runs[1].u, without.u, rtol=0, atol=tolerance)
    np.testing.assert_allclose(runs[1].v, without.v, rtol=0, atol=tolerance)
    assert without.z == {}


def damped_mass(work=True):
    scene = Scene(1)
    mass = scene.mass(2.0, 0.0, 3.0)
    scene.add(QuadraticDrag(0.5), mass)
    return scene.problem((0.0, 1.0), work=work), mass


def test_the_work_is_apart_from_the_degrees_of_freedom():
    problem, mass = damped_mass()
    assert problem.z0 == {"work": 0.0}
    assert np.size(problem.u0) == 1
    solution = problem.integrate(h=1e-3, method="rk4", save_every=100)
    assert solution.u.shape == solution.v.shape == (11, 1)
    assert solution.z["work"].shape == (11,)
    speed = 3.0 / (1 + 0.25 * 3.0 * solution.t)  # exact: v' = -(drag / m) v^2
    np.testing.assert_allclose(mass.velocities(solution.v), speed, rtol=1e-12)
    np.testing.assert_allclose(solution.z["work"], speed**2 - 9, rtol=1e-10)
    np.testing.assert_allclose(problem.energy_of(solution.u, solution.v), speed**2, rtol=1e-12)
    pickled = pickle.loads(pickle.dumps(solution))
    np.testing.assert_array_equal(pickled.z["work"], solution.z["work"])


def test_a_problem_with_work_runs_without_it_too():
    """`eig3.integrate` and the stepper get the problem's u0, and do not follow the work."""
    problem, _ = damped_mass()
    solution = eig3.integrate(problem.rhs, (0.0, 1.0), problem.u0, problem.v0, h=1e-2, params=problem.params)
    stepper = problem.stepper(h=1e-2)
    stepper.advance(100)
    np.testing.assert_array_equal(solution.u[-1], stepper.u)
    np.testing.assert_allclose(solution.u, problem.integrate(h=1e-2).u, rtol=1e-14)


def test_a_failed_run_keeps_the_work_apart_too():
    """The solution of an error has the masses' degrees of freedom only."""
    scene = Scene(1)
    scene.mass(1.0, 1.0)
    scene.add(HarmonicForce(1.0, 2.0))
    scene.add(HardeningSpring(1.0, 1e3), scene.fixed(0.0), scene.mass(1.0, 1.0))
    problem = scene.problem((0.0, 100.0), work=True)
    with pytest.raises(eig3.IntegrationError) as caught:
        problem.integrate(h=0.5, raise_on_failure=True)
    assert caught.value.solution.u.shape[1] == 2
    assert caught.value.solution.z["work"].size == len(caught.value.solution.t)


# Many links


def all_pairs(effect, n):
    """Masses near the points of a square lattice of distance 1, with an effect between every two."""
    side = math.isqrt(n - 1) + 1
    places = np.stack(np.divmod(np.arange(n), side), -1) + 0.05 * np.random.default_rng(n).standard_normal((n, 2))
    scene = Scene(2)
    discs = scene.mass(np.linspace(1.0, 2.0, n), places)
    i, j = np.triu_indices(n, 1)
    scene.add(effect, discs[i], discs[j])
    return scene, discs


@pytest.mark.parametrize("n", [20, 100])
def test_all_pairs_of_discs_have_code_of_bounded_length(n):
    """Two forms of loop in each function, whatever n, and the forces of a sum over all pairs by NumPy."""
    scene, discs = all_pairs(HertzContact(1e3, 1.0), n)
    problem = scene.problem((0.0, 1.0))
    for function in (problem.rhs, problem.energy):
        text = inspect.getsource(inspect.unwrap(function.py_func))
        assert text.count("for ") <= 4 * 2 + 2
        assert len(text.splitlines()) < 110
    x = discs.positions(problem.u0)
    d = x[None] - x[:, None]
    r = np.sqrt((d**2).sum(axis=-1)) + np.eye(n)
    push = 1e3 * np.maximum(0, 1 - r) ** 1.5
    force = (-(push / r)[..., None] * d).sum(axis=1)
    energy = 0.4 * 1e3 * (np.maximum(0, 1 - r) ** 2.5).sum() / 2
    found = discs.velocities(at_start(problem)) * np.linspace(1.0, 2.0, n)[:, None]
    # sums of a few terms of size 10
    np.testing.assert_allclose(found, force, rtol=0, atol=1e-12)
    assert problem.energy.py_func(0.0, problem.u0, problem.v0, problem.params) == pytest.approx(energy, rel=1e-12)


def test_links_with_many_index_distances_share_a_loop():
    """Compile time follows the number of loops: as many for 1000 pairs of masses as for 100000."""
    texts = [code(all_pairs(LinearSpring(1.0, 0.5), n)[0].problem((0.0, 1.0))) for n in (45, 450)]
    assert [text.count("for ") for text in texts] == [3, 3]  # neighbours, runs of pairs, and the pairs of a run
    assert [len(text.splitlines()) for text in texts] == [len(texts[0].splitlines())] * 2


def grid_links(shape, directions):
    """Springs along some directions of a grid of masses."""
    scene = Scene(3)
    axes = [np.arange(float(size)) for size in (*shape, 1, 1)[:3]]
    net = scene.mass(1.0, np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(*shape, 3))
    for direction in directions:
        a = tuple(slice(max(0, -d), min(size, size - d)) for d, size in zip(direction, shape, strict=True))
        b = tuple(slice(max(0, d), min(size, size + d)) for d, size in zip(direction, shape, strict=True))
        scene.add(LinearSpring(2.0, 1.0), net[a], net[b])
    return code(scene.problem((0.0, 1.0)))


def test_a_cloth_has_a_loop_for_each_direction():
    """With diagonals and second neighbours: in each loop but the neighbours' the compiler knows the difference."""
    text = grid_links((20, 20), [(0, 1), (1, 0), (1, 1), (1, -1), (0, 2), (2, 0)])
    assert "j = j0" not in text
    assert text.count("r = sqrt(") == 6


def test_a_lattice_with_all_diagonals_has_two_loops():
    """Its 13 directions would take seconds to compile in loops of their own."""
    text = grid_links((7, 7, 7), [tuple(d) for d in np.array(list(np.ndindex(3, 3, 3))[14:]) - 1])
    assert text.count("r = sqrt(") == 2


def test_a_far_pair_is_skipped_before_its_square_root():
    """In every loop over links but the row of neighbours in rhs, a form without a branch."""

    def roots(function):
        """The statement around each square root of a length."""
        lines = inspect.getsource(inspect.unwrap(function.py_func)).splitlines()
        depths = [len(line) - len(line.lstrip()) for line in lines]
        for k, line in enumerate(lines):
            if "r = sqrt(" in line:
                yield (
                    next(lines[m] for m in range(k, 0, -1) if depths[m] < depths[k]).split(" hertz_contact")[0].strip()
                )

    near = "if square <"
    elastic = all_pairs(HertzContact(1e3, 1.0), 30)[0].problem((0.0, 1.0))
    assert list(roots(elastic.rhs)) == ["for s in range(29):", near]
    assert list(roots(elastic.energy)) == [near, near]
    damped = all_pairs(HertzContact(1e3, 1.0, damping=0.1), 30)[0].problem((0.0, 1.0), work=True)
    assert list(roots(damped.rhs)) == ["for s in range(29):", near]
    assert list(roots(damped.rhs.py_func.__globals__["power"])) == [near, near]


def shaken_posts(n):
    """Posts that move by records of their own, the second also by another, and masses on springs above them."""
    rng = np.random.default_rng(7)
    values, directions = rng.standard_normal((n, 4)), rng.standard_normal((n, 2))
    places = np.column_stack([np.arange(n), np.zeros(n)])
    scene = Scene(2)
    posts, masses = scene.fixed(places), scene.mass(2.0, places + np.array([0.0, 1.0]))
    scene.add(LinearSpring(np.arange(1.0, n + 1)), posts, masses)
    scene.add(LinearDamper(0.0), posts, masses)
    for k in range(n):
        scene.add(SampledMotion(np.linspace(0, k + 1, 4), values[k], directions[k]), posts[k])
    scene.add(SampledMotion([0.0, 2.0], [0.0, 3.0], (1.0, -1.0)), posts[1])
    shift = [np.interp(0.7, np.linspace(0, k + 1, 4), values[k]) * directions[k] for k in range(n)]
    shift[1] = shift[1] + 0.35 * 3.0 * np.array([1.0, -1.0])
    force = np.arange(1.0, n + 1)[:, None] * (np.array(shift) - [0.0, 1.0])
    return scene.problem((0.0, 1.0), work=True), masses, force / 2.0


def test_the_work_of_a_sampled_motion_has_the_order_1():
    """RK4 weights the power at the end of a step by h / 6, where the support has already stopped: this part is lost."""
    k, slope, rest = 40.0, 0.5, 1.0
    scene = Scene(dimension=1)
    post = scene.fixed(0.0)
    scene.add(LinearSpring(k, rest), post, scene.mass(1.0, rest))
    scene.add(SampledMotion([0.0, 1.0], [0.0, slope], (1.0,)), post)
    problem = scene.problem((0, 2), work=True)
    omega = math.sqrt(k)
    force = k * slope / omega * math.sin(omega)  # of the spring at t = 1; its stretch is slope / omega * sin(omega t)
    for h in (1 / 64, 1 / 256):
        drift = problem.integrate(h=h, method="rk4").drift["energy"]
        assert drift == pytest.approx(h / 6 * abs(force * slope), rel=(omega * h) ** 2)  # RK4 has only higher terms


@pytest.mark.parametrize("n", [1, 12])  # motions with lines of their own, or in the loop over the springs
def test_no_step_jumps_over_a_bump_of_a_support(n):
    """A short bump of the area A at the time t leaves the motion A sin(20 - t) of a unit spring and mass."""
    scene, places = Scene(1), np.arange(n)
    posts, masses = scene.fixed(places), scene.mass(1.0, places + 1.0)
    scene.add(LinearSpring(1.0, 1.0), posts, masses)
    for k in range(n):
        times = [0.0, 5.0, 5.0025, 5.005, 20.0] if k == n - 1 else np.linspace(0.0, 20.0 + k, 5)
        scene.add(SampledMotion(times, [0.0, 0.0, 1e3, 0.0, 0.0]), posts[k])
    problem = scene.problem((0.0, 20.0))
    expected = n + 2.5 * math.sin(20 - 5.0025)
    assert problem.integrate(rtol=1e-6).u[-1, -1] == pytest.approx(expected, rel=0, abs=1e-4)
    members = problem.ensemble(u0=np.array([problem.u0] * 2), rtol=1e-6)
    np.testing.assert_allclose(members.u[:, -1, -1], expected, rtol=0, atol=1e-4)
    note = "h = 0.1 skips much of a record of loads"
    for found in (problem.integrate(h=0.1), problem.ensemble(u0=np.array([problem.u0] * 2), h=0.1)):
        assert note in " ".join(found.notes)


def test_supports_with_records_of_their_own_share_code():
    """Few motions have lines of their own and many are computed in the loop over the springs: both move the posts."""
    for n in (2, 30):
        problem, masses, expected = shaken_posts(n)
        found = masses.velocities(at_start(problem, 0.7))
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
        assert f"{n + 1} x SampledMotion" in problem.note
    more, _, _ = shaken_posts(300)
    assert len(code(more).splitlines()) == len(code(problem).splitlines())
    # to 0.1 %: the error of a step over a jump of a velocity is of first order
    solution = problem.integrate(h=1e-3, method="rk4")
    assert solution.drift["energy"] < 1e-3 * np.ptp(solution.z["work"])


@dataclass(frozen=True, eq=False)
class Wall(Link):
    """A constant push up to a distance, which a cutoff at a wrong distance would change."""

    push: object
    range: object

    cutoff_field = "range"
    nonnegative = ("push",)

    tension = eig3.jit(lambda push: -push)


def test_a_cutoff_is_a_field_of_ones_own_and_each_pair_may_have_another():
    scene = Scene(2)
    post, masses = scene.fixed((0.0, 0.0)), scene.mass(1.0, [(1.0, 0.0), (2.0, 0.0), (3.0, 0.0)])
    scene.add(Wall([5.0, 6.0, 7.0], [1.5, 1.5, 3.5]), post, masses)
    problem = scene.problem((0.0, 1.0))
    assert masses.velocities(at_start(problem))[:, 0] == pytest.approx([5.0, 0.0, 7.0])


def test_a_link_with_a_cutoff_and_one_without_between_the_same_points():
    """A contact and a spring share the loop, and the spring acts beyond the contact's reach."""
    scene = Scene(2)
    a, b = scene.mass(1.0, [(0.0, 0.0), (3.0, 0.0)])
    scene.add(HertzContact(10.0, 1.0), a, b)
    scene.add(LinearSpring(2.0, 1.0), a, b)
    problem = scene.problem((0.0, 1.0))
    assert a.velocities(at_start(problem)).tolist() == [4.0, 0.0]


# No code for effects that a scene does not have


def test_the_code_of_a_scene_names_its_effects_only():
    problem, _ = cartesian_pendulum()
    text = code(problem)
    assert "gravity" in text
    assert "linear_spring" in text
    assert not [name for name in ("damper", "drag", "contact", "friction", "velocity", "power") if name in text]
    assert len(problem.params) == 1 + 2 + 2 + 2  # inverse mass, field, spring, pivot
    assert not problem.uses_velocity
    assert "central difference takes one evaluation" in problem.note
    assert problem.integrate(h=1e-3, method="cd").n_rhs == 5001


def test_zero_strength_is_not_absence():
    scene = Scene(2)
    scene.mass(1.0, (1.0, 2.0), (1.0, 0.0))
    scene.add(Gravity((0.0, 0.0)))
    problem = scene.problem((0.0, 1.0))
    assert "gravity" in code(problem)
    assert problem.integrate(h=0.5).u[-1] == pytest.approx((2.0, 2.0))


def test_another_effect_in_the_library_changes_no_instruction():
    def instructions():
        codegen._functions.cache_clear()
        problem, _ = cartesian_pendulum()
        rhs = eig3.jit(problem.rhs.py_func, cache=False)  # code from the disk has no text
        rhs(0.0, problem.u0, problem.v0, problem.params, np.empty(problem.u0.size))
        assembly = next(iter(rhs.for_python.inspect_asm().values()))
        return [line for line in assembly.splitlines() if "_ZN" not in line]  # names contain a counter

    before = instructions()

    @dataclass(frozen=True, eq=False)
    class Wind(Body):
        speed: float

        force = eig3.jit(lambda v, speed: (speed - v[0], -v[1]))

    scene = Scene(2)
    scene.mass(1.0, (0.0, 0.0))
    scene.add(Wind(3.0))
    problem = scene.problem((0.0, 1.0))
    assert at_start(problem).tolist() == [3.0, 0.0]
    assert instructions() == before
    assert len(before) > 20


def test_scenes_of_one_structure_share_their_code():
    def pair(k):
        scene = Scene(1)
        scene.add(LinearSpring(k, 1.0), *scene.mass([1.0, 2.0], [0.0, 1.5]))
        return scene.problem((0.0, 1.0))

    one, other = pair(3.0), pair(4.0)
    assert one.rhs is other.rhs
    assert at_start(one)[0] == 1.5
    assert at_start(other)[0] == 2.0


def test_components_that_the_code_leaves_out_must_be_zero():
    """They were ignored. The code for a slope is right on the level too, where the mass falls by g t^2 / 2."""

    def falling_by(*g):
        scene = Scene(2)
        scene.mass(1.0, (0.0, 0.0))
        scene.add(Gravity(g))
        return scene.problem((0.0, 1.0))

    level, slope = falling_by(0.0, -8.0), falling_by(2.0, -6.0)
    for call in (level.with_, level.prepare(h=0.25), lambda params: level.ensemble(params=[params], h=0.25)):
        with pytest.raises(ValueError, match=r"params must be 0 at \[\.\.\., 1\]: a component of a vector"):
            call(params=slope.params)
    members = slope.ensemble(params=[level.params, slope.params], h=0.25, method="rk4")
    assert members.u[:, -1].tolist() == [[0.0, -4.0], [1.0, -3.0]]


def test_scenes_whose_points_share_a_value_have_other_parameters():
    """Members with fewer parameters took some of them for others."""

    def two(masses):
        scene = Scene(1)
        scene.add(LinearSpring(3.0, 1.0), *scene.mass(masses, [0.0, 1.5]))
        return scene.problem((0.0, 1.0))

    same, other = two([1.0, 1.0]), two([1.0, 2.0])
    for call in (
        partial(other.ensemble, h=0.1, params=[same.params] * 2),
        partial(other.prepare(h=0.1), params=same.params),
    ):
        with pytest.raises(ValueError, match="params must have 4 values, as in the scene of this problem, not 3"):
            call()


def test_a_motion_is_the_same_for_all_its_points():
    scene = Scene(2)
    with pytest.raises(ValueError, match="direction of SupportMotion is the same for all points: add a motion for"):
        scene.add(SupportMotion(shaken, np.eye(2)), scene.fixed(np.eye(2)))


def test_a_field_named_rate_is_no_velocity():
    @dataclass(frozen=True, eq=False)
    class Turning(Body):
        rate: float

        @staticmethod
        @eig3.jit
        def force(t, rate):
            return math.cos(rate * t), math.sin(rate * t)

    scene = Scene(2)
    scene.mass(1.0, (0.0, 0.0))
    scene.add(Turning(1.0))
    assert "nothing reads the velocity" in scene.problem((0.0, 1.0)).note


@pytest.mark.parametrize("nesting", [lambda links: links, lambda links: [(b, a) for a, b in reversed(links)]])
def test_springs_and_dampers_between_the_same_points_share_a_loop(nesting):
    scene = Scene(3)
    row = scene.mass(1.0, np.random.default_rng(0).standard_normal((20, 3)))
    scene.add(LinearSpring(2.0, 0.1), row[:-1], row[1:])
    for a, b in nesting([(row[i], row[i + 1]) for i in range(19)]):
        scene.add(LinearDamper(0.3), a, b)
    problem = scene.problem((0.0, 1.0))
    assert "19 x LinearSpring\n19 x LinearDamper" in problem.note
    assert code(problem).count("for s in range(19)") == 1
    assert code(problem).count("sqrt(") == 1


# Points


def test_handles_are_sliced_and_read_like_arrays():
    scene = Scene(2)
    post = scene.fixed((9.0, 9.0))
    one = scene.mass(1.0, (1.0, 2.0), (3.0, 4.0))
    net = scene.mass(2.0, np.arange(12.0).reshape(2, 3, 2))
    assert net.shape == (2, 3)
    assert len(net) == 2
    assert net[0, ::2].shape == (2,)
    problem = scene.problem((0.0, 1.0))
    assert one.positions(problem.u0).tolist() == [1.0, 2.0]
    assert one.velocities(problem.v0).tolist() == [3.0, 4.0]
    np.testing.assert_array_equal(net.positions(problem.u0), np.arange(12.0).reshape(2, 3, 2))
    np.testing.assert_array_equal(
        net[1].positions(np.stack([problem.u0] * 4)), [np.arange(6.0, 12.0).reshape(3, 2)] * 4
    )
    np.testing.assert_array_equal([point.positions(problem.u0) for point in net[0]], np.arange(6.0).reshape(3, 2))
    assert post.positions(problem.u0).tolist() == [9.0, 9.0]
    assert post.velocities(problem.v0).tolist() == [0.0, 0.0]
    with pytest.raises(ValueError, match="no mass of the scene has an inertia"):
        post.angles(problem.u0)


def test_a_mesh_has_positions_and_velocities_at_fixed_points_too():
    """A support that a motion moves is where it is at the times that are given."""
    scene = Scene(2)
    points = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)])
    sheet = StVenantKirchhoffMembrane(E=10.0, nu=0.3, thickness=0.1)
    mesh = scene.add_mesh(points, [(0, 1, 2), (1, 3, 2)], sheet, density=1.0, fixed=[0, 1])
    scene.add(SupportMotion(shaken, (0.0, 2.0)), mesh[1])
    run = scene.problem((0.0, 1.0)).integrate(h=0.01)
    for still in (mesh[0], mesh[[0]], mesh[0][None, None]):
        assert still.positions(run.u).shape == (101, *still.shape, 2)
        assert not still.positions(run.u).any()
    free = mesh[[2, 3]].positions(run.u)
    np.testing.assert_array_equal(mesh[[2, 0]].positions(run.u)[:, 0], free[:, 0])
    x, v = mesh.positions(run.u, run.t), mesh.velocities(run.v, run.t)
    np.testing.assert_array_equal(x[:, [2, 3]], free)
    np.testing.assert_array_equal(v[:, [2, 3]], mesh[[2, 3]].velocities(run.v))
    np.testing.assert_allclose(x[:, 1], np.column_stack([1 + 0 * run.t, 0.2 * np.sin(3 * run.t)]), rtol=1e-14)
    np.testing.assert_allclose(v[:, 1], np.column_stack([0 * run.t, 0.6 * np.cos(3 * run.t)]), rtol=1e-14)
    np.testing.assert_array_equal(mesh.positions(run.u[-1], run.t[-1]), x[-1])
    np.testing.assert_array_equal(mesh.positions([run.u, run.u], run.t), [x, x])
    with pytest.raises(ValueError, match=r"^t must be given for points that a motion moves"):
        mesh.positions(run.u)
    with pytest.raises(ValueError, match=r"^t must have the shape \(101,\) of the states, not \(3,\)"):
        mesh.positions(run.u, [0.0, 0.5, 1.0])


def test_each_may_have_its_own_parameters():
    scene = Scene(2)
    masses = scene.mass([1.0, 2.0, 4.0], np.zeros((3, 2)))
    scene.add(HarmonicForce([(1.0, 0.0), (0.0, 2.0), (3.0, 3.0)], 0.0))
    scene.add(Gravity([(0.0, 1.0), (0.0, 2.0)]), masses[1:])
    problem = scene.problem((0.0, 1.0))
    found = masses.velocities(at_start(problem))
    assert found.tolist() == [[1.0, 0.0], [0.0, 2.0], [0.75, 2.75]]


def test_coinciding_ends_without_a_length_give_no_nan():
    """A length of 0 may be among others."""
    scene = Scene(2)
    masses = scene.mass(1.0, [(0.0, 0.0), (0.0, 0.0), (2.0, 0.0)])
    scene.add(LinearSpring(1.0, [0.0, 0.5]), masses[:-1], masses[1:])
    scene.add(LinearDamper(1.0), masses[0], masses[1])
    problem = scene.problem((0.0, 1.0))
    assert masses.velocities(at_start(problem))[:, 0].tolist() == [0.0, 1.5, -1.5]
    assert np.isfinite(problem.integrate(h=1e-3).u).all()


# An effect that a user defines


@dataclass(frozen=True, eq=False)
class Magnet(Link):
    strength: float

    tension = eig3.jit(lambda r, strength: strength / r**2)

    @staticmethod
    @eig3.jit
    def potential(r, strength):
        return -strength / r


def test_an_effect_of_ones_own():
    """A planet on a circle. The functions of the class may be decorated with or without staticmethod."""
    scene = Scene(2)
    sun, planet = scene.fixed((0.0, 0.0)), scene.mass(1.0, (1.0, 0.0), (0.0, 1.0))
    scene.add(Magnet(1.0), sun, planet)
    solution = scene.problem((0.0, 2 * math.pi)).integrate(h=1e-3, method="rk4")
    assert solution.u[-1] == pytest.approx((1.0, 0.0), abs=1e-9)
    assert solution.drift["energy"] < 1e-12


def test_names_in_ones_own_effect_do_not_clash_with_those_of_the_code():
    @dataclass(frozen=True, eq=False)
    class X(Link):
        shift_0: float
        x: float = 0.0

        tension = eig3.jit(lambda r, shift_0, x: shift_0 * r + x)

    found = []
    for effect in (X(10.0), LinearSpring(10.0)):
        scene = Scene(2)
        post, masses = scene.fixed((1.0, 2.0)), scene.mass(1.0, [(2.0, 2.0), (4.0, 2.5)])
        scene.add(SupportMotion(shaken, (1.0, 0.5)), post)
        scene.add(effect, post, masses)
        problem = scene.problem((0.0, 1.0))
        found.append(at_start(problem, 0.3))
    np.testing.assert_allclose(*found, rtol=1e-14)


def test_results_have_names_of_their_own():
    @dataclass(frozen=True, eq=False)
    class Push(Body):
        f: float
        a: float

        force = eig3.jit(lambda f: (f,))
        acceleration = eig3.jit(lambda a: (a,))

    scene = Scene(1)
    scene.mass([1.0, 2.0], [0.0, 1.0])
    scene.add(Push(3.0, 10.0))
    problem = scene.problem((0.0, 1.0))
    assert at_start(problem).tolist() == [13.0, 11.5]


unit = eig3.jit(lambda t: (1.0,))


def test_one_function_may_be_a_force_here_and_an_acceleration_there():
    @dataclass(frozen=True, eq=False)
    class Either(Body):
        force: object = None
        acceleration: object = None

    scene = Scene(1)
    masses = scene.mass(2.0, [0.0, 1.0])
    scene.add(Either(force=unit), masses[0])
    scene.add(Either(acceleration=unit), masses[1])
    problem = scene.problem((0.0, 1.0))
    assert at_start(problem).tolist() == [0.5, 1.0]


def test_nothing_acts_on_no_points():
    scene = Scene(2)
    masses = scene.mass(1.0, np.eye(2))
    none = scene.mass(1.0, np.zeros((0, 2)))
    scene.add(Gravity((0.0, 1.0)), masses[:0])
    scene.add(LinearSpring(1.0, 1.0), masses[2:], none)
    assert not acceleration(scene.problem((0.0, 1.0)), np.ones(4), np.ones(4)).any()


def test_the_plan_is_the_same_with_work():
    """It judges the motion, and the work is no part of it."""
    steps = []
    for work in (False, True):
        problem = problems.rail_joint(t_end=0.05, work=work)
        steps.append(eig3.plan(problem, 1e-3, methods=["rk4"]).best.h)
    assert steps[0] == pytest.approx(steps[1], rel=0.2)


@dataclass(frozen=True, eq=False)
class SampledForce(Body):
    """The example in the docstring of `Body`."""

    samples: object
    interval: float
    direction: object

    vectors = ("direction",)
    arrays = ("samples",)
    nonnegative = ("interval",)

    @staticmethod
    @eig3.jit
    def force(t, samples, interval, direction):
        f = samples[min(int(t / interval), samples.size - 1)]
        return f * direction[0], f * direction[1]


def test_an_effect_with_an_array_of_its_own():
    assert all("arrays" in kind.__doc__ for kind in (Body, Link, Motion))
    scene = Scene(2)
    masses = scene.mass([1.0, 2.0], np.eye(2))
    scene.add(SampledForce([1.0, 3.0, 5.0], 0.5, (0.0, 2.0)))
    scene.add(SampledForce([10.0], 1.0, (1.0, 0.0)), masses[1])
    problem = scene.problem((0.0, 1.0))
    found = [masses.velocities(at_start(problem, t)).tolist() for t in (0.0, 0.6, 9.0)]
    assert found == [[[0, 2.0], [5.0, 1.0]], [[0, 6.0], [5.0, 3.0]], [[0, 10.0], [5.0, 5.0]]]
    with pytest.raises(ValueError, match="interval of SampledForce must not be negative"):
        SampledForce([1.0], -0.5, (1.0, 0.0))


def test_a_problem_and_an_effect_are_as_they_were():
    fields, stiffness = np.array([[1.0], [2.0]]), [3.0]
    scene = Scene(1)
    masses = scene.mass(1.0, [0.0, 1.0])
    scene.add(Gravity(fields))
    scene.add(LinearSpring(stiffness), masses[:1], masses[1:])
    fields[:], stiffness[0] = 9.0, 9.0
    problem = scene.problem((0.0, 1.0))
    scene.add(Gravity(-2.0), masses[0])
    assert at_start(problem).tolist() == [4.0, -1.0]
    assert at_start(scene.problem((0.0, 1.0))).tolist() == [2.0, -1.0]


# Bad scenes


class Undecorated(Body):
    strength: float

    force = eig3.jit(lambda strength: (strength, strength))


class Longer(LinearSpring):
    extra: float = 0.0


@dataclass(frozen=True, eq=False)
class NoField(Link):
    strength: float

    cutoff_field = "distance"

    tension = eig3.jit(lambda r, strength: strength * r)


def two(dimension=2):
    scene = Scene(dimension)
    return scene, scene.mass(1.0, np.arange(2.0 * dimension).reshape((2, dimension) if dimension > 1 else 2))


@dataclass(frozen=True, eq=False)
class Uncompiled(Body):
    def force(self, v):
        return v


@dataclass(frozen=True, eq=False)
class Curious(Body):
    force = eig3.jit(lambda weather: weather)


@dataclass(frozen=True, eq=False)
class Forced(Body):
    force: object
    strength: object = 1.0


@dataclass(frozen=True, eq=False)
class Timed(Body):
    t: float

    force = eig3.jit(lambda t: (t, t))


@dataclass(frozen=True, eq=False)
class Stringy(Body):
    field: tuple

    vectors = "field"

    force = eig3.jit(lambda field: field)


@dataclass(frozen=True, eq=False)
class Pulling(Link):
    tension: object


@dataclass(frozen=True, eq=False)
class Undirected(Motion):
    direction: float

    motion = eig3.jit(lambda t: (t, 1.0))


imaginary = eig3.jit(lambda r: 1j * r)


class Plain(Body):
    force = eig3.jit(lambda t: (t, t))


one = eig3.jit(lambda v: v[0])
three = eig3.jit(lambda v, strength: (strength, v[0], v[1]))
pushed = eig3.jit(lambda v, strength: (strength, v[0]))
failing = eig3.jit(lambda v: (v[0], v[2]))


def fixed_ends(effect):
    scene = Scene(1)
    scene.add(effect, *scene.fixed([0.0, 1.0]))


def on_two(effect, *names):
    scene, masses = two()
    scene.add(effect, *(masses[name] for name in names))


def with_fixed(effect):
    scene, _ = two()
    scene.add(effect, scene.fixed((5.0, 5.0)))


def strangers():
    scene, masses = two()
    scene.add(LinearSpring(1.0), masses[0], two()[1][0])


def coincident():
    scene = Scene(3)
    scene.add(LinearSpring(1.0, 0.5), *scene.mass(1.0, np.zeros((2, 3))))


BAD_VALUES = {
    "dimension must be 1, 2 or 3, not 4.": lambda: Scene(4),
    "m of masses must be positive and finite, not 0.0.": lambda: Scene(1).mass(0.0, 0.0),
    "m of masses must be positive.*-2.0.": lambda: Scene(1).mass([1, -2], [0.0, 1.0]),
    "m of masses must have the shape .2,. of": lambda: Scene(1).mass([1, 2, 3], [0.0, 1.0]),
    "must have 2 components each": lambda: Scene(2).mass(1.0, (1.0, 2.0, 3.0)),
    "position of masses must be finite.": lambda: Scene(2).mass(1.0, (1.0, math.nan)),
    "the scene has no mass": lambda: Scene(2).problem((0, 1)),
    "LinearSpring joins two fixed points": lambda: fixed_ends(LinearSpring(1.0)),
    "LinearSpring joins a point to itself.": lambda: on_two(LinearSpring(1.0), 0, 0),
    "LinearSpring has no direction where its ends coincide": coincident,
    "HertzContact has no direction where its ends coincide": lambda: (
        lambda scene: scene.add(HertzContact(1.0, 0.5), *scene.mass(1.0, np.zeros((2, 2))))
    )(Scene(2)),
    "LinearSpring was given ends of shapes .2, 1. and .2,.; give one shape, or one point for all": lambda: (
        lambda scene: scene.add(LinearSpring(1.0), scene.mass(1.0, [[0.0], [1.0]]), scene.fixed([2.0, 3.0]))
    )(Scene(1)),
    "for all; others= gives all near pairs of two groups": lambda: (
        lambda scene: scene.add(HertzContact(1.0, 0.5), scene.mass(1.0, np.eye(2)), scene.fixed(np.ones((3, 2))))
    )(Scene(2)),
    "LinearSpring was given points of another scene.": strangers,
    "velocity of masses must have 2 components": lambda: Scene(2).mass(1.0, (0.0, 0.0), 5.0),
    "velocity of masses must have the": lambda: Scene(1).mass(1.0, [0.0, 1.0], [1.0, 2.0, 3.0]),
    "rest_length of LinearSpring must not be neg": lambda: on_two(LinearSpring(1.0, -1.0), 0, 1),
    "values must have 4 degrees of freedom on the last axis": lambda: two()[1].positions(np.zeros(7)),
    "values must have 4 degrees of freedom": lambda: two()[1].positions(3.0),
    "range of Wall must not be negative": lambda: on_two(Wall(1.0, -1.0), 0, 1),
    "name it in the class's vectors": lambda: on_two(Forced(pushed, (1.0, 2.0, 3.0)), 0),
    "QuadraticDrag acts on masses": lambda: with_fixed(QuadraticDrag(1.0)),
    "SampledMotion moves fixed points, but was given masses": lambda: on_two(
        SampledMotion([0, 1], [0, 1], (1.0, 0.0)), 0
    ),
    "field of Gravity must have 2 components": lambda: on_two(Gravity((1.0, 2.0, 3.0))),
    "field of Gravity must have 2 components, not a number.": lambda: on_two(Gravity(9.81)),
    "RotatingFrame needs a scene of 2 or 3 dimensions, not 1.": lambda: two(1)[0].add(RotatingFrame(1.0)),
    "stiffness of LinearSpring has the shape": lambda: on_two(LinearSpring([1, 2, 3]), 0, 1),
    "drag of QuadraticDrag has the shape": lambda: (
        lambda scene: (scene.add(QuadraticDrag([1, 2, 3])), scene.problem((0, 1)))
    )(two()[0]),
    "stiffness of LinearSpring must be finite": lambda: on_two(LinearSpring(math.inf), 0, 1),
    "times of SampledMotion must increase": lambda: SampledMotion([0, 2, 1], [0, 0, 0]),
    "times of SampledMotion must increase.*": lambda: SampledMotion([0, 1, 1], [0, 0, 0]),
    "times of SampledMotion must hold at least two": lambda: SampledMotion([0], [0]),
    "values of SampledMotion must have as many samples": lambda: SampledMotion([0, 1], [0]),
    "normal of PlaneContact must be a unit vector.": lambda: PlaneContact(1.0, (1.0, 1.0)),
    "regularization_speed of CoulombFriction must be positive.": lambda: CoulombFriction(0.1, 1.0, 0.0),
    "LinearSpring was given ends of shapes": lambda: (
        lambda scene, m: scene.add(LinearSpring(1.0), m, scene.fixed(np.ones((3, 2))))
    )(*two()),
    "t_span must end after it starts": lambda: two()[0].problem((1.0, 0.0)),
}
BAD_TYPES = {
    "tension of Pulling must return a number here": lambda: on_two(Pulling(imaginary), 0, 1),
    "decorate it with @eig3.jit, and no field may": lambda: on_two(Pulling(3.0), 0, 1),
    "Undirected must have a field direction, and vec": lambda: with_fixed(Undirected(1.0)),
    "vectors of Stringy must be a tuple of names": lambda: on_two(Stringy((1.0, 2.0))),
    "a single point has no length": lambda: len(two()[1][0]),
    "has no cutoff, and thus needs two arguments of points": lambda: on_two(LinearSpring(1.0), 0),
    "LinearSpring acts on Points of a scene, not on int.": lambda: Scene(1).add(LinearSpring(1.0), 0, 1),
    "LinearSpring acts on Points of a scene, not on NoneType.": lambda: Scene(1).add(LinearSpring(1.0), None),
    "LinearSpring takes 2 arguments of points, not 0.": lambda: on_two(LinearSpring(1.0)),
    "LinearSpring takes 2 arguments of points, not 3.": lambda: on_two(LinearSpring(1.0), 0, 1, 0),
    "not on list: index an array of points": lambda: Scene(1).add(LinearSpring(1.0), [0], 1),
    "force of Forced must return a tuple of 2 numbers here": lambda: on_two(Forced(one)),
    "force of Forced must return a tuple of 2 numbers": lambda: on_two(Forced(three)),
    "force of Forced does not compile: .*index out of": lambda: on_two(Forced(failing)),
    "Forced must have a function force or acceleration.": lambda: on_two(Forced(None)),
    "Plain must be a dataclass: decorate it with @dataclass": lambda: on_two(Plain()),
    "Undecorated must be a dataclass: decorate it with @dataclass": lambda: Undecorated(3.0),
    "Longer must be a dataclass: decorate it with @dataclass": lambda: Longer(3.0, extra=1.0),
    "cutoff_field of NoField must be the name of a field": lambda: on_two(NoField(1.0), 0, 1),
    "Timed must rename its field t: force has an argument": lambda: on_two(Timed(1.0)),
    "effect must be an effect with parameters.* not Gravity.": lambda: Scene(1).add(Gravity),
    "stiffness of LinearSpring must be made of real": lambda: on_two(LinearSpring("soft"), 0, 1),
    "force of Uncompiled must be compiled": lambda: on_two(Uncompiled()),
    "Curious has the argument weather, but can take only t, x, v, m": lambda: on_two(Curious()),
}


test_bad_scenes = refusals(BAD_VALUES, BAD_TYPES)
