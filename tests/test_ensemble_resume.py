"""Ensembles that continue after they were killed or cancelled: the same bits, and no finished part runs again."""

import json
import multiprocessing
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from distributed import Client, LocalCluster

import eig3
from eig3.effects import ElasticPlastic
from eig3.ensembles import in_parts
from eig3.math import cos

from .conftest import SAME, assert_same, oscillator, position, velocity
from .test_resume import After

MEMBERS = 300  # 3 parts: two of 128 members, and one of 44
PARAMS = np.column_stack([np.linspace(1.0, 4.0, MEMBERS), np.full(MEMBERS, 0.05)])
FUNCTIONS = {
    "events": {"turn": eig3.Event(velocity), "passage": eig3.Event(position, direction=-1)},
    "outputs": {"position": position},
    "invariants": {"velocity": velocity},
}
CASES = {
    "fixed steps in lanes": {"h": 0.01, "save_every": 7, **FUNCTIONS},
    "tolerances in lanes": {"rtol": 1e-7, "save_every": 1, **FUNCTIONS},
    "one at a time": {"h": 0.01, "t_eval": [2.0, 4.5], **FUNCTIONS},
}


def run(case="fixed steps in lanes", **options):
    return eig3.ensemble(oscillator, (0.0, 5.0), 1.0, 0.0, params=PARAMS, **{**CASES[case], **options})


@pytest.fixture
def started(monkeypatch):
    """The first members of the parts that run in this process."""
    firsts, call = [], in_parts._march

    def noted(rhs, options, part, *arguments):
        firsts.append(part.first)
        return call(rhs, options, part, *arguments)

    monkeypatch.setattr(in_parts, "_march", noted)
    return firsts


def finished(place):
    """The first members of the finished parts in a directory."""
    files = sorted(place.glob("part-*.npz"))
    return [int(file.stem[5:]) for file in files if eig3.load(file).success.all()]


@pytest.mark.parametrize("case", CASES)
def test_a_cancelled_ensemble_goes_on(case, tmp_path, started):
    whole = run(case)
    cancelled = run(case, save_to=tmp_path, threads=1, cancel=After(9))
    held = finished(tmp_path)
    assert (cancelled.status == eig3.Status.INTERRUPTED).any()
    started.clear()
    found = cancelled.resume()
    assert sorted(held + started) == [0, 128, 256]
    assert started
    assert_same(found, whole, SAME)
    for again in (run(case, save_to=tmp_path), eig3.load(tmp_path, rhs=oscillator, **FUNCTIONS).resume()):
        assert again.notes[-1] == "An earlier run had finished 300 of 300 members."
        assert_same(again, whole, SAME)
    assert sorted(held + started) == [0, 128, 256]  # nothing has run again
    np.testing.assert_array_equal(found.extend(6.0).u, run(case).extend(6.0).u) if case != "one at a time" else None


KILLER = """\
import json, os, signal, sys
from pathlib import Path
import numpy as np
import eig3
from eig3.effects import ElasticPlastic
from eig3.ensembles import in_parts
from tests.conftest import SAME, assert_same, oscillator
from tests.test_ensemble_resume import FUNCTIONS, finished, run

case, places = sys.argv[1], Path(sys.argv[2])
calls = 0


def die_at(moment):
    global calls
    calls += 1
    if calls == moment:
        os.kill(os.getpid(), signal.SIGKILL)


def killed(place, moment):
    savez, fsync, replace, compute = np.savez, os.fsync, Path.replace, in_parts._march

    def torn(stream, **arrays):
        global calls
        calls += 1
        savez(stream, **arrays)
        if calls == moment:
            stream.flush()
            os.truncate(stream.fileno(), stream.tell() // 2)
            os.kill(os.getpid(), signal.SIGKILL)

    def before(function):
        def call(*arguments):
            die_at(moment)
            return function(*arguments)
        return call

    np.savez, os.fsync, Path.replace, in_parts._march = torn, *map(before, (fsync, replace, compute))
    run(case, save_to=place, threads=1)
    os._exit(0)


whole, found = run(case, threads=1), []
firsts, compute = [], in_parts._march
in_parts._march = lambda f, options, part, *rest: (firsts.append(part.first), compute(f, options, part, *rest))[1]
moment, is_alive = 0, False
while not is_alive:
    moment += 1
    place = places / str(moment)
    child = os.fork()
    if not child:
        killed(place, moment)
    is_alive = os.WIFEXITED(os.waitpid(child, 0)[1])
    held, loads = finished(place) if place.exists() else [], (place / "ensemble.npz").exists()
    firsts.clear()
    is_loaded = loads and moment % 2
    again = eig3.load(place, rhs=oscillator, **FUNCTIONS).resume() if is_loaded else run(case, save_to=place)
    assert_same(again, whole, SAME)
    assert sorted(held + firsts) == [0, 128, 256], (moment, held, firsts)
    left = sorted(x.name for x in place.iterdir())
    found.append([moment, len(held), bool(is_loaded), left])
print(json.dumps(found))
"""


