"""What STABILITY.md promises: the public names of 1.0, and files of 1.0, which every later version 1.x reads.

`python -m tests.test_promises DIRECTORY` writes the files. A version that changes the format adds a directory to
tests/data, and the others stay.
"""

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

import eig3

DATA = Path(__file__).parent / "data"
PARAMS = {"g": 9.81, "drag": np.array([0.01, 0.02])}


@eig3.jit
def ball(t, u, v, z, p, a, dz):
    """A ball in the plane with drag; z[0] is what the drag takes."""
    a[0] = -p.drag[0] * v[0]
    a[1] = -p.g - p.drag[1] * v[1]
    dz[0] = p.drag[0] * v[0] * v[0] + p.drag[1] * v[1] * v[1]


height = eig3.jit(lambda t, u, v, z, p: u[1])


@eig3.jit
def rebound(t, u, v, z, p):
    v[1] *= -0.8


energy = eig3.jit(lambda t, u, v, z, p: 0.5 * (v[0] * v[0] + v[1] * v[1]) + p.g * u[1])

FUNCTIONS = {
    "events": {"ground": eig3.Event(height, direction=-1, apply=rebound)},
    "outputs": {"height": height},
    "invariants": {"energy": energy},
}
SYSTEM = {"t_span": (0.0, 2.0), "u0": [0.0, 1.0], "v0": [1.0, 0.0], "z0": {"work": 0.0}, "params": PARAMS}


def runs(directory):
    """Return a run with tolerances, one with steps and `save_to`, one of a problem, and an ensemble, by their files."""
    steps = {"h": 0.01, "method": "rk4", **FUNCTIONS}
    starts = {**SYSTEM, "v0": np.array([[1.0, 0.0], [2.0, 1.0], [3.0, -1.0]])}
    pendulum, newton = eig3.problems.spring_pendulum(), eig3.CentralDifference(solver="newton")
    return {
        "tolerances.npz": eig3.integrate(ball, **SYSTEM, rtol=1e-8, method="rk5", save_every=10, **FUNCTIONS),
        "steps": eig3.integrate(ball, **SYSTEM, **steps, save_every=20, save_to=directory / "steps"),
        "problem.npz": pendulum.integrate(h=0.01, t_end=2.0, method=newton, save_every=50, check=True),
        "members": eig3.ensemble(ball, **starts, **steps, save_every=50, save_to=directory / "members"),
    }


def assert_motion(run, tolerance=1e-6):
    """The motion across is exact, and so is the balance of energy, which counts the work and the impacts.

    Steps have errors of 1e-8, which add up over some tens of steps and three impacts.
    """
    t, (x, y), (vx, vy), (k, _) = run.t, run.u.T, run.v.T, PARAMS["drag"]
    near = {"rtol": tolerance, "atol": tolerance}
    np.testing.assert_allclose(x, vx[0] * (1 - np.exp(-k * t)) / k, **near)
    np.testing.assert_allclose(vx, vx[0] * np.exp(-k * t), **near)
    ground = run.events["ground"]
    assert len(ground.t) >= 2
    lost = np.sum(ground.v**2 - ground.v_after**2, axis=1) / 2
    energies = (vx**2 + vy**2) / 2 + PARAMS["g"] * y
    lost_until = [lost[ground.t < time].sum() for time in t]
    np.testing.assert_allclose(energies + run.z["work"] + lost_until, energies[0], **near)
    np.testing.assert_allclose(ground.v_after[:, 1], -0.8 * ground.v[:, 1], rtol=1e-12)
    np.testing.assert_array_equal(run.outputs["height"], y)
    assert run.extremes["height"].high == 1.0 or vy[0] > 0
    assert run.success


@pytest.fixture(params=sorted(DATA.glob("1.*")), ids=lambda path: path.name)
def files(request):
    return request.param


def test_earlier_files_have_their_values(files):
    runs = [eig3.load(files / name) for name in ("tolerances.npz", "steps")]
    members = eig3.load(files / "members")
    assert len(members) == 3
    for run in (*runs, *members):
        assert_motion(run)
    assert [run.method for run in runs] == [eig3.RK5(), eig3.RK4()]
    problem = eig3.load(files / "problem.npz")
    assert problem.method == eig3.CentralDifference(solver="newton")
    assert (problem.error.u[1:] != 0).all()
    assert problem.error.u.shape == problem.u.shape
    assert [*problem.drift] == ["energy"]
    assert problem.labels == eig3.problems.spring_pendulum().labels


def test_earlier_runs_continue(files):
    for name in ("tolerances.npz", "steps"):
        longer = eig3.load(files / name, rhs=ball, **FUNCTIONS).extend(3.0)
        assert longer.t[-1] == 3.0
        assert_motion(longer)
    assert_motion(eig3.load(files / "members", rhs=ball, **FUNCTIONS)[1])


def test_public_names_stay():
    """A name leaves tests/data/names.txt with version 2 only; a version adds its new names when it is released."""
    promised = (DATA / "names.txt").read_text().split()
    modules = {name: importlib.import_module(name) for name in {name.rpartition(".")[0] for name in promised}}
    assert [name for name in promised if name.rpartition(".")[2] not in dir(modules[name.rpartition(".")[0]])] == []
    assert [f"eig3.{name}" for name in dir(eig3)] == [name for name in promised if name.count(".") == 1]


if __name__ == "__main__":
    for name, found in runs(Path(sys.argv[1])).items():
        if name.endswith(".npz"):
            found.save(Path(sys.argv[1]) / name)
