"""Solutions as tables of pandas and as datasets of xarray."""

import dataclasses
import pickle
import sys

import numpy as np
import pytest
import xarray

import eig3
from eig3.animation.look import Look
from eig3.effects import LinearDamper, LinearSpring, Rod
from eig3.result.occurrences import Occurrences
from eig3.scene import Scene

from .conftest import coupled, oscillator, position
from .test_constraint_lanes import G, double_pendulum


@eig3.jit
def ends(t, u, v, p, out):
    out[0], out[1] = u[0], u[-1]


first_speed = eig3.jit(lambda t, u, v, p: v[0])


def with_outputs(run, **outputs):
    return dataclasses.replace(run, outputs=outputs)


def test_a_table_and_a_dataset_have_the_names_and_units_of_a_scene():
    """Two masses in a plane with a damper, so that the work is followed."""
    scene = Scene(dimension=2)
    pivot, masses = scene.fixed((0, 0)), scene.mass([1.0, 2.0], [(1, 0), (2, 0)])
    scene.add(LinearSpring(stiffness=100.0, rest_length=1.0), pivot, masses[0])
    scene.add(LinearDamper(1.0), masses[0], masses[1])
    run = scene.problem((0, 0.1), work=True).integrate(h=1e-2, invariants={})
    run = with_outputs(run, peak=run.u[:, 0] ** 2, reaction=run.u[:, :2])
    table, data = run.to_pandas(), run.to_xarray()
    names, velocities = ["x0", "x1", "y0", "y1"], ["v_x0", "v_x1", "v_y0", "v_y1"]
    assert list(table.columns) == [*names, *velocities, "peak", "reaction[0]", "reaction[1]", "work"]
    assert table.index.name == "t"
    for given, wanted in ((table.index, run.t), (table[names], run.u), (table[velocities], run.v)):
        np.testing.assert_array_equal(given, wanted)
    np.testing.assert_array_equal(table["reaction[1]"], run.u[:, 1])
    np.testing.assert_array_equal(table["work"], run.z["work"])
    expected = {"status": "completed", "message": run.message, "method": repr(run.method), "h": run.h}
    assert table.attrs["units"] == dict.fromkeys(names, "m") | dict.fromkeys(velocities, "m/s")
    assert table.attrs == expected | {"units": table.attrs["units"]}
    assert data.u.dims == data.v.dims == ("t", "dof")
    for given, wanted in ((data.t, run.t), (data.u.sel(dof="y1"), run.u[:, 3]), (data.v, run.v)):
        np.testing.assert_array_equal(given, wanted)
    np.testing.assert_array_equal(data.work, run.z["work"])
    assert data.peak.dims == data.work.dims == ("t",)
    assert data.reaction.dims == ("t", "reaction component")
    assert (data.u.attrs["units"], data.v.attrs["units"]) == ("m", "m/s")
    assert data.attrs == expected


def test_units_of_each_degree_of_freedom():
    run = eig3.problems.spring_pendulum().integrate(h=1e-2, t_end=0.1, invariants={})
    assert run.to_pandas().attrs["units"] == {"u0": "m", "u1": "rad", "v0": "m/s", "v1": "rad/s"}
    assert (list(run.to_xarray()["unit_of_v"]), list(run.to_xarray().dof)) == (["m/s", "rad/s"], [0, 1])


def test_units_that_differ_are_kept_in_a_netcdf_file_of_scipy(tmp_path):
    run = eig3.problems.spring_pendulum().integrate(h=1e-2, t_end=0.1, invariants={})
    run.to_xarray().to_netcdf(tmp_path / "run.nc", engine="scipy")
    read = xarray.load_dataset(tmp_path / "run.nc", engine="scipy")
    assert list(read["unit_of_u"]) == ["m", "rad"]
    np.testing.assert_array_equal(read.v, run.v)


def test_the_unit_of_a_velocity():
    """A minus sign in a unit is an exponent, and only a minus sign alone is a dimensionless number."""
    labels = eig3.problems.spring_pendulum().with_(units=("-", "N m-1")).labels
    assert [labels.unit("v", i) for i in range(2)] == ["1/s", "N m-1/s"]


def test_a_run_without_a_problem_has_plain_names_and_no_units():
    scalar = eig3.integrate(oscillator, (0, 1), 1.0, 0.0, h=0.1, params=(2.0, 0.1))
    vector = eig3.integrate(coupled, (0, 1), [1.0, 2.0, 3.0], [0.0] * 3, h=0.1, params=(1, 2, 3))
    assert list(scalar.to_pandas().columns) == ["u0", "v0"]
    assert list(vector.to_pandas().columns) == ["u0", "u1", "u2", "v0", "v1", "v2"]
    assert scalar.to_pandas().attrs["units"] == {}
    assert scalar.to_xarray().u.dims == ("t",)
    assert vector.to_xarray().u.dims == ("t", "dof")
    assert vector.to_xarray().u.attrs == {}


