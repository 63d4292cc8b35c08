"""Links between all near pairs of points: the lists of neighbours miss nothing, and runs do not depend on them."""

import functools
import inspect
import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from types import FunctionType

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import eig3
from eig3 import effects
from eig3.kernels import neighbours
from eig3.scene import Scene, pair_force

from .conftest import assert_same


def acceleration(problem, u=None, v=None, params=None, t=0.0, rhs=None):
    """The acceleration in a state, whose list is written to params."""
    params = problem.params.copy() if params is None else params
    u, v = problem.u0 if u is None else u, problem.v0 if v is None else v
    a = np.full(u.size, np.nan)
    with np.errstate(all="ignore"):
        (rhs or problem.rhs)(t, u, v, params, a)
    return a


@functools.cache
def compiled_lists(lists):
    memory = neighbours.memory
    return eig3.jit(lambda task, t, u, p, place, part, parts: lists(task, t, memory(u), memory(p), place, part, parts))


def in_python(function):
    """A function of a scene that Python evaluates, with compiled lists: its code takes no time to compile."""
    function = function.py_func
    names = {
        **{name: getattr(value, "py_func", value) for name, value in function.__globals__.items()},
        "memory": lambda values: values,
        "floats": lambda p, begin, count: p[begin : begin + count],
        "integers": lambda p, begin, count: p[begin:].view(np.int32)[:count],
        "batch": lambda: np.empty(neighbours.BATCH),
        "lists": compiled_lists(function.__globals__.get("lists")),
        **dict.fromkeys(("share_at", "code_address"), lambda function: function),
    }
    for name, value in names.items():
        if getattr(value, "__globals__", None) is function.__globals__:
            names[name] = FunctionType(value.__code__, names)
    return FunctionType(function.__code__, names)


def by_python(problem, *state, **options):
    return acceleration(problem, *state, rhs=in_python(problem.rhs), **options)


def energy_by_python(problem, u=None, v=None, t=0.0):
    u, v = problem.u0 if u is None else u, problem.v0 if v is None else v
    return in_python(problem.energy)(t, u, v, problem.params.copy())


def in_vectors(problem, *state, **options):
    """The acceleration by compiled code that takes the roots of several distances at once."""
    rhs = eig3.jit(problem.rhs.py_func, cache=False)  # code from the disk has no text
    a = acceleration(problem, *state, rhs=rhs, **options)
    assert re.search(r"sqrtpd|fsqrt\s+v", next(iter(rhs.for_python.inspect_asm().values())))
    return a


def contact(**fields):
    return effects.HertzContact(**{"stiffness": 50.0, "contact_distance": 0.7, "damping": 0.1, **fields})


def of_all_pairs(scene, effect, points):
    """Add the effect as explicit links."""
    i, j = np.triu_indices(len(points), 1)
    scene.add(effect, points[i], points[j])


def by_numpy(x, v, others=None, *, contact_distance=0.7, damping=0.1, box=None, shear=0.0, t=0.0):
    """The forces of the contacts between all points, or with others at rest, and the energy that they store."""
    y, w = (x, v) if others is None else (others, np.zeros_like(others))
    way, speed = x[:, None] - y, v[:, None] - w
    if shear:
        turns = np.rint(way[..., 1] / box[1])
        way[..., 0] -= turns * shear * box[1] * t
        speed[..., 0] -= turns * shear * box[1]
    for axis, side in enumerate(box or ()):
        if side:
            way[..., axis] -= side * np.rint(way[..., axis] / side)
    r = np.sqrt((way**2).sum(axis=2))
    if others is None:
        np.fill_diagonal(r, np.inf)
    rate, d = (way * speed).sum(axis=2) / r, np.maximum(contact_distance - r, 0)
    push = 50.0 * d**1.5 * np.maximum(0, 1 - damping * rate)
    stored = 2 / 5 * 50.0 * (d**2.5).sum()
    return ((push / r)[..., None] * way).sum(axis=1), stored / 2 if others is None else stored


def cloud(dimension, n=60, side=4.0, seed=1):
    rng = np.random.default_rng(seed)
    return rng.uniform(0, side, (n, dimension)), rng.normal(size=(n, dimension))


