"""Threads that share the forces of a scene: they change no bit, and a run does not depend on their being there."""

import ctypes
import inspect
import multiprocessing
import re
import threading
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
import pytest

import eig3
from eig3 import effects
from eig3.effects import Link
from eig3.kernels import grains as kernel
from eig3.kernels import neighbours
from eig3.kernels.team import BOARD, TICKET
from eig3.problems.flag import sheet
from eig3.run import short
from eig3.scene import Scene, codegen, grains_text, pair_force
from eig3.stepping import team

from .conftest import acceleration, assert_same
from .test_neighbours import by_python


@pytest.fixture(autouse=True)
def _shared_from_the_start(monkeypatch):
    monkeypatch.setattr(codegen, "_SHARED", 1)
    monkeypatch.setattr(codegen, "_SHARED_CELLS", 1)
    monkeypatch.setattr(team, "_WORTH", 0)
    monkeypatch.setattr(short, "MOST_SECONDS", 0)
    monkeypatch.setattr(pair_force, "_JUMP", np.inf)  # most pairs shall be in two parts


@pytest.fixture
def counted(monkeypatch):
    """The number of threads that each run has started."""
    started = []

    class Thread(threading.Thread):
        def start(self):
            started.append(self)
            super().start()

    monkeypatch.setattr(team.threading, "Thread", Thread)
    return started


def cloud(dimension=2, n=150, density=1.0, seed=3):
    """Points in no order, so that most pairs are in two parts, with velocities."""
    rng = np.random.default_rng(seed)
    side = round(n ** (1 / dimension) + 0.5)
    lattice = np.stack(np.meshgrid(*[np.arange(side)] * dimension), axis=-1).reshape(-1, dimension)
    x = rng.permutation(lattice)[:n] + rng.uniform(-0.2, 0.2, (n, dimension))
    return x / density, rng.normal(size=(n, dimension))


WALL = np.column_stack([np.arange(-1, 14, 0.5), np.full(30, -0.8)])


def damped():
    x, v = cloud()
    scene = Scene(2)
    balls = scene.mass(np.linspace(0.5, 2, len(x)), x, v)
    scene.add(effects.HertzContact(500.0, 0.9, damping=0.3), balls)
    scene.add(effects.HertzContact(800.0, 0.7, damping=0.3), balls, others=scene.fixed(WALL))
    scene.add(effects.Gravity((0.0, -1.0)))
    return scene


def of_sizes():
    x, v = cloud(3)
    scene = Scene(3, box=(7.0, None, 7.0))
    scene.add(effects.HertzContact(500.0, np.linspace(0.6, 1.1, len(x))), scene.mass(1.0, x, v))
    return scene


def sheared():
    x, v = cloud(density=1.05)
    scene = Scene(2, box=(13.0, 13.0), shear=0.5)
    scene.add(effects.HertzContact(300.0, 1.0, damping=0.1), scene.mass(1.0, x, v))
    return scene


def with_many_mates():
    x, v = cloud(3)
    scene = Scene(3, box=(7.0, 7.0, 7.0))
    scene.add(effects.HertzContact(20.0, 2.0, damping=0.1), scene.mass(1.0, x, v))
    return scene


swing = eig3.jit(lambda t: (0.3 * np.sin(5 * t), 1.5 * np.cos(5 * t)))


def of_cells():
    """A sheet in wind on a pole that moves, with springs in rows and in no order, and effects on all and on some."""
    rng = np.random.default_rng(5)
    cells, places = sheet(12, 8), np.array([(i, j, 0.02 * i * j) for i in range(12) for j in range(8)], dtype=float)
    scene, elastic = Scene(3), effects.StVenantKirchhoffMembrane(100.0, 0.3, 1.0)
    cloth = scene.add_mesh(places, cells, elastic, density=1.0, fixed=range(8))
    scene.add(effects.WindPressure(0.1, (2.0, 0.0, 1.0)), *cloth[cells.T])
    scene.add(effects.SupportMotion(swing, (0.0, 0.0, 1.0)), cloth[:8])
    scene.add(effects.LinearSpring(20.0, 1.0), cloth[:-8], cloth[8:])
    scene.add(effects.LinearDamper(0.5), *cloth[rng.permutation(96).reshape(2, 48)])
    scene.add(effects.QuadraticDrag(0.05), cloth[rng.permutation(np.arange(8, 96))[:40]])
    scene.add(effects.Gravity((0.0, 0.0, -5.0)))
    scene.add(effects.HertzContact(100.0, 0.9), cloth[8:])
    return scene


ROUGH = effects.HertzMindlin(E=300.0, nu=0.3, contact_distance=1.0, friction=0.5, restitution=0.7)