def test_an_ensemble_is_a_dataset_over_its_members():
    problem = eig3.problems.spring_pendulum()
    u0 = np.array([[1.0, 0.1], [1.1, 0.2], [1.2, 0.3]])
    options = {"u0": u0, "t_end": 0.5, "save_every": 5, "invariants": {}}
    together = problem.ensemble(h=1e-2, **options)
    data = together.to_xarray()
    assert data.u.dims == ("member", "t", "dof")
    np.testing.assert_array_equal(data.v.sel(member=1), together[1].v)
    np.testing.assert_array_equal(data.t, together[0].t)
    assert list(data["unit_of_u"]) == ["m", "rad"]
    assert data.status.values.tolist() == ["completed"] * 3
    assert together[1].to_pandas().attrs["units"]["v1"] == "rad/s"

    steps = problem.ensemble(h=[1e-2, 2e-2, 5e-2], **options)
    data = steps.to_xarray()
    assert data.u.dims == ("member", "row", "dof")
    np.testing.assert_array_equal(data.t.sel(member=1), steps.t[1])
    np.testing.assert_array_equal(data.n_steps, [50, 25, 10])


def test_names_that_clash_are_refused():
    run = eig3.integrate(oscillator, (0, 1), 1.0, 0.0, h=0.1, params=(2.0, 0.1))
    with pytest.raises(ValueError, match="u0 is the name of two columns"):
        with_outputs(run, u0=run.u).to_pandas()
    for name in ("u", "t"):
        with pytest.raises(ValueError, match=f"{name} is the name of two columns"):
            with_outputs(run, **{name: run.u}).to_xarray()


def test_the_values_of_an_output_have_the_names_of_its_joints(tmp_path):
    """Each rod of a double pendulum at rest bears the weight below it: in a run, a file, a dataset and members."""
    problem = double_pendulum().with_(u0=[0.0, 0.0, -0.4, -0.9], v0=np.zeros(4), t_span=(0, 0.1))
    assert problem.outputs["reactions"][1] == ("rod 0", "rod 1")
    run = problem.integrate(h=1e-2, outputs=problem.outputs)
    assert abs(run.to_pandas()["reactions[rod 1]"].iloc[-1]) == pytest.approx(0.5 * G)
    assert abs(run.to_xarray().reactions.sel({"reactions component": "rod 0"})[-1]) == pytest.approx(1.5 * G)
    still = {"v0": np.zeros((80, 4)), "h": np.full(80, 1e-2)}  # in the loops of other double pendulums
    path, runs = run.save(tmp_path / "run"), problem.ensemble(**still, outputs=problem.outputs)
    longer = problem.load(path, outputs=problem.outputs).extend(0.2)
    for table in (eig3.load(path).to_pandas(), longer.to_pandas(), runs.to_pandas()):
        assert list(table.columns[-2:]) == ["reactions[rod 0]", "reactions[rod 1]"]
    assert "peak of reactions[rod 1]" in runs.summary()


def test_names_of_values_without_a_problem():
    options = {"h": 0.1, "params": (1, 2, 3)}
    run = eig3.integrate(
        coupled, (0, 1), np.ones(3), np.zeros(3), outputs={"both": (ends, ("left", "right"))}, **options
    )
    assert list(run.to_pandas().columns[-2:]) == ["both[left]", "both[right]"]
    assert run.to_pandas().attrs["units"] == run.to_xarray().u.attrs == {}
    with pytest.raises(ValueError, match=r"outputs\['both'\] = \(function, names\) must have a different text"):
        eig3.integrate(coupled, (0, 1), np.ones(3), np.zeros(3), outputs={"both": (ends, ("left",) * 2)}, **options)


def test_names_and_units_must_be_as_many_as_the_degrees_of_freedom():
    problem, options = eig3.problems.spring_pendulum(), {"h": 1e-2, "t_end": 0.1, "invariants": {}}
    for changes in ({"names": ("r",)}, {"units": ("m", "rad", "m")}):
        with pytest.raises(ValueError, match="must have a text for each of 2 degrees of freedom"):
            problem.with_(**changes)
    named = problem.with_(names=("r", "theta")).integrate(**options)
    assert list(named.to_pandas().columns) == ["r", "theta", "v_r", "v_theta"]


@pytest.mark.parametrize("module", ["pandas", "xarray"])
def test_without_the_extra_the_error_says_what_to_install(module, monkeypatch):
    monkeypatch.setitem(sys.modules, module, None)
    run = eig3.integrate(oscillator, (0, 1), 1.0, 0.0, h=0.1, params=(2.0, 0.1))
    with pytest.raises(ImportError, match=rf"pip install 'eig3\[{module}\]'"):
        getattr(run, f"to_{module}")()


