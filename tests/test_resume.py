"""Runs that go on after they were loaded: with fixed steps every bit is that of one run over the whole span."""

import subprocess
import sys
import textwrap
import time

import numpy as np
import pytest

import eig3
from eig3.stepping import observer

from .conftest import SAME, assert_same, bounce, coupled, energy, oscillator, position
from .going_on import SCALAR, SCALAR_WITHOUT_V, VECTOR, VECTOR_WITHOUT_V, H, forces, steady

fast = eig3.jit(lambda t, u, v, p: v - 0.5)


@eig3.jit
def rub(t, u, v, p, a):
    """Dampers for which fixed-point iteration does not converge with steps of 0.1."""
    for j in range(3):
        a[j] = -u[j] - (25 if t > 2 else 0.5) * v[j]


@eig3.jit
def rub_derivative(t, u, v, p, J):
    for j in range(3):
        J[j, j] = -25 if t > 2 else -0.5


FUNCTIONS = {"invariants": {"energy": energy}, "outputs": {"forces": (forces, 2), "energy / kg": energy}}
EVENTS = {"wall": eig3.Event(position, direction=-1, apply=bounce), "fast": eig3.Event(fast)}


def integrate(system, t_end, **options):
    start = system["rhs"], (1.0, t_end), system["u0"], system["v0"]
    if "rtol" not in options:
        options = {"h": H, **options}
    return eig3.integrate(*start, params=system["params"], **options)


def both_ways(tmp_path, system, t_end, **options):
    """Return where a run is saved: in a file, and in a directory while it runs."""
    yield integrate(system, t_end, **options).save(tmp_path / "file.npz")
    integrate(system, t_end, **options, save_to=tmp_path / "directory")
    yield tmp_path / "directory"


@pytest.mark.parametrize(
    ("form", "method"),  # what a file keeps of a form does not depend on the method
    [("scalar", method) for method in ("eig3", "ab3", "bm6")]
    + [("vector", method) for method in ("cd", "ab3", "eig9", "rk4")],
)
def test_a_loaded_run_goes_on_as_one_run(form, method, tmp_path):
    system = SCALAR if form == "scalar" else VECTOR
    if method == "bm6":
        system = SCALAR_WITHOUT_V if form == "scalar" else VECTOR_WITHOUT_V
    options = {"method": method, "save_every": 7}
    functions = FUNCTIONS if form == "scalar" and method in ("eig3", "ab3") else {}
    whole = integrate(system, 1.0 + 200 * H, **options, **functions)
    # Ends in the first steps, which another method may take, and between and at the rows of save_every.
    for path in both_ways(tmp_path, system, 1.0 + 3 * H, **options, **functions):
        loaded = eig3.load(path, rhs=system["rhs"], **functions)
        assert_same(loaded.extend(1.0 + 200 * H), whole)
        second = loaded.extend(1.0 + 70 * H).save(tmp_path / "second")
        assert_same(eig3.load(second, rhs=system["rhs"], **functions).extend(1.0 + 200 * H), whole)
        np.testing.assert_array_equal(loaded.a, integrate(system, 1.0 + 3 * H, **options).a)
    third = eig3.load(second, rhs=system["rhs"], **functions).extend(1.0 + 126 * H, save_to=tmp_path / "third")
    assert_same(eig3.load(tmp_path / "third", rhs=system["rhs"], **functions), third)
    assert_same(eig3.load(tmp_path / "third", rhs=system["rhs"], **functions).extend(1.0 + 200 * H), whole)


@pytest.mark.parametrize("options", [{"method": "eig3"}, {"method": "ab3", "save_every": None}, {"inline": True}])
def test_events_go_on(options, tmp_path):
    options = {**options, **FUNCTIONS, "events": EVENTS}
    functions = {name: options[name] for name in ("events", "invariants", "outputs")}
    functions["events"] = dict(reversed(EVENTS.items()))  # their order does not matter
    whole = integrate(SCALAR, 1.0 + 1000 * H, **options)
    assert_same(integrate(SCALAR, 1.0 + 300 * H, **options).extend(1.0 + 1000 * H), whole)
    for path in both_ways(tmp_path, SCALAR, 1.0 + 300 * H, **options):
        loaded = eig3.load(path, rhs=oscillator, **functions)
        assert 1 < len(loaded.events["wall"]) < len(whole.events["wall"])
        assert_same(loaded.extend(1.0 + 1000 * H), whole)