BOXES = {"2d": (2, None), "3d": (3, None), "box": (3, (6.0, 6.0, None)), "small box": (2, (4.2, 1.5)), "1d": (1, None)}
BOXES["own sizes"] = (2, None)


@pytest.mark.parametrize("case", BOXES)
def test_near_pairs_have_the_forces_of_all_pairs(case):
    """They have the same terms in another order."""
    dimension, box = BOXES[case]
    (x, v), damping, sizes = cloud(dimension), 0.0 if case == "2d" else 0.1, np.full(60, 0.7)
    if case == "own sizes":
        sizes = np.random.default_rng(3).uniform(0.3, 1.1, 60)
    scene = Scene(dimension, box=box)
    points = scene.mass(1.3, *((x[:, 0], v[:, 0]) if dimension == 1 else (x, v)))
    scene.add(contact(damping=damping, contact_distance=sizes if case == "own sizes" else 0.7), points)
    problem = scene.problem((0, 1))
    force, stored = by_numpy(x, v, contact_distance=(sizes[:, None] + sizes) / 2, damping=damping, box=box)
    assert np.abs(force).max() > 13
    found = (by_python if damping else in_vectors)(problem)
    np.testing.assert_allclose(found, force.T.ravel() / 1.3, rtol=0, atol=1e-12 * np.abs(force).max())
    if not damping:
        assert energy_by_python(problem) == pytest.approx(stored + 1.3 / 2 * (v**2).sum(), rel=1e-13)


@pytest.mark.parametrize("kind", ["one size", "own sizes", "elastic", "two groups", "sheared"])
def test_points_with_many_mates_have_the_forces_of_all_pairs(kind):
    """Some have more mates than are looked at together, which are 192."""
    rng = np.random.default_rng(4)
    x = np.concatenate([rng.uniform(0, 7, (60, 3)), 3 + 0.2 * rng.normal(size=(200, 3))])
    v = rng.normal(size=x.shape)
    sizes, places = np.linspace(1.5, 2.5, len(x)), rng.uniform(0, 7, (90, 3))
    box, shear, damping = (7.0, 7.0, None), 0.3 * (kind == "sheared"), 0.0 if kind == "elastic" else 0.1
    scene, others = Scene(3, box=box, shear=shear), places if kind == "two groups" else None
    given, mixed = (sizes, (sizes[:, None] + sizes) / 2) if kind == "own sizes" else (2.0, 2.0)
    groups = {} if others is None else {"others": scene.fixed(places)}
    scene.add(contact(contact_distance=given, damping=damping), scene.mass(1.3, x, v), **groups)
    problem = scene.problem((0, 1), work=True)
    assert "for point in range" in inspect.getsource(problem.rhs.py_func)
    force, stored = by_numpy(x, v, others, contact_distance=mixed, damping=damping, box=box, shear=shear, t=0.2)
    expected, u, v0 = force.T.ravel() / 1.3, problem.u0, problem.v0
    if damping:
        expected, u, v0 = np.append(expected, (force * v).sum()), np.append(u, 0.0), np.append(v0, 0.0)
    else:
        assert energy_by_python(problem, t=0.2) == pytest.approx(stored + 1.3 / 2 * (v**2).sum(), rel=1e-12)
    found = (by_python if damping else in_vectors)(problem, u, v0, t=0.2)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@eig3.jit
def one_way(r, rate, stiffness, damping, contact_distance):
    return -stiffness * (contact_distance - r) + damping * rate


@eig3.jit
def two_ways(r, rate, stiffness, damping, contact_distance):
    if rate > 0.0:
        return one_way(r, rate, stiffness, damping, contact_distance)
    return -2.0 * stiffness * (contact_distance - r) - damping * rate * r


@eig3.jit
def two_ways_inside(r, rate, stiffness, damping, contact_distance):
    return 1.1 * two_ways(r, rate, stiffness, damping, contact_distance)