def test_a_table_of_members_has_their_states_without_a_solution_for_each(monkeypatch):
    """Members that end early, and one whose last state is not one to save."""
    params = np.array([[1.0, 0.0], [2e4, 0.0], [2.0, 0.0]])
    runs = eig3.ensemble(oscillator, (0, 1), np.ones(3), 0.0, h=0.01, params=params, save_every=7)
    t, u, v = (np.concatenate([getattr(one, name) for one in runs]) for name in ("t", "u", "v"))
    member = np.repeat(np.arange(3), [len(one.t) for one in runs])
    assert runs._last
    monkeypatch.setattr(eig3.EnsembleSolution, "__getitem__", None)
    table = runs.to_pandas()
    assert list(table.columns) == ["member", "t", "u0", "v0"]
    for name, values in (("member", member), ("t", t), ("u0", u), ("v0", v)):
        np.testing.assert_array_equal(table[name], values)


def test_a_table_has_the_last_states_of_members_that_fail_in_lanes_and_alone():
    """A member of AB3 runs alone if an event resets its state: here the members that start below 1."""
    growing, above = eig3.jit(lambda t, u, v, p: u**3), eig3.jit(lambda t, u, v, p: u - 1.0)
    events = {"above": eig3.Event(above, apply=eig3.jit(lambda t, u, v, p: (u, v)))}
    members = eig3.ensemble(growing, (0, 10), np.linspace(0.5, 1.5, 32), 1.0, h=0.01, method="ab3", events=events)
    assert not members.success.any()
    last = members.to_pandas().groupby("member").last()
    assert np.array_equal(last["t"], [each.t[-1] for each in members])
    assert np.array_equal(last["u0"], [each.u[-1] for each in members])


spring_with_a_height = eig3.jit(lambda t, u, v, p: -p.h * u - p.c[1] * v)


def test_a_summary_has_a_row_for_each_member_and_a_dataset_their_parameters():
    """A parameter has a prefix if its name is that of a variable, such as the step h."""
    start = {"h": 1.0, "c": [9.0, 0.0], "ends": [-1, 2]}  # as a float, -1 is NaN
    problem = eig3.Problem("named", spring_with_a_height, 1.0, 0.0, start, (0.0, 10.0))
    crossing = eig3.Event(position, direction=-1)
    options = {"h": 0.01, "save_every": 7, "events": {"down": crossing}, "outputs": {"height": position}}
    changes = {"h": [1.0, 4.0, 0.01], "c": [[9.0, 0.0], [9.0, 0.1], [9.0, 0.2]], "ends": [[-1, 2], [-1, 3], [-1, -4]]}
    runs = problem.ensemble(params=changes, **options)
    table, data = runs.summary(), runs.to_xarray()
    np.testing.assert_array_equal(runs.to_pandas()["height"], np.concatenate([one.outputs["height"] for one in runs]))
    assert list(table.index) == [0, 1, 2]
    assert list(table.columns[:3]) == ["p.h", "c[1]", "ends[1]"]  # the others are the same in all members
    assert list(table["p.h"]) == [1.0, 4.0, 0.01]
    assert list(table["ends[1]"]) == [2, 3, -4]
    assert list(table["status"]) == ["completed"] * 3
    assert list(table["count of down"]) == data["count of down"].values.tolist() == [2, 3, 0]
    for i, run in enumerate(runs):
        row = table.loc[i]
        assert (row["t"], row["u0"], row["v0"]) == (run.t[-1], run.u[-1], run.v[-1])
        assert (row["h"], row["n_steps"], row["n_rhs"]) == (run.h, run.n_steps, run.n_rhs)
        assert row["minimum of height"] == run.extremes["height"].low
        assert row["time of maximum of height"] == run.extremes["height"].t_high
    for first in (table["first down"], data["first down"]):
        np.testing.assert_array_equal(first, runs.events["down"].first)
    assert np.isnan(table["first down"][2])
    down = runs.events["down"].to_pandas()
    assert down.member.tolist() == [0, 0, 1, 1, 1]
    np.testing.assert_array_equal(down.t[:2], runs[0].events["down"].t)
    assert data.coords.keys() == {"member", "t", "p.h", "c[1]", "ends[1]"}
    np.testing.assert_array_equal(data.u.where(data["p.h"] > 3, drop=True)[0], runs.u[1])


def test_a_member_without_states_has_no_last_state_in_a_summary():
    """With omega = 1e4 rad/s, h is far beyond 2 / omega, so the members end before the only saved time."""
    params = [[-1e4, 0.0], [1.0, 0.0], [-1e4, 0.0]]
    runs = eig3.ensemble(oscillator, (0, 10), 1.0, 0.0, h=1e-2, params=params, t_eval=[9.0])
    table = runs.summary()
    assert table["status"].tolist() == ["diverged", "completed", "diverged"]
    for name, values in (("t", [np.nan, 9.0, np.nan]), ("u0", [np.nan, runs.u[1, 0], np.nan])):
        np.testing.assert_array_equal(table[name], values)
    alone = eig3.ensemble(oscillator, (0, 10), 1.0, 0.0, h=1e-2, params=params[:1], t_eval=[9.0])
    assert alone.summary().t.isna().all()