@pytest.mark.parametrize("method", ["rk5", "rk8", "eig3"])
@pytest.mark.parametrize("options", [{"events": EVENTS, **FUNCTIONS}, {"save_every": 7}], ids=["events", "save_every"])
def test_tolerances_go_on_from_the_last_step(method, options, tmp_path):
    """The numbers are those of `extend` in the process of the run."""
    options = {**options, "rtol": 1e-6, "method": method}
    functions = {name: options[name] for name in ("events", "invariants", "outputs") if name in options}
    first = integrate(SCALAR, 11.0, **options)
    extended = first.extend(31.0)
    for path in both_ways(tmp_path, SCALAR, 11.0, **options):
        loaded = eig3.load(path, rhs=oscillator, **functions)
        assert_same(loaded, first)
        if "save_every" not in options:  # otherwise the states are too far apart
            np.testing.assert_array_equal(loaded.at(5.55), first.at(5.55))
        with pytest.raises(ValueError, match=r"t_end must be after the end of the run at t = 11\.0"):
            loaded.extend(11.0)
        assert_same(loaded.extend(31.0), extended)
        again = loaded.extend(21.0).save(tmp_path / "again")
        assert_same(eig3.load(again, rhs=oscillator, **functions).extend(31.0), first.extend(21.0).extend(31.0))


class After:
    """A cancellation after so many looks at it."""

    def __init__(self, looks):
        self.left = looks

    def is_set(self):
        self.left -= 1
        return self.left < 0


@pytest.mark.parametrize("options", [{}, {"rtol": 1e-5}], ids=["fixed", "tolerances"])
def test_an_interrupted_run_goes_on_from_anywhere(options, tmp_path, monkeypatch):
    """The log of events has so little room that calls of the kernel end within steps, which costs evaluations."""
    names = {*SAME, "notes"} - {"n_rhs", "n_iterations"}
    monkeypatch.setattr("eig3.stepping.slices._SECONDS", 1e-7)
    monkeypatch.setattr("eig3.stepping.slices._FIRST_SECONDS", 1e-7)
    monkeypatch.setattr(observer, "_LOG_ROWS", 2)
    monkeypatch.setattr(observer, "_LOG_VALUES", 0)
    monkeypatch.setattr("eig3.run.saved_rows.FIRST_ROWS", 2)
    options = {**options, "events": EVENTS, "outputs": {"energy": energy}}
    if "rtol" not in options:
        options["h"] = 0.5
    whole = integrate(SCALAR, 41.0, **options)
    steps = set()
    for looks in range(2, 12):
        directory = tmp_path / str(looks)
        stopped = integrate(SCALAR, 41.0, **options, cancel=After(looks), save_to=directory)
        if stopped.status is eig3.Status.INTERRUPTED:
            steps.add(stopped.n_steps)
            path = directory if looks % 2 else stopped.save(tmp_path / "run")
            loaded = eig3.load(path, rhs=oscillator, events=EVENTS, outputs={"energy": energy})
            assert_same(loaded.extend(41.0), whole, names)
            assert_same(stopped.extend(41.0), whole, names)
    assert len(steps) > 3


@pytest.mark.parametrize("is_loaded", [False, True])
@pytest.mark.parametrize("ends", [(30.0,), (21.0, 40.0), (199.0,), (3.0, 5.0, 9.0, 17.0, 33.0)])
def test_a_steady_growth_is_noted_over_the_whole_span(ends, is_loaded, tmp_path):
    # A harmonic motion, so that velocities change their sign, and a quantity that grows by 200 over the run.
    options = {"invariants": {"e": steady}}
    run = integrate(SCALAR | {"params": (2.0, 0.0)}, ends[0], **options)
    for t_end in (*ends[1:], 201.0):
        run = eig3.load(run.save(tmp_path / "run"), rhs=oscillator, **options) if is_loaded else run
        run = run.extend(t_end)
    whole = integrate(SCALAR | {"params": (2.0, 0.0)}, 201.0, **options)
    assert len(whole.notes) == 1
    assert run.notes == whole.notes


def test_a_blow_up_is_judged_over_the_whole_span(tmp_path):
    # omega h = 2.1 is beyond the limit 2: the motion grows by 1.88 in a step, to 2e4 times its size in 15 steps.
    system, options = SCALAR | {"params": (1.0, 0.0)}, {"h": 2.1, "method": "cd"}
    whole = integrate(system, 1.0 + 2.1 * 100, **options)
    for steps in (5, 11):
        first = integrate(system, 1.0 + 2.1 * steps, **options)
        assert first.success
        loaded = eig3.load(first.save(tmp_path / "run"), rhs=oscillator)
        extended = loaded.extend(1.0 + 2.1 * 100)
        assert whole.status is extended.status is eig3.Status.DIVERGED
        assert extended.message == first.extend(1.0 + 2.1 * 100).message
    with pytest.raises(ValueError, match="DIVERGED cannot be extended"):
        extended.extend(1000.0)
    with pytest.raises(ValueError, match="this run cannot be continued: its status is DIVERGED"):
        eig3.load(extended.save(tmp_path / "run"), rhs=oscillator)