@pytest.mark.parametrize("law", [one_way, two_ways_inside])
def test_a_pair_has_the_same_bits_at_each_place_of_a_batch(law):
    """Where it is, in a vector or in the rest, depends on when the list was built, and on the threads."""

    @dataclass(frozen=True, eq=False)
    class Damped(effects.Link):
        stiffness: float
        damping: float
        contact_distance: np.ndarray

        cutoff_field, mixed = "contact_distance", ("contact_distance",)
        tension = staticmethod(law)

    rng, n = np.random.default_rng(0), 45
    x = np.column_stack([10.0 * np.arange(n), np.zeros(n)])
    scene = Scene(2)
    points = scene.mass(1.0, x)
    scene.add(Damped(50.0, 30.0, np.linspace(0.9, 1.1, n)), points, others=scene.fixed(x + 0.3))
    problem = scene.problem((0, 1))
    u, v = problem.u0 + 0.05 * rng.normal(size=problem.u0.size), rng.normal(size=problem.u0.size)
    whole = points.velocities(acceleration(problem, u, v))
    for first in range(1, n):  # the pairs before it move out of the distance, one by one
        u.reshape(2, -1)[1, first - 1] += 5.0
        np.testing.assert_array_equal(points.velocities(acceleration(problem, u, v))[first:], whole[first:])


@pytest.mark.parametrize("thickness", [0.0, 1e-9, 0.1, 1.0])
def test_points_in_order_stay_in_order(thickness):
    """Those of a thin layer too: a thickness below their distance does not count."""
    rng, rows = np.random.default_rng(0), np.indices((30, 40)).reshape(2, -1).T
    layer = np.column_stack([rows, thickness * rng.uniform(size=len(rows))])
    for x in (layer, layer[:40], layer[:1], np.concatenate([layer, layer + 1e6])):
        assert not pair_force._jumps(x)
    for x in (layer, layer[:40]):
        assert pair_force._jumps(rng.permutation(x))


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    dimension=st.integers(1, 3),
    spread=st.sampled_from([0.5, 3.0, 1e3]),
    far=st.sampled_from([0.0, 1e6]),
    is_periodic=st.booleans(),
)
def test_a_list_misses_no_pair(seed, dimension, spread, far, is_periodic):
    """Also after jumps, with a point that is far away, and in boxes of few or many cells."""
    rng = np.random.default_rng(seed)
    n, contact_distance = 40, 0.4
    box = rng.uniform(0.9, 4.0, dimension).tolist() if is_periodic else None
    x = rng.uniform(-spread, spread, (n, dimension))
    x[0] += far
    scene = Scene(dimension, box=box)
    points = scene.mass(1.0, x if dimension > 1 else x[:, 0])
    scene.add(contact(contact_distance=contact_distance, damping=0.0), points, neighbor_capacity=n)
    problem = scene.problem((0, 1))
    params = problem.params.copy()
    for size in (0.01, 0.1, 10.0):
        u = problem.u0 + rng.normal(size=problem.u0.size) * size
        x = u.reshape(dimension, n).T
        expected = by_numpy(x, 0 * x, contact_distance=contact_distance, damping=0.0, box=box)[0].T.ravel()
        atol = 1e-13 * (10 + spread + far) * (1 + np.abs(expected).max())  # the round-off of the coordinates
        np.testing.assert_allclose(by_python(problem, u, params=params), expected, rtol=0, atol=atol)


BOX = (8.0, 5.0)


def gas(box=None, adds_all=False):
    """Discs that move fast in a box or between walls."""
    x = np.stack(np.meshgrid(np.arange(8.0), np.arange(5.0)), axis=-1).reshape(-1, 2)
    scene = Scene(2, box=box)
    rng = np.random.default_rng(5)
    points = scene.mass(rng.uniform(0.5, 2.0, 40), x, rng.normal(size=x.shape) * 3)
    effect = effects.HertzContact(500.0, 0.8)
    of_all_pairs(scene, effect, points) if adds_all else scene.add(effect, points)
    if box is None:
        for normal, offset in (((1, 0), -1.0), ((-1, 0), -8.0), ((0, 1), -1.0), ((0, -1), -5.0)):
            scene.add(effects.PlaneContact(stiffness=500.0, normal=normal, offset=offset))
    return scene