def test_a_summary_without_names_numbers_the_parameters():
    params = [[1.0, 0.1, 0.0, 0.0], [1.0, 0.2, 0.0, 0.0]]
    table = eig3.ensemble(oscillator, (0, 1), 1.0, 0.0, params=params, h=0.1).summary()
    assert list(table.columns) == ["p[1]", "status", "h", "n_steps", "n_rhs", "t", "u0", "v0"]
    assert list(table["p[1]"]) == [0.1, 0.2]
    table = eig3.ensemble(coupled, (0, 1), [[1.0, 0, 0], [2.0, 0, 0]], np.zeros(3), params=[1.0, 2, 3], h=0.1).summary()
    assert list(table.columns) == ["status", "h", "n_steps", "n_rhs", "t", "u0", "u1", "u2", "v0", "v1", "v2"]


def test_the_occurrences_of_an_event_as_a_table():
    """Columns have the names of a solution's table; a scalar form has one degree of freedom."""
    for n, shape in ((1, (4,)), (3, (4, 3))):
        states = np.random.default_rng(n).normal(size=(4, *shape))
        table = Occurrences(np.arange(4.0), *states).to_pandas()
        names = [f"{x}{k}{after}" for after in ("", "_after") for x in "uv" for k in range(n)]
        assert list(table.columns) == ["t", *names]
        np.testing.assert_array_equal(table.t, np.arange(4.0))
        np.testing.assert_array_equal(table[names], np.hstack(states.reshape(4, 4, n)))


def test_a_table_of_occurrences_has_the_columns_of_the_run(tmp_path):
    """A member of an ensemble, a copy and a file keep the names and the units."""
    problem = eig3.problems.spring_pendulum().with_(events={"down": eig3.Event(first_speed)})
    solution, members = problem.integrate(h=0.01, t_end=5.0), problem.ensemble(h=[0.01, 0.02], t_end=5.0)
    table = solution.to_pandas()
    loaded = eig3.load(solution.save(tmp_path / "run")), eig3.load(members.save(tmp_path / "members"))
    runs = solution, members, members[1], *loaded, loaded[1][1], pickle.loads(pickle.dumps(solution))
    for found in (run.events["down"].to_pandas() for run in runs):
        columns = [name for name in found.columns if name not in ("t", "member")]
        assert columns == [*table.columns, *(f"{name}_after" for name in table.columns)]
        assert {name: found.attrs["units"][name] for name in table.columns} == table.attrs["units"]


def test_reactions_have_units(tmp_path):
    """A rod and the joint of a body react by forces; vectors of a body and an angle that is held by torques."""
    scene = Scene(dimension=2)
    pivot, bob = scene.fixed((0, 0)), scene.mass(1.0, (0.75, 0))
    scene.add(Rod(), pivot, bob)
    body = scene.body(1.0, 0.1, (2, 0))
    body.revolute(None, (1, 0))
    body.prescribed_angle(None, eig3.jit(lambda t: (t * t, 2 * t, 2.0)))
    problem = scene.problem((0, 0.1))
    units = ["N", "N m", "N m", "N m", "N", "N", "N m"]
    run, members = (
        problem.integrate(h=1e-2, outputs=problem.outputs),
        problem.ensemble(h=[1e-2], outputs=problem.outputs),
    )
    for table in (run.to_pandas(), members.to_pandas()):
        assert [table.attrs["units"][f"reactions[{name}]"] for name in problem.outputs["reactions"][1]] == units
    assert list(run.to_xarray()["unit_of_reactions"].values) == units
    rods = Scene(dimension=2)
    rods.add(Rod(), rods.fixed((0, 0)), rods.mass(1.0, (0.75, 0)))
    rod = rods.problem((0, 0.1))
    swung = rod.integrate(h=1e-2, outputs=rod.outputs)
    assert swung.to_xarray()["reactions"].attrs == {"units": "N"}
    assert Look.of(rod.view, swung, color="reactions").units == {"reactions": "N"}
    assert eig3.load(run.save(tmp_path / "run")).to_pandas().attrs["units"] == run.to_pandas().attrs["units"]


def test_names_that_clash_in_a_table_of_occurrences_are_refused():
    states = np.zeros((4, 2, 1))
    with pytest.raises(ValueError, match="u0 is the name of two columns"):
        Occurrences(np.arange(2.0), *states, {"u0": np.ones(2)}, {"u0": np.ones(2)}).to_pandas()