def test_a_solver_that_was_changed_stays_changed(tmp_path):
    system = {"rhs": rub, "u0": [1.0, 2.0, 3.0], "v0": [0.0] * 3, "params": ()}
    whole = integrate(system, 6.0, method="cd", h=0.1)
    assert "From t = " in whole.notes[0]
    for t_end in (2.0, 4.0):
        path = integrate(system, t_end, method="cd", h=0.1).save(tmp_path / "run")
        assert_same(eig3.load(path, rhs=rub).extend(6.0), whole)


def test_the_jacobian_of_the_method_is_given_again(tmp_path):
    system = {"rhs": rub, "u0": [1.0, 2.0, 3.0], "v0": [0.0] * 3, "params": ()}
    method = eig3.CentralDifference(jacobian=rub_derivative)
    whole = integrate(system, 6.0, method=method, h=0.1)
    path = integrate(system, 4.0, method=method, h=0.1).save(tmp_path / "run")
    with pytest.raises(ValueError, match="the method of the run has a jacobian: give jacobian"):
        eig3.load(path, rhs=rub)
    assert_same(eig3.load(path, rhs=rub, jacobian=rub_derivative).extend(6.0), whole)


far = eig3.jit(lambda t, u, v, p: u[0] - 1e-4)


@eig3.jit
def brake(t, u, v, p):
    v[0] *= 0.5


def test_problems_with_integrals_and_events_go_on(tmp_path):
    problem = eig3.problems.shear_building(work=True)
    options = {"h": 2.0**-10, "events": {"far": eig3.Event(far, apply=brake)}}
    whole = problem.integrate(**options, t_end=0.25)
    first = problem.integrate(**options, t_end=0.125)
    assert len(first.events["far"].jumps) > 0
    assert_same(first.extend(0.1875).extend(0.25), whole)
    problem.integrate(**options, t_end=0.125, save_to=tmp_path / "directory")
    for path in (first.save(tmp_path / "file"), tmp_path / "directory"):
        loaded = problem.load(path, events=options["events"])
        assert_same(loaded, first)
        assert_same(loaded.extend(0.1875).extend(0.25), whole)
        extended = loaded.extend(0.1875, save_to=tmp_path / f"to {path.name}")
        again = problem.load(tmp_path / f"to {path.name}", events=options["events"])
        assert_same(again, extended)
        assert_same(again.extend(0.25), whole)
    with pytest.raises(ValueError, match="which is not one of bouncing_ball"):
        eig3.problems.bouncing_ball().load(path)


def test_problems_with_events_go_on(tmp_path):
    problem = eig3.problems.bouncing_ball()
    end = problem.t_span[1]
    first = problem.integrate(rtol=1e-6, t_end=end / 2)
    loaded = problem.load(first.save(tmp_path / "run"))
    assert_same(loaded.extend(end), first.extend(end))
    assert loaded.extend(end).labels == problem.labels


# Processes that are killed -------------------------------------------------------------------------------------------

KILLED = """
    import sys
    import eig3

    @eig3.jit
    def rhs(t, u, v, p, a):
        for j in range(u.size):
            a[j] = -p[j] * u[j]

    @eig3.jit
    def energy(t, u, v, p):
        return (p[0] * u[0] * u[0] + v[0] * v[0]) / 2

    @eig3.jit
    def forces(t, u, v, p, out):
        out[0], out[1] = p[0] * u[0], p[1] * u[1]

    @eig3.jit
    def crossing(t, u, v, p):
        return u[0] - 0.25

    @eig3.jit
    def kick(t, u, v, p):
        v[1] = -v[1]

    functions = {
        "events": {"kick": eig3.Event(crossing, direction=1, apply=kick)},
        "invariants": {"energy": energy},
        "outputs": {"forces": (forces, 2)},
    }
    start = [1.0, 2.0], [0.0, 0.0]
    fixed = {"h": 2.0**-6, "save_every": 100}
    tolerances = {"rtol": 1e-6, "save_every": 10}

    if __name__ == "__main__":
        kind = {"fixed": fixed, "tolerances": tolerances}[sys.argv[1]]
        eig3.integrate(rhs, (0.0, 1e7), *start, params=(1.0, 2.0), **kind, **functions, save_to=sys.argv[2])
"""