@pytest.mark.system
@pytest.mark.parametrize("case", CASES)
def test_an_ensemble_that_was_killed_at_any_moment_goes_on(case, tmp_path):
    """Each child dies at the next moment: in, before and after a write, between two files, and before a part runs."""
    command = [sys.executable, "-c", KILLER, case, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=Path(__file__).parent.parent)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    # Six files with three moments each, and three parts; the last child ends by itself.
    assert len(found) == 6 * 3 + 3 + 1
    assert {n_held for _, n_held, *_ in found} == {0, 1, 2, 3}
    assert sum(is_loaded for *_, is_loaded, _ in found) >= 5
    names = ["ensemble.npz", "notes.npz", *(f"part-{first:012d}.npz" for first in (0, 128, 256)), "recipe.npz"]
    assert all(left == names for *_, left in found)  # no torn file remains


def test_another_ensemble_is_refused(tmp_path):
    run(save_to=tmp_path, cancel=After(4))
    held = {path: path.read_bytes() for path in tmp_path.iterdir()}
    changes = {
        "h": {"h": 0.02},
        "save_every": {"save_every": 5},
        "method": {"method": "rk4"},
        "outputs": {"outputs": {"position": velocity}},
        "events": {"events": dict(reversed(FUNCTIONS["events"].items()))},  # the order of simultaneous events
    }
    for name, change in changes.items():
        with pytest.raises(FileExistsError, match=rf"holds an ensemble with another {name}: name another directory"):
            run(save_to=tmp_path, **change)
    start = (0.0, 5.0), 1.0, 0.0
    with pytest.raises(FileExistsError, match="holds an ensemble with another params and another rhs"):
        eig3.ensemble(position, *start, params=PARAMS[::-1], save_to=tmp_path, **CASES["fixed steps in lanes"])
    (tmp_path / "foreign").mkdir()
    (tmp_path / "foreign" / "notes.txt").touch()
    with pytest.raises(FileExistsError, match=r"save_to must name a new or an empty directory, but .* holds files"):
        run(save_to=tmp_path / "foreign")
    assert held == {path: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}


def springs(factor):
    return eig3.jit(lambda t, u, v, p: -factor * p[0] * cos(u))


def test_functions_are_compared_by_what_they_compute(tmp_path):
    """The same code with another captured number is another function, and under another name the same."""

    @eig3.jit
    def other_name(t, u, v, p):
        return -p[0] * u - p[1] * v

    @eig3.jit
    def same_name(t, u, v, p):
        return -p[0] * u - p[1] * v

    start, options = ((0, 1), 1.0, 0.0), {"h": 0.01, "params": PARAMS}
    first = eig3.ensemble(other_name, *start, **options, save_to=tmp_path / "names")
    again = eig3.ensemble(same_name, *start, **options, save_to=tmp_path / "names")
    assert_same(again, first, SAME)
    eig3.ensemble(springs(1.0), *start, **options, save_to=tmp_path / "numbers")
    eig3.ensemble(springs(1.0), *start, **options, save_to=tmp_path / "numbers")
    with pytest.raises(FileExistsError, match="another rhs"):
        eig3.ensemble(springs(2.0), *start, **options, save_to=tmp_path / "numbers")
    with pytest.raises(ValueError, match="holds an ensemble with another rhs: load it with the functions"):
        eig3.load(tmp_path / "numbers", rhs=springs(2.0)).resume()


def test_what_resume_needs(tmp_path):
    with pytest.raises(ValueError, match="cannot be resumed: it was not written by save_to, or is a copy"):
        run().resume()
    run(save_to=tmp_path, cancel=After(4))
    with pytest.raises(ValueError, match="cannot be resumed: it was loaded without functions; give load the functions"):
        eig3.load(tmp_path).resume()
    with pytest.raises(ValueError, match="events must have the same names as in the ensemble: 'turn', 'passage'"):
        eig3.load(tmp_path, rhs=oscillator).resume()
    with pytest.raises(ValueError, match="outputs needs rhs too"):
        eig3.load(tmp_path, outputs=FUNCTIONS["outputs"])
    loaded = eig3.load(tmp_path, rhs=oscillator, **FUNCTIONS)
    with pytest.raises(TypeError, match="executor must"):
        loaded.resume(executor=3)
    with pytest.raises(ValueError, match="threads must"):
        loaded.resume(threads=0)