def test_runs_do_not_depend_on_the_list(monkeypatch, tmp_path):
    """Other skins, chunks, `extend`, files and forks give the same bits."""
    problem = gas().problem((0.0, 2.0))
    run = problem.integrate(h=1e-3)
    assert run.success
    halves = problem.with_(t_span=(0.0, 1.0)).integrate(h=1e-3).extend(2.0)
    assert_same(halves, run)
    halves.save(tmp_path / "run.npz")
    assert_same(problem.load(tmp_path / "run.npz").extend(3.0), run.extend(3.0))
    for skin in (0.01, 0.7):
        monkeypatch.setattr(pair_force, "_SKIN", skin)
        np.testing.assert_array_equal(gas().problem((0.0, 2.0)).integrate(h=1e-3).u, run.u)


first_at_zero = eig3.jit(lambda t, u, v, p: v[0])


def test_a_run_is_that_with_all_pairs():
    """With events, tolerances and its critical step. Collisions make errors grow: the span is short."""
    events = {"turn": eig3.Event(first_at_zero)}
    problems = [gas(BOX, adds_all).problem((0.0, 0.5)) for adds_all in (False, True)]
    near, every = (problem.critical_step().h for problem in problems)
    assert near == pytest.approx(every, rel=1e-9)
    for options in ({"h": 1e-3, "events": events}, {"rtol": 1e-11, "method": "rk5", "invariants": {}}):
        near, every = (problem.integrate(**options) for problem in problems)
        assert near.success
        np.testing.assert_allclose(near.u[-1], every.u[-1], rtol=0, atol=1e-7)
        for name, found in near.events.items():
            assert len(found) > 0
            np.testing.assert_allclose(found.t, every.events[name].t, rtol=0, atol=1e-7)


def test_energy_and_momentum_are_kept_over_thousands_of_collisions():
    """The energy with an error of the order of the method: a quarter of it with half of the step."""
    problem = gas(BOX).problem((0.0, 20.0))
    runs = [problem.integrate(h=h, save_every=None) for h in (2e-3, 1e-3)]
    drifts = [run.drift["energy"] for run in runs]
    energy = problem.energy_of(problem.u0, problem.v0)
    assert drifts[0] < 1e-2 * energy
    assert drifts[1] < 0.4 * drifts[0]
    m, v = 1 / problem.params[:40], runs[1].v
    momentum = v.reshape(-1, 2, 40) @ m
    np.testing.assert_allclose(momentum[-1], momentum[0], rtol=0, atol=1e-11 * np.abs(v).max() * m.sum())


def test_two_groups_touch_each_other_only():
    """Masses of a group fly through each other, and bounce from fixed points and masses of the other group."""
    x, v = cloud(2, 30)
    walls = np.random.default_rng(4).uniform(0, 4, (20, 2))
    expected = by_numpy(x, v, walls)[0] / 1.3
    assert np.abs(expected).max() > 10
    for is_fixed in (True, False):
        scene = Scene(2)
        points = scene.mass(1.3, x, v)
        others = scene.fixed(walls) if is_fixed else scene.mass(2.0, walls)
        scene.add(contact(), points, others=others)
        a = by_python(scene.problem((0, 1)))
        np.testing.assert_allclose(points.velocities(a), expected, rtol=0, atol=1e-12 * np.abs(expected).max())
        if not is_fixed:
            np.testing.assert_allclose(2.0 * others.velocities(a).sum(axis=0), -1.3 * expected.sum(axis=0), rtol=1e-12)