def of_grains():
    """Discs in no order that roll and slide on one another and on a floor that moves, beside springs and contacts."""
    x, v = cloud()
    scene = Scene(2)
    grains = scene.mass(np.linspace(0.5, 2, len(x)), x, v, inertia=0.1, angular_velocity=np.linspace(-3, 3, len(x)))
    scene.add(replace(ROUGH, contact_distance=np.linspace(0.9, 1.1, len(x))), grains)
    floor = scene.fixed(WALL)
    scene.add(ROUGH, grains, others=floor)
    scene.add(effects.SupportMotion(swing, (0.2, 0.5)), floor)
    scene.add(effects.LinearSpring(50.0, 1.0), grains[:50], grains[50:100])
    scene.add(effects.HertzContact(10.0, 1.3), grains, exclude_bonded=("1-2",))
    scene.add(effects.Gravity((0.0, -1.0)))
    return scene


@pytest.mark.parametrize("make", [damped, of_sizes, sheared, with_many_mates, of_cells, of_grains])
def test_threads_change_no_bit(make, counted, monkeypatch):
    """Nor do the forces differ from those of a small scene by more than the order of rounding in two loops."""
    runs = []
    for threads in (1, 2, 3, 5):
        del counted[:]
        shared = make().problem((0.0, 0.5), threads=threads)
        runs.append(shared.integrate(h=1e-3, save_every=50))
        assert len(counted) % max(1, threads - 1) == 0
        assert bool(counted) == (threads > 1)
    run = runs[0]
    for other in runs[1:]:
        assert_same(other, run)
    assert np.abs(run.u[-1] - run.u[0]).max() > 0.3
    monkeypatch.setattr(codegen, "_SHARED", 10**9)
    monkeypatch.setattr(codegen, "_SHARED_CELLS", 10**9)
    alone = make().problem((0.0, 0.5))
    assert not hasattr(alone.rhs.py_func, "shares")
    for t, u, v in zip(run.t[::2], run.u[::2], run.v[::2], strict=True):
        found, expected = acceleration(shared, u, v, t), by_python(alone, u, v, t=t)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


def test_points_in_no_order_are_sorted_by_their_places(monkeypatch):
    """This is seen in the order of the list only. The forces differ by the order of rounding."""
    given = of_grains().problem((0.0, 0.5), threads=2)
    monkeypatch.setattr(pair_force, "_JUMP", 3.0)
    sorted_ = [of_grains().problem((0.0, 0.5), threads=threads) for threads in (1, 2)]
    (place,) = re.findall(r"int64\((\d+)\)\n    add_forces\(share, lists, 0,", inspect.getsource(given.rhs.py_func))
    for problem, is_sorted in ((given, False), (sorted_[0], True)):
        areas = neighbours.Areas(*problem.params[int(place) + neighbours.HEAD :][:15].astype(int))
        numbers = problem.params[areas.number :].view(np.int32)[:150]
        assert (np.diff(numbers) > 0).all() != is_sorted
        np.testing.assert_array_equal(np.sort(numbers), np.arange(150))
    found = [acceleration(problem, problem.u0, problem.v0) for problem in (given, *sorted_)]
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-13 * np.abs(found[0]).max())
    runs = [problem.integrate(h=1e-3, save_every=100) for problem in sorted_]
    np.testing.assert_array_equal(runs[0].u, runs[1].u)


def test_a_list_without_room_has_one_part():
    """Masses fly at one another: the parts, and then the list, have no room for the pairs."""
    x, _ = cloud(n=100)
    runs = []
    for threads in (1, 4):
        scene = Scene(2)
        points = scene.mass(1.0, x - 5, 5 - x)
        scene.add(effects.HertzContact(5.0, 1.0, damping=0.1), points, neighbor_capacity=2)
        runs.append(scene.problem((0.0, 2.0), threads=threads).integrate(h=1e-2))
    np.testing.assert_array_equal(runs[0].u, runs[1].u)


