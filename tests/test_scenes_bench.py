"""`eig3 bench scenes`: scenes and systems by hand are the same systems, and the tables are complete."""

from dataclasses import dataclass

import numpy as np
import pytest

import eig3
from eig3 import effects
from eig3.bench import near_pairs, rods, scene_pairs, scenes, squeezers
from eig3.bench.near_pairs.atoms import accelerations
from eig3.bench.rivals import exudyn, lammps, mujoco
from eig3.problems.argon import argon
from eig3.scene import Scene
from eig3.scene.cell import Cell

from .conftest import acceleration

pytestmark = pytest.mark.system


@pytest.mark.parametrize("pair", scene_pairs.SCENE_PAIRS, ids=lambda pair: pair.title)
def test_a_scene_and_the_system_by_hand_are_the_same(pair):
    scene, hand = pair.problems()
    rng = np.random.default_rng(0)
    u, v = scene.u0 + 0.01 * rng.standard_normal(scene.u0.size), rng.standard_normal(scene.u0.size)
    # sums of terms of size 100 in another order
    np.testing.assert_allclose(acceleration(scene, u, v), acceleration(hand, u, v), rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("pair", scene_pairs.SCENE_PAIRS, ids=lambda pair: pair.title)
def test_effects_at_zero_strength_do_nothing(pair):
    crowd, added = scene_pairs.crowded(pair)
    full, lean = crowd.problem((0.0, 1.0)), pair.problems()[0]
    assert added >= 9
    u, v = lean.u0, np.ones(lean.u0.size)
    np.testing.assert_allclose(acceleration(full, u, v), acceleration(lean, u, v), rtol=1e-11, atol=1e-11)
    assert full.params.size > lean.params.size


def test_every_effect_is_there():
    kinds = {effects.Body, effects.Link, effects.Motion}
    known = {getattr(effects, name) for name in effects.__all__} - kinds
    others = Cell, effects.FrictionalContact, effects.Constraint, effects.Torque, effects.Motor
    others += effects.Ewald, effects.Breaking  # these need a periodic box, and have events
    known = {
        kind
        for kind in known
        if not (hasattr(kind, "event") or hasattr(kind, "state_rate")) and not issubclass(kind, others)
    }
    assert {type(effect) for effect in scene_pairs.others(3)} == known


@pytest.mark.parametrize("pair", scene_pairs.SCENE_PAIRS, ids=lambda pair: pair.title)
def test_another_effect_in_the_catalogue_changes_no_instruction(pair, monkeypatch):
    """The same text gives the same function."""

    @dataclass(frozen=True, eq=False)
    class Wind(effects.Body):
        speed: float

        force = eig3.jit(lambda v, speed: (speed - v[0], -v[1]))

    before = pair.problems()[0].rhs
    monkeypatch.setitem(vars(effects), "Wind", Wind)
    scene = Scene(2)
    scene.mass(1.0, (0.0, 0.0))
    scene.add(Wind(1.0))
    assert scene.problem((0.0, 1.0)).rhs is not before
    assert pair.problems()[0].rhs is before


def test_the_command(tmp_path, monkeypatch):
    """With one scene, and two effects beside its own."""

    def few(dimension):
        return (each for each in others(dimension) if isinstance(each, effects.LinearDamper | effects.SofteningSpring))

    others = scene_pairs.others
    monkeypatch.setattr(scene_pairs, "others", few)
    monkeypatch.setattr(scenes, "SCENE_PAIRS", scene_pairs.SCENE_PAIRS[:1])
    monkeypatch.setattr(scenes, "_SECONDS", 1e-4)
    monkeypatch.setattr(scenes, "_SPHERES", (100,))
    monkeypatch.setattr(scenes, "_ARGON", 4)
    monkeypatch.setattr(scenes, "_RODS", (2,))
    monkeypatch.setattr(near_pairs.contest, "POINT_STEPS", 2000)
    monkeypatch.setattr(near_pairs.contest, "STEPS", 20)
    monkeypatch.setattr(near_pairs, "_GRAINS", 100)
    monkeypatch.setattr(near_pairs.whole_runs, "STEPS", 50)
    lines = []
    scenes.benchmark(repeats=1, out=tmp_path, write=lines.append)
    text = "\n".join(lines)
    assert text.count("| spring pendulum, Cartesian") == 2
    assert (tmp_path / "scenes.png").read_bytes().startswith(b"\x89PNG")


def shaken_argon():
    problem = argon(n=4)
    return problem.with_(u0=problem.u0 + 1e-11 * np.sin(np.arange(problem.u0.size)))


def compare(problem, expected, tolerance):
    found = acceleration(problem, problem.u0, problem.v0)
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * np.abs(expected).max())