def test_joined_points_may_be_left_out():
    """The masses of a spring overlap, and so do the corners of a triangle."""
    x = np.array([[0.0, 0.0], [0.5, 0.0], [1.0, 0.0], [0.6, 0.3]])
    scene = Scene(2)
    points = scene.mass(1.0, x)
    scene.add(effects.LinearSpring(10.0), points[[0, 1]], points[[1, 2]])
    scene.add(contact(damping=0.0), points, exclude_bonded=("1-2",))
    expected = Scene(2)
    others = expected.mass(1.0, x)
    expected.add(effects.LinearSpring(10.0), others[[0, 1]], others[[1, 2]])
    expected.add(contact(damping=0.0), others[[0, 0, 1, 2]], others[[2, 3, 3, 3]])
    found, expected = (by_python(scene.problem((0, 1))) for scene in (scene, expected))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def test_a_list_that_outgrows_its_memory_misses_nothing():
    """Masses fall on one another towards a point, and fly apart again; the list of the first is built in parts."""
    x, _ = cloud(2, 100, side=20.0)
    found, listed, energies = [], [], []
    for room in (1, 100):
        scene = Scene(2)
        points = scene.mass(1.0, x - 10)
        scene.add(contact(contact_distance=1.0, damping=0.0), points, neighbor_capacity=room)
        scene.add(effects.LinearSpring(1.0), points, scene.fixed((0.0, 0.0)))
        problem = scene.problem((0.0, 3.0))
        found.append(problem.integrate(h=1e-2, invariants={}))
        place = np.flatnonzero(problem.params == 100)[0]
        energies.append(in_python(problem.energy)(0.0, found[0].u[150], found[0].v[150], problem.params.copy()))
        params = problem.params.copy()
        for t in (0, 150, 150, 300):
            by_python(problem, found[0].u[t], found[0].v[t], params)
            listed.append(params[place + neighbours.LISTED])
    np.testing.assert_array_equal(found[0].u, found[1].u)
    assert len(set(energies)) == 1
    assert listed[0] == listed[3] == 100  # all points
    assert listed[1] == listed[2] < 50
    assert listed[4:] == [100] * 4


def near_places(x, contact_distance=1.0):
    """A problem of spheres at some places, and its parameters after an evaluation."""
    scene = Scene(3)
    scene.add(contact(contact_distance=contact_distance), scene.mass(1.0, x))
    problem = scene.problem((0, 1))
    return problem, problem.params.copy()


PLACES = {
    "two clusters": lambda x, i: x + np.where(i % 2, 1e4, 0.0)[:, None],
    "a line": lambda x, i: 0.6 * i[:, None] * np.ones(3),
    "a part that flies away": lambda x, i: np.where(i[:, None] % 5, x, 1e3 * x),
    "a cloud that explodes": lambda x, i: 1e200 * x,
}


@pytest.mark.parametrize("case", PLACES)
def test_a_list_looks_at_few_points_wherever_they_are(case):
    """The time of a search would grow as the sum of the squares of the numbers of points in the buckets."""
    i = np.arange(1000)
    x = np.stack(np.divmod(i, 100)[:1] + np.divmod(i % 100, 10), axis=1) * 1.0
    problem, params = near_places(x)
    u = PLACES[case](x, i).T.ravel()
    by_python(problem, u, params=params)
    place = np.flatnonzero(params == 1000)[0]
    areas = neighbours.Areas(*params[place + neighbours.HEAD :][: len(neighbours.Areas._fields)].astype(int))
    start = params[areas.start :].view(np.int32)[: int(params[place + neighbours.BUCKETS]) + 1]
    assert start[-1] == 1000
    assert (np.diff(start) ** 2).sum() < 4000


def test_a_list_is_kept_until_a_point_has_used_up_half_of_its_skin():
    """Two points outside the skin at its edge touch when both have moved by half of it towards each other."""
    x = np.zeros((7, 3))
    x[:, 0] = 100.0 * np.arange(7) + 0.5
    problem, params = near_places(x)
    by_python(problem, params=params)
    head = params[np.flatnonzero(params == 7)[0] :]
    built, skin = params[int(head[neighbours.HEAD + neighbours.BUILT]) :], head[neighbours.PRESENT_SKIN]
    apart = problem.u0.copy()
    apart[1] = apart[0] + 1.0 + 1.001 * skin
    for way, way_when_built in ((0.0, 0.0), (0.499, 0.0), (0.502, 0.502)):
        u = apart.copy()
        u[:2] += way * skin, -way * skin
        a = by_python(problem, u, params=params)
        assert built[0] == apart[0] + way_when_built * skin
    assert a[1] > 0 > a[0]