def test_an_ensemble_goes_on_in_its_directory_from_another_one(tmp_path, started, monkeypatch):
    """The paths are relative to the directory at the start."""
    monkeypatch.chdir(tmp_path)
    cancelled = run(save_to="runs", threads=1, cancel=After(9))
    loaded = eig3.load("runs", rhs=oscillator, **FUNCTIONS)
    (tmp_path / "other").mkdir()
    monkeypatch.chdir(tmp_path / "other")
    assert loaded.resume().success.all()
    started.clear()
    assert cancelled.resume().success.all()
    assert not started
    assert not any(Path.cwd().iterdir())


def test_a_damaged_part_runs_again(tmp_path, started):
    whole = run(save_to=tmp_path)
    path = tmp_path / "part-000000000128.npz"
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    loaded = eig3.load(tmp_path, rhs=oscillator, **FUNCTIONS)
    assert "part-000000000128.npz is damaged" in loaded.notes[-1]
    assert (loaded.status == eig3.Status.INTERRUPTED).sum() == 128
    for each in (loaded, whole):
        path.write_bytes(content)
        started.clear()
        assert_same(each.resume(), whole, SAME)
        assert started == [128]


def test_a_directory_has_the_notes_and_the_seconds_of_its_parts(tmp_path):
    whole = run("one at a time", save_to=tmp_path, threads=1)
    loaded = eig3.load(tmp_path)
    assert "run one at a time" in whole.notes[0]
    assert (loaded.notes, loaded.kernel_seconds) == (whole.notes, whole.kernel_seconds)


def test_ensembles_of_problems_go_on(tmp_path, started):
    """Named parameters, first-order unknowns, events, and the energy less the work come from the problem."""
    duffing = eig3.problems.duffing()
    stiffness = 40 * np.array([[2.0, -1.0], [-1.0, 1.0]])
    links = [(ElasticPlastic(40.0, 0.5), 0, 1)]
    yielding = eig3.linear(np.ones(2), None, stiffness, links=links, work=True, u0=[0.1, 0.0], t_span=(0, 2))
    cases = {
        "duffing": (duffing, {"h": 0.05, "t_end": 5.0, "u0": np.linspace(0, 1, 300)}),
        "yielding": (yielding, {"h": 1e-2, "v0": np.multiply.outer(np.linspace(0, 1, 300), [1.0, 0.0])}),
    }
    for name, (problem, options) in cases.items():
        whole = problem.ensemble(**options)
        place = tmp_path / name
        problem.ensemble(**options, save_to=place, cancel=After(6))
        held = finished(place)
        started.clear()
        again = problem.load(place).resume()
        assert started
        assert not set(held) & set(started)
        assert_same(again, whole, SAME)


class Counted(ThreadPoolExecutor):
    """Counts the parts that it gets."""

    count = 0

    def submit(self, *arguments):
        self.count += 1
        return super().submit(*arguments)


def interrupted(place, executor):
    """Run with an executor until the first part is in the directory, and return the finished parts."""

    class Written:
        def is_set(self):
            return bool([*place.glob("part-*.npz")])

    run(save_to=place, executor=executor, cancel=Written())
    return finished(place)


def test_threads_get_the_parts_that_are_missing(tmp_path):
    with Counted(1) as executor:
        held = interrupted(tmp_path, executor)
        assert held
        executor.count = 0
        assert_same(run(save_to=tmp_path, executor=executor), run(), SAME)
        assert executor.count == 3 - len(held)


@pytest.mark.system
@pytest.mark.parametrize("kind", ["processes", "dask"])
def test_workers_get_the_parts_that_are_missing(kind, tmp_path, monkeypatch):
    options = {"n_workers": 1, "threads_per_worker": 1, "processes": True, "dashboard_address": ":0"}
    if kind == "processes":
        pool = ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"))
        with pool as executor:
            goes_on(executor, tmp_path, monkeypatch)
    else:
        with LocalCluster(**options) as cluster, Client(cluster) as client:
            goes_on(client.get_executor(), tmp_path, monkeypatch)


def goes_on(executor, place, monkeypatch):
    held, submit, parts_sent = interrupted(place, executor), executor.submit, []
    assert held

    def noted(function, march, reduce, part, *rest):
        parts_sent.append(part.first)
        return submit(function, march, reduce, part, *rest)

    monkeypatch.setattr(executor, "submit", noted)
    loaded = eig3.load(place, rhs=oscillator, **FUNCTIONS)
    assert_same(loaded.resume(executor=executor), run(), SAME)
    assert sorted(held + parts_sent) == [0, 128, 256]