def test_springs_of_a_part_without_room_are_written_in_turn(monkeypatch):
    """The grains that touch are the first ones: there is room for their springs, but not in the first part's table."""
    monkeypatch.setattr(grains_text, "_CONTACTS", {2: 1})
    n = np.arange(70)
    heap = np.column_stack([n % 8, n // 8]) * 0.9
    runs = []
    for threads in (1, 2, 3):
        scene = Scene(2)
        scene.add(ROUGH, scene.mass(1.0, np.concatenate([heap, 50 + 10 * heap]), inertia=0.1))
        problem = scene.problem((0.0, 0.1), threads=threads)
        stepper = problem.stepper(h=1e-3)
        with team.team(problem.rhs.py_func.shares, stepper.p, 100):
            stepper.advance(100)
        source = inspect.getsource(problem.rhs.py_func.history.advance.py_func)
        springs = int(re.search(r"springs = int64\(\d+\), int64\((\d+)\)", source)[1])
        assert stepper.params[springs + kernel.IS_FULL] == (threads > 1)
        runs.append(np.concatenate([stepper.u, stepper.v]))
    np.testing.assert_array_equal(runs[0], runs[1])
    np.testing.assert_array_equal(runs[0], runs[2])


@pytest.mark.parametrize("options", [{"h": 1e-3}, {"rtol": 1e-6, "method": "rk5"}, {"h": 1e-3, "inline": True}])
def test_all_kinds_of_runs_have_the_same_bits(options, tmp_path):
    fallen = eig3.jit(lambda t, u, v, p: u[150 + 7] + 1.0)
    events = {} if "inline" in options else {"fallen": eig3.Event(fallen)}  # a loop that looks takes long to compile
    found = []
    for threads in (1, 3):
        problem = damped().problem((0.0, 0.4), threads=threads)
        half = problem.with_(t_span=(0.0, 0.2)).integrate(events=events, save_to=tmp_path / f"{threads}", **options)
        found.append((half.extend(0.4), half, problem.integrate(events=events, **options)))
    assert_same(found[0][0], found[1][0])
    assert_same(found[0][0], found[1][2])
    assert_same(found[0][1], found[1][1])


@dataclass(frozen=True, eq=False)
class Brittle(Link):
    """A contact that raises an exception if it is pressed too far."""

    reach: float

    cutoff_field = "reach"

    @staticmethod
    @eig3.jit
    def tension(r, reach):
        if r < 0.5 * reach:
            raise ValueError("pressed too far")
        return -100 * (reach - r)


@pytest.mark.parametrize("last", [False, True])
def test_an_exception_of_a_part_is_that_of_the_run(last):
    """The points that meet are among the first or the last: their part is done by either thread."""
    x = np.arange(60.0)[:, None] * [1.2, 0.0]
    v = np.zeros((60, 2))
    v[-2 if last else 0, 0] = 10.0
    scene = Scene(2)
    scene.add(Brittle(1.0), scene.mass(1.0, x, v))
    problem = scene.problem((0.0, 1.0), threads=3)
    for _ in range(3):
        with pytest.raises(ValueError, match="pressed too far") as caught:
            problem.integrate(h=1e-3)
        assert 0.02 < caught.value.solution.t[-1] < 0.1
    problem.with_(v0=0 * problem.v0).integrate(h=1e-3)


def _integrated_by_threads(problem):
    return problem.integrate(h=1e-3).u, problem.rhs.py_func.shares.size


def test_a_spawned_process_finds_the_same_bits():
    problem = damped().problem((0.0, 0.8), threads=3)
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        u, size = pool.submit(_integrated_by_threads, problem).result()
    assert size == 150
    np.testing.assert_array_equal(u, problem.integrate(h=1e-3).u)


def test_a_run_does_not_wait_for_threads_that_never_come(monkeypatch):
    expected = damped().problem((0.0, 0.2), threads=1).integrate(h=1e-3)
    monkeypatch.setattr(team, "_serve", lambda *arguments: None)
    np.testing.assert_array_equal(damped().problem((0.0, 0.2), threads=4).integrate(h=1e-3).u, expected.u)


def test_a_copy_of_the_parameters_has_no_team():
    """Other threads evaluate on copies, while the run goes on with its team. They post no job: the ticket stays 0."""
    problem = damped().problem((0.0, 0.3), threads=3)
    shares, stepper = problem.rhs.py_func.shares, problem.stepper(h=1e-3)
    expected = stepper.fork()
    expected.advance(400)
    with team.team(shares, stepper.p, 10), ThreadPoolExecutor(2) as pool:
        ticket = ctypes.c_int64.from_address(int(stepper.params[shares.place + BOARD]) + 8 * TICKET)
        forks = [stepper.fork() for _ in range(2)]
        list(pool.map(lambda fork: fork.advance(400), forks))
        assert ticket.value == 0
    assert stepper.params[shares.place + BOARD] == 0
    for fork in forks:
        np.testing.assert_array_equal(fork.u, expected.u)


def test_one_run_at_a_time_has_other_threads_and_not_more_than_lists_have_parts(counted, monkeypatch):
    problem = damped().problem((0.0, 0.3), threads=2)
    expected = problem.integrate(h=1e-3)
    with ThreadPoolExecutor(4) as pool:
        runs = list(pool.map(lambda _: problem.integrate(h=1e-3), range(8)))
    for run in runs:
        np.testing.assert_array_equal(run.u, expected.u)
    del counted[:]
    with team.alone():
        problem.integrate(h=1e-3)
    members = problem.ensemble(v0=problem.v0 * np.linspace(0.5, 1, 3)[:, None], h=1e-3)
    monkeypatch.setattr(team, "MOST_PARTS", 1)
    problem.integrate(h=1e-3)
    assert not counted
    np.testing.assert_array_equal(members.u[-1, -1], expected.u[-1])


def test_threads_must_be_a_number():
    with pytest.raises(ValueError, match="threads must be"):
        damped().problem((0, 1), threads=0)