def test_points_without_a_place_are_near_to_none():
    """The others have the forces that they would have without them."""
    rng = np.random.default_rng(2)
    x = rng.uniform(0, 3, (50, 3))
    problem, params = near_places(x)
    u = problem.u0.copy()
    for number, value in ((0, np.nan), (60, np.inf), (120, -np.inf)):
        u[number] = value
    a = by_python(problem, u, params=params).reshape(3, 50)
    lost = [0, 10, 20]
    assert (a[:, lost] == 0).all()
    others = np.delete(np.arange(50), lost)
    expected, params = near_places(x[others])
    np.testing.assert_allclose(a[:, others].ravel(), by_python(expected), rtol=0, atol=1e-11)


def test_threads_may_share_a_solution_and_a_problem():
    """Evaluations on shared parameters would write to one list: such threads crash within some calls."""
    problem = gas().problem((0.0, 1.0))
    run = problem.integrate(h=1e-3, save_every=10)
    precise = problem.integrate(rtol=1e-4, method="rk5", invariants={})
    t = np.linspace(0, 1, 301)
    expected = [run.at(t)[0], precise.at(t)[0], problem.energy_of(run.u, run.v)]

    def evaluate(seed):
        some = np.random.default_rng(seed).permutation(t.size)
        back = slice(None, None, -1 if seed % 2 else 1)
        return all(
            np.array_equal(run.at(t[some])[0], expected[0][some])
            and np.array_equal(precise.at(t[some])[0], expected[1][some])
            and np.array_equal(problem.energy_of(run.u[back], run.v[back]), expected[2][back])
            for _ in range(5)
        )

    with ThreadPoolExecutor(8) as pool:
        assert all(pool.map(evaluate, range(16)))


def test_a_run_that_diverges_says_so():
    run = gas().problem((0.0, 50.0)).integrate(h=0.5)
    assert run.status is eig3.Status.DIVERGED


def test_a_scene_without_near_pairs_has_no_code_for_them():
    scene = Scene(2)
    points = scene.mass(1.0, [[0.0, 0.0], [1.0, 0.0]])
    scene.add(effects.LinearSpring(1.0), points[0], points[1])
    source = inspect.getsource(scene.problem((0, 1)).rhs.py_func)
    assert not any(word in source for word in ("refresh", "mates", "rint", "side"))


def test_members_of_a_small_scene_run_alone():
    """In lanes, the values of a member are not neighbours in memory, and a list of integers cannot be among them."""
    scene = Scene(2, box=(3.0, 3.0))
    balls = scene.mass(1.0, [[0.0, 0.0], [1.0, 0.2], [0.5, 1.2]], [[1.0, 0.0], [-1.0, 0.3], [0.0, -1.0]])
    scene.add(contact(contact_distance=0.8), balls)
    problem = scene.problem((0.0, 1.0))
    v0 = problem.v0 * np.linspace(0.5, 1.5, 20)[:, None]
    for options, params in (
        ({"h": 1e-2}, {"params": np.tile(problem.params, (20, 1))}),
        ({"rtol": 1e-6, "method": "rk5", "save_every": None}, {}),
    ):
        found = problem.ensemble(v0=v0, threads=2, **options, **params)
        for i in (0, 19):
            one = problem.with_(v0=v0[i]).integrate(**options)
            np.testing.assert_array_equal(found[i].u[-1], one.u[-1])


def test_params_that_are_no_list_are_refused():
    """The integers of a list do not survive a conversion to single precision: all indices would be 0."""
    problem = gas().problem((0.0, 1.0))
    params = problem.params.astype(np.float32)
    with pytest.raises(ValueError, match="params must be the parameters of the scene in double precision"):
        eig3.integrate(problem.rhs, (0.0, 1.0), problem.u0, problem.v0, params=params, h=1e-3)


def test_groups_without_pairs_do_nothing():
    scene = Scene(2)
    one, none = scene.mass(1.0, [[0.0, 0.0]]), scene.mass(1.0, np.zeros((0, 2)))
    scene.add(contact(), one)
    scene.add(contact(), none)
    scene.add(contact(), one, others=none)
    np.testing.assert_array_equal(by_python(scene.problem((0, 1))), 0.0)


@eig3.jit
def shaken(t):
    return 0.02 * np.sin(3 * t), 0.06 * np.cos(3 * t)