@pytest.mark.system
@pytest.mark.parametrize("kind", ["fixed", "tolerances"])
def test_a_killed_run_is_there_and_goes_on(kind, tmp_path):
    script = tmp_path / "killed.py"
    script.write_text(textwrap.dedent(KILLED))
    directory = tmp_path / "run"
    process = subprocess.Popen([sys.executable, script, kind, directory])
    try:
        while not (directory / "run.npz").exists() or len(eig3.load(directory).events["kick"]) <= 10:
            assert process.poll() is None
            time.sleep(0.01)
    finally:
        process.kill()
        process.wait()
    names: dict = {}
    exec(script.read_text(), names)
    functions, rhs = names["functions"], names["rhs"]
    killed = eig3.load(directory)
    assert killed.status is eig3.Status.INTERRUPTED
    assert killed.message.startswith(f"The process of this run was killed after t = {killed.t[-1]:g},")
    end = killed.t[-1] + 1000 * names["fixed"]["h"] if kind == "tolerances" else (killed.n_steps + 1000) / 64
    loaded = eig3.load(directory, rhs=rhs, **functions)
    extended = loaded.extend(end)
    options = {"params": (1.0, 2.0), **names[kind], **functions}
    whole = eig3.integrate(rhs, (0.0, end), [1.0, 2.0], [0.0, 0.0], **options)
    assert_same(extended, whole)
    rows, found = len(killed.t), len(killed.events["kick"])
    for name in ("t", "u", "v"):
        np.testing.assert_array_equal(getattr(killed, name), getattr(whole, name)[:rows])
        np.testing.assert_array_equal(getattr(killed.events["kick"], name), getattr(whole.events["kick"], name)[:found])
    np.testing.assert_array_equal(killed.outputs["forces"], whole.outputs["forces"][:rows])
    np.testing.assert_array_equal(killed.outputs["forces"], killed.u * [1.0, 2.0])
    up_to = np.nextafter(end, 0) if kind == "tolerances" else killed.n_steps / 64
    if kind == "fixed":
        assert rows == killed.n_steps // 100 + 1
        part = eig3.integrate(rhs, (0.0, up_to), [1.0, 2.0], [0.0, 0.0], **options)
        assert (killed.n_steps, killed.n_rhs, killed.drift) == (part.n_steps, part.n_rhs, part.drift)
        np.testing.assert_equal(killed.extremes, part.extremes)
    assert 0 < killed.drift["energy"] <= whole.drift["energy"]


# What does not go on -------------------------------------------------------------------------------------------------


def test_functions_of_another_run_are_refused(tmp_path):
    options = {**FUNCTIONS, "events": EVENTS}
    path = integrate(SCALAR, 2.0, **options).save(tmp_path / "run")
    with pytest.raises(
        ValueError, match=r"loaded without its right-hand side: load it with eig3\.load\(path, rhs=\.\.\.\)"
    ):
        eig3.load(path).extend(3.0)
    again = eig3.load(path).save(tmp_path / "again")  # the state is kept
    assert eig3.load(again, rhs=oscillator, **options).extend(3.0).success
    bad = [
        ({}, "events must have the same names as in the run: 'wall', 'fast'"),
        ({**options, "events": {**EVENTS, "more": EVENTS["fast"]}}, "events must have the same names"),
        ({"events": EVENTS}, "invariants must have the same names as in the run: 'energy'"),
        (
            {**options, "outputs": {"forces": (forces, 2)}},
            "outputs must have the same names .* 'forces', 'energy / kg'",
        ),
        ({**options, "jacobian": oscillator}, "the run has none: leave out jacobian"),
    ]
    for functions, message in bad:
        with pytest.raises(ValueError, match=message):
            eig3.load(path, rhs=oscillator, **functions)
    with pytest.raises(ValueError, match="outputs needs rhs too"):
        eig3.load(path, outputs=FUNCTIONS["outputs"])
    with pytest.raises(TypeError, match="rhs must be compiled"):
        eig3.load(path, rhs=oscillator.py_func, **options)
    with pytest.raises(TypeError, match="rhs has the vector form"):
        eig3.load(path, rhs=coupled, **options)
    wider = {**options, "outputs": {**FUNCTIONS["outputs"], "forces": energy}}
    with pytest.raises(ValueError, match="give the functions of the run"):
        eig3.load(path, rhs=oscillator, **wider)


def test_runs_without_a_state_are_loaded_without_functions(tmp_path):
    member = eig3.ensemble(oscillator, (0, 1), [1.0, 2.0], 0.0, h=0.1, params=[[2.0, 0.1]])[1]
    path = member.save(tmp_path / "run")
    with pytest.raises(ValueError, match=r"this run cannot be continued: it is a copy, .*load it without functions"):
        eig3.load(path, rhs=oscillator)
    with pytest.raises(ValueError, match="this solution cannot be extended"):
        eig3.load(path).extend(3.0)