@pytest.mark.skipif(not lammps.is_there(), reason=lammps.INSTALL)
@pytest.mark.parametrize("threads", [None, 1])
def test_lammps_has_the_same_forces(threads):
    problem = near_pairs.spheres(200)
    compare(problem, near_pairs.in_lammps.spheres(problem, threads).forces().T.ravel(), 1e-12)
    problem = shaken_argon()
    compare(problem, accelerations(near_pairs.in_lammps.argon(problem, threads).forces()), 1e-12)


@pytest.mark.skipif(not lammps.is_there(), reason=lammps.INSTALL)
def test_lammps_has_the_same_grains():
    """They move by 5 % of a diameter; `HertzMindlin` says how the damping in LAMMPS differs."""
    problem = near_pairs.whole_runs.hopper(300)
    solution = problem.integrate(h=problem.h, t_end=50 * problem.h, save_every=None)
    solver = near_pairs.whole_runs.grains_in_lammps(problem).solver
    solver.command("run 50")
    atom = solver.numpy.extract_atom
    places = atom("x")[np.argsort(atom("id"))][:300, :2]
    found = solution.u[-1].reshape(3, 300)[:2].T
    assert np.abs(found - places).max() < 0.005 * near_pairs.whole_runs.DIAMETER


def test_openmm_has_the_same_forces():
    pytest.importorskip("openmm")
    problem = shaken_argon()
    compare(problem, accelerations(near_pairs.in_openmm.simulation(problem).forces()), 1e-12)
    in_single_precision = near_pairs.in_openmm.simulation(problem, "CPU").forces()
    compare(problem, accelerations(in_single_precision), 1e-3)


def test_exudyn_has_the_same_forces_of_linear_contacts():
    pytest.importorskip("exudyn")
    problem = near_pairs.linear(200)
    start = near_pairs.rows(problem.u0), near_pairs.rows(problem.v0)
    simulation = exudyn.Simulation(*start, near_pairs.STIFFNESS, near_pairs.REACH, near_pairs.H, threads=1)
    simulation.run(1)
    compare(problem, (simulation.speeds() - start[1]).T.ravel() / near_pairs.H, 1e-12)


def test_chains_of_rods_and_of_springs_end_at_the_same_places():
    """Each row of the table has the error that is asked for, and the rivals that are not installed are named."""
    rows = rods.rows_of(2, 1)
    assert [row[0] for row in rows[:3]] == ["rods, EIG-3", "rods, RK4", "springs, EIG-3"]
    assert all(float(row[2]) <= rods.ERROR for row in rows)
    assert rows[0][-1] == "1"
    text = rods.table((2,), 1)
    assert ("pip install mujoco" in text) != mujoco.is_there()
    assert ("pip install exudyn" in text) != exudyn.is_there()


def test_squeezers_end_with_the_published_angles():
    rows = squeezers.rows(1)
    assert [row[0] for row in rows[:3]] == ["EIG-3", "RK4", "RK8"]
    assert len(rows) == 3 + exudyn.is_there() + mujoco.is_there()
    assert all(float(row[2]) <= squeezers.ERROR for row in rows)
    assert int(rows[0][1]) > int(rows[1][1]) > int(rows[2][1])