def test_walls_that_move_act_as_the_same_links():
    """A floor shakes under some balls. The sums of the forces differ in their order only."""
    runs = []
    for is_near in (True, False):
        scene = Scene(2)
        floor = scene.fixed([[0.1 * k, 0.0] for k in range(5)])
        balls = scene.mass(1.0, [[0.05 + 0.1 * k, 0.12 + 0.05 * k] for k in range(4)])
        scene.add(effects.Gravity((0.0, -9.81)))
        scene.add(effects.SupportMotion(shaken, (0.3, 1.0)), floor)
        for law in (effects.HertzContact(4e3, 0.1, 0.3), effects.LennardJones(0.01, 0.08, 0.2)):
            if is_near:
                scene.add(law, balls, others=floor)
                scene.add(law, balls)
            else:
                for k, ball in enumerate(balls):
                    for other in (*floor, *balls[:k]):
                        scene.add(law, other, ball)
        runs.append(scene.problem((0.0, 1.0), work=True).integrate(h=1e-3))
    near, given = runs
    np.testing.assert_allclose(near.u, given.u, atol=1e-10)  # round-off, which collisions amplify
    np.testing.assert_allclose(near.z["work"], given.z["work"], atol=1e-10)
    assert np.ptp(near.z["work"]) > 0.1


def test_a_wall_that_rests_beside_one_that_moves():
    """A sheet on a pole that moves touches posts that rest: both are fixed points of one list."""
    places, found = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]], []
    for is_near in (True, False):
        scene = Scene(3)
        posts = scene.fixed([[1.2, 0.5, -0.3], [1.1, 0.1, -0.4]])
        membrane = effects.StVenantKirchhoffMembrane(100.0, 0.3, 1.0)
        sheet = scene.add_mesh(places, [[0, 2, 1]], membrane, density=1.0, fixed=[0, 1])
        scene.add(effects.SupportMotion(shaken, (0.0, 0.0, 1.0)), sheet[:2])
        if is_near:
            scene.add(contact(), sheet, others=posts)
        else:
            for post in posts:
                scene.add(contact(), post, sheet[2])
        found.append(by_python(scene.problem((0.0, 1.0)), t=0.5))
    np.testing.assert_allclose(*found, rtol=1e-12)  # the order of rounding


@dataclass(frozen=True, eq=False)
class Sticky(effects.Link):
    """A link without a cutoff."""

    pull: float

    tension = eig3.jit(lambda r, pull: pull)


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (lambda s, a: s.add(Sticky(1.0), a), "Sticky has no cutoff"),
        (lambda s, a: s.add(contact(), a, others=a), "given a point twice"),
        (lambda s, a: s.add(contact(), s.fixed([[9.0, 9.0], [8.0, 8.0]])), "fixed points only"),
        (lambda s, a: s.add(contact(contact_distance=3.0), a), "at most half a side of the box, 2.5"),
        (
            lambda s, a: s.add(effects.LennardJones(1.0, 0.3, [0.7, 0.7, 0.8]), a),
            "cutoff of LennardJones must be a number",
        ),
        (lambda s, a: s.add(contact(), s.mass(1.0, [[0.0, 0.0], [0.0, 0.0]])), "two points coincide"),
        (lambda s, a: s.add(contact(), s.mass(1.0, [[0.0, 0.0], [5.0, 0.0]])), "two points coincide"),
        (lambda s, a: s.add(contact(), a[0], a[1], others=a), "others, exclude_bonded and neighbor_capacity are for"),
        (lambda s, a: s.add(contact(), a, neighbor_capacity=0), "neighbor_capacity must be"),
        (lambda s, a: Scene(2, box=(1.0,)), "box must have 2 sides"),
        (lambda s, a: Scene(2, box=(1.0, -1.0)), "box must have 2 sides"),
    ],
)
def test_errors(act, message):
    scene = Scene(2, box=(5.0, None))
    points = scene.mass(1.0, [[0.0, 0.0], [1.0, 0.0], [2.0, 0.5]])
    with pytest.raises((TypeError, ValueError), match=message):
        act(scene, points)
