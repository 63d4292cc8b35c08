"""`eig3 sweep`: its members are the runs of `Problem.integrate`, and its files and pictures show them."""

import csv
import sys

import numpy as np
import pytest
from matplotlib.figure import Figure

import eig3
from eig3 import Status, problems
from eig3.cli import main
from eig3.command_line import NO_PICTURES
from eig3.sweep import pictures
from eig3.sweep.axes import Axis
from eig3.sweep.measures import Measure
from eig3.sweep.parameters import Parameters
from eig3.sweep.study import Study

from .conftest import falling, position, rebound

ROUND_OFF = 1e-10  # of short regular motions: the lanes fuse other multiply-adds than a single run


def study_of(build, *axes, measures=("end:u0",), random=None, **options):
    """Plan and run a study."""
    parsed = [Axis.parse(text, random=random is not None) for text in axes]
    study = Study.plan(build, parsed, [Measure.parse(text) for text in measures], random=random, **options)
    study.run()
    return study


def arguments(command, *measures, out=None):
    words = ["sweep", *command.split()]
    for measure in measures:
        words += ["--measure", measure]
    return words if out is None else [*words, "--out", str(out)]


def rows_of(folder):
    with (folder / "sweep.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def arrays_of(folder):
    with np.load(folder / "sweep.npz") as file:
        return dict(file)


def test_the_errors_of_measures_are_their_distances_from_the_exact_motion(tmp_path, capsys):
    """Richardson's estimate has a relative error of the size of h: the next order of EIG-3 is 3."""
    measures = ("max:u0", "end:u0", "end:v0")
    command = "single_dof --set omega=3:5:3 --set u0=1:2:2 --h 0.01 --t-end 2 --check"
    assert main(arguments(command, *measures, out=tmp_path)) == 0
    rows = rows_of(tmp_path)
    assert list(rows[0]) == ["omega", "u0", *measures, *(f"error of {name}" for name in measures), "status"]
    for row in rows:
        problem = problems.single_dof(omega=float(row["omega"]), u0=float(row["u0"]))
        for name, exact in zip(measures[1:], problem.exact(2.0), strict=True):
            assert float(row[f"error of {name}"]) == pytest.approx(abs(float(row[name]) - exact), rel=0.1)
    arrays = arrays_of(tmp_path)
    assert arrays["error of end:u0"].shape == arrays["end:u0"].shape == (3, 2)
    line = capsys.readouterr().out.split("end:u0 (m)")[1].split("\n")[0].split()
    assert float(line[3]) == pytest.approx(arrays["error of end:u0"].max(), rel=0.05)  # two digits


def test_a_curve_is_that_of_single_runs(tmp_path, capsys):
    measures = ("max:u0", "min:u1", "end:u1", "drift:energy", "max:energy", "peak:v1-v0")
    command = "spring_pendulum --set k=60:120:5 --h 1e-3 --t-end 2 --method rk4"
    assert main(arguments(command, *measures, out=tmp_path)) == 0
    rows, arrays = rows_of(tmp_path), arrays_of(tmp_path)
    assert list(rows[0]) == ["k", *measures, "status"]
    assert {row["status"] for row in rows} == {"completed"}
    np.testing.assert_array_equal(arrays["k"], np.linspace(60, 120, 5))
    for i, row in enumerate(rows):
        problem = problems.spring_pendulum(k=float(row["k"]), t_end=2.0)
        run = problem.integrate(h=1e-3, method="rk4")
        r, theta = run.u.T
        energy = problem.energy_of(run.u, run.v, run.t)
        expected = [r.max(), theta.min(), theta[-1], np.abs(energy - energy[0]).max(), energy.max()]
        expected.append(np.abs(run.v[:, 1] - run.v[:, 0]).max())
        found = [float(row[name]) for name in measures]
        np.testing.assert_allclose(found, expected, rtol=ROUND_OFF, atol=ROUND_OFF)
        assert [arrays[name][i] for name in measures] == found
    printed = capsys.readouterr().out
    for text in ("k = 60 to 120 N/m, 5 values", "5 members: 5 completed\n", "ns a step and member", "max:u0 (m)"):
        assert text in printed
    assert f"Written to {tmp_path}: sweep.csv, sweep.npz, sweep.png" in printed
    assert (tmp_path / "sweep.png").read_bytes().startswith(b"\x89PNG")


def test_a_grid_of_two_axes_keeps_their_order(tmp_path):
    command = "duffing --set omega=1:2:3 --set u0=-1:1:7 --fix gamma=0.2 --t-end 1 --h 0.01"
    assert main(arguments(command, "end:u", out=tmp_path)) == 0
    arrays = arrays_of(tmp_path)
    assert arrays["end:u"].shape == arrays["status"].shape == (3, 7)
    rows = rows_of(tmp_path)
    assert [(float(row["omega"]), float(row["u0"])) for row in rows] == [
        (omega, u0) for omega in arrays["omega"] for u0 in arrays["u0"]
    ]
    for i, j in ((0, 0), (1, 5), (2, 3)):
        problem = problems.duffing(omega=arrays["omega"][i], u0=arrays["u0"][j], gamma=0.2, t_end=1.0)
        end = problem.integrate(h=0.01).u[-1]
        assert arrays["end:u"][i, j] == pytest.approx(end, rel=0, abs=ROUND_OFF)
        assert float(rows[7 * i + j]["end:u"]) == arrays["end:u"][i, j]


def test_members_with_another_right_hand_side_run_in_a_group_of_their_own():
    """Without force, and without damping, `duffing` compiles another function."""
    study = study_of(problems.duffing, "gamma=0:1:3", "delta=0:1:3", measures=["end:u", "max:u"], t_end=1.0, h=0.01)
    rhs = set()
    for i, (gamma, delta) in enumerate(zip(study.columns["gamma"], study.columns["delta"], strict=True)):
        problem = problems.duffing(gamma=gamma, delta=delta, t_end=1.0)
        rhs.add(problem.rhs)
        u = problem.integrate(h=0.01).u
        assert study.values["end:u"][i] == pytest.approx(u[-1], rel=0, abs=ROUND_OFF)
        assert study.values["max:u"][i] == pytest.approx(u.max(), rel=0, abs=ROUND_OFF)
    assert len(rhs) == 4


def falling_on(floor: int = 0, u0: float = 0.5, t_end: float = 1.75):
    """A floor that is not there, one that throws the ball back, or one that ends the run."""
    floors = {}, {"floor": eig3.Event(position, apply=rebound)}, {"floor": eig3.Event(position, terminal=True)}
    return eig3.Problem("falling_on", falling, u0=u0, v0=0.0, params=1.0, t_span=(0.0, t_end), events=floors[floor])


def test_members_with_other_events_run_in_a_group_of_their_own():
    """The ball falls from 1/2 in 1 s, and EIG-3 is exact for a constant force. A member that ended early is NaN."""
    study = study_of(falling_on, "floor=0:2:3", measures=["end:u", "min:u", "end:v"], h=2.0**-6)
    assert study.status.tolist() == [Status.COMPLETED, Status.COMPLETED, Status.TERMINATED]
    np.testing.assert_allclose(study.values["end:u"], [-1.03125, 0.09375, np.nan], rtol=0, atol=ROUND_OFF)
    np.testing.assert_allclose(study.values["min:u"], [-1.03125, 0.0, np.nan], rtol=0, atol=ROUND_OFF)
    np.testing.assert_allclose(study.values["end:v"], [-1.75, -0.25, np.nan], rtol=0, atol=ROUND_OFF)
    study = study_of(falling_on, "floor=0:2:3", measures=["max:u"], h=2.0**-6, after=1.25)
    assert study.status.tolist() == [Status.COMPLETED, Status.COMPLETED, Status.TERMINATED]
    np.testing.assert_allclose(study.values["max:u"], [-0.28125, 0.125, np.nan], rtol=0, atol=ROUND_OFF)


def test_the_impacts_of_a_bouncing_ball_are_followed(tmp_path, capsys):
    """EIG-3 is exact for a constant force. The ball with the lowest values rests after some 0.96 s."""
    command = "bouncing_ball --set restitution=0.5:0.9:3 --set h0=0.5:1:2 --t-end 1.2 --h 1e-3"
    assert main(arguments(command, "max:u", "end:u", "end:v", out=tmp_path)) == 0
    first, *rows = rows_of(tmp_path)
    assert (first["status"], first["end:u"]) == ("events without end", "nan")
    for row in rows:
        ball = problems.bouncing_ball(restitution=float(row["restitution"]), h0=float(row["h0"]))
        assert row["status"] == "completed"
        found = [float(row[name]) for name in ("max:u", "end:u", "end:v")]
        np.testing.assert_allclose(found, [ball.u0, *ball.exact(1.2)], rtol=0, atol=1e-8)
    assert "6 members: 5 completed, 1 events without end (NaN in the files)" in capsys.readouterr().out


def test_members_with_another_number_of_masses():
    study = study_of(problems.hardening_chain, "n=4:5:2", measures=["max:u3"], t_end=0.5, h=1e-3)
    for n, value in zip((4, 5), study.values["max:u3"], strict=True):
        u = problems.hardening_chain(n=n, t_end=0.5).integrate(h=1e-3).u
        assert value == pytest.approx(u[:, 3].max(), rel=0, abs=ROUND_OFF)


def test_members_with_parameters_that_have_names():
    """The frame is linear, and starts at rest: its motion is proportional to the peak of the record."""
    axes, measures = [Axis("peak", 1.0, 3.0, 3)], [Measure.parse("peak:u117")]
    study = Study.plan(problems.ten_storey_frame, axes, measures, h=1e-3, t_end=2.0, after=0.5)
    study.run()
    values = study.values["peak:u117"]
    np.testing.assert_allclose(values, values[0] * np.array([1, 2, 3]), rtol=1e-10)
    run = problems.ten_storey_frame(peak=2.0, t_end=2.0).integrate(h=1e-3)
    assert values[1] == pytest.approx(np.abs(run.u[run.t >= 0.5, 117]).max(), rel=1e-4)  # it starts anew at 0.5 s


def test_outputs_are_measured_and_memory_goes_on_after():
    """After 1.6 s, the members start anew with their plastic states: EIG-3 is of second order, and (omega h)^2 is 1e-5.

    The extremes of outputs are also those at events, which lie between the saved states.
    """
    measures = ["peak:rotations", "max:moments[4]", "min:moments", "end:rotations[2]", "max:u30"]
    options = {"h": 4e-4, "t_end": 2.0}
    whole = study_of(problems.yielding_frame, "peak=20:40:2", measures=measures, **options)
    late = study_of(problems.yielding_frame, "peak=20:40:2", measures=measures, **options, after=1.6)
    for i, peak in enumerate((20.0, 40.0)):
        problem = problems.yielding_frame(peak=peak, t_end=2.0)
        run = problem.integrate(h=4e-4, outputs=problem.outputs)
        rotations, moments = run.extremes["rotations"], run.extremes["moments"]
        expected = [max(rotations.high.max(), -rotations.low.min()), moments.high[4], moments.low.min()]
        expected += [run.outputs["rotations"][-1, 2], run.u[:, 30].max()]
        np.testing.assert_allclose([whole.values[name][i] for name in measures], expected, rtol=1e-12)
        rotations, moments, u = (x[4000:] for x in (run.outputs["rotations"], run.outputs["moments"], run.u))
        expected = [np.abs(rotations).max(), moments[:, 4].max(), moments.min(), rotations[-1, 2], u[:, 30].max()]
        np.testing.assert_allclose([late.values[name][i] for name in measures], expected, rtol=3e-5)
    assert whole.measures[1].label(problem) == "largest moments[4] (N m)"
    assert whole.measures[1].label(problem.with_(output_units={})) == "largest moments[4]"


def test_a_value_of_an_output_is_measured_by_its_name():
    problem = problems.duffing(t_end=1.0)

    @eig3.jit
    def write(t, u, v, p, out):
        out[0], out[1] = u, -2.0 * u

    both = problem.with_(outputs={"both": (write, ("left", "right"))}, output_units={"both": ("m", "N")})
    named, numbered = (Measure.parse(f"end:both[{value}]") for value in ("right", "1"))
    members = both.ensemble(u0=[0.5, 1.0], h=0.01, outputs=both.outputs)
    for measure in (named, numbered):
        assert measure.function(both) == both.outputs["both"]
        np.testing.assert_array_equal(measure.of(members, "both", both), -2 * members.u[:, -1])
    whole = both.with_(outputs={"force[kN]": eig3.jit(lambda t, u, v, p: u)}, output_units={"force[kN]": "kN"})
    assert Measure.parse("end:force[kN]").label(whole) == "last force[kN] (kN)"
    assert named.label(both) == "last both[right] (N)"
    assert Measure.parse("max:both").label(both) == "largest both (m or N)"
    with pytest.raises(ValueError, match="does not fit: both has the values left, right"):
        Measure.parse("end:both[rigth]").function(both)


def test_a_random_sample_is_reproducible_and_within_its_limits(tmp_path):
    command = "spring_pendulum --set k=60:120 --set theta0=0.1:1:log --random 300 --t-end 0.1 --h 1e-2 --seed"
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        assert main(arguments(f"{command} {seed}", "end:u1", out=tmp_path / name)) == 0
    a, b, c = ((tmp_path / name / "sweep.csv").read_text() for name in "abc")
    assert a == b != c
    arrays = arrays_of(tmp_path / "a")
    assert arrays["k"].shape == arrays["end:u1"].shape == (300,)
    for name, low, high in (("k", 60, 120), ("theta0", 0.1, 1)):
        assert low <= arrays[name].min() < arrays[name].max() < high
    # the standard error of these means is 1/sqrt(12 * 300) = 1/60 of the width, and five times that is not exceeded
    for share in ((arrays["k"] - 60) / 60, np.log(arrays["theta0"] / 0.1) / np.log(10)):
        assert abs(share.mean() - 0.5) < 5 / 60
    end = problems.spring_pendulum(k=arrays["k"][7], theta0=arrays["theta0"][7], t_end=0.1).integrate(h=1e-2).u[-1, 1]
    assert arrays["end:u1"][7] == pytest.approx(end, rel=0, abs=ROUND_OFF)


def test_whole_numbers_are_drawn_with_both_ends():
    values = Axis.parse("n=2:4", random=True).sample(np.random.default_rng(0), 100, whole=True)
    assert set(values.tolist()) == {2, 3, 4}


def test_a_scene_with_a_record_for_each_member():
    options = {"random": 3, "seed": 4, "t_end": 1.0, "h": 1e-3}
    study = study_of(
        problems.shear_building, "record=1:1000", "stiffness=1e7:2e7", measures=["peak:u1-u0", "end:u0"], **options
    )
    assert study.completed.all()
    for i, (record, stiffness) in enumerate(zip(*study.columns.values(), strict=True)):
        u = problems.shear_building(record=int(record), stiffness=stiffness, t_end=1.0).integrate(h=1e-3).u
        expected = [np.abs(u[:, 1] - u[:, 0]).max(), u[-1, 0]]
        np.testing.assert_allclose([x[i] for x in study.values.values()], expected, rtol=0, atol=ROUND_OFF)


@pytest.mark.parametrize("build", [problems.shear_building, problems.yielding_frame])
def test_the_energy_of_a_scene_follows_the_work(build):
    """The drift is that of the energy less the work; the extremes are those of the mechanical energy."""
    options = {"t_end": 0.2, "h": 4e-4}
    study = study_of(build, "peak=1:2:2", measures=["drift:energy", "max:energy", "end:energy"], **options)
    for i, peak in enumerate(study.columns["peak"]):
        problem = build(peak=peak, t_end=0.2, work=True)
        run = problem.integrate(h=4e-4, invariants_every=1)
        energy = problem.energy_of(run.u, run.v, run.t, z=run.z)
        expected = [run.drift["energy"], energy.max(), energy[-1]]
        np.testing.assert_allclose([x[i] for x in study.values.values()], expected, rtol=1e-9)  # sums of large terms


def test_entries_of_the_start():
    study = study_of(problems.spring_pendulum, "u0[1]=0.1:0.5:3", "v0[0]=0:1:2", measures=["end:u1"], t_end=0.1, h=1e-2)
    for i, (angle, speed) in enumerate(zip(*study.columns.values(), strict=True)):
        run = problems.spring_pendulum(t_end=0.1).with_(u0=[0.75, angle], v0=[speed, 0]).integrate(h=1e-2)
        assert study.values["end:u1"][i] == pytest.approx(run.u[-1, 1], rel=0, abs=ROUND_OFF)
    study = study_of(problems.hertz_impact, "v0=-2:-1:2", measures=["min:u"], t_end=1e-3, h=1e-5)
    run = problems.hertz_impact(t_end=1e-3).with_(v0=-2.0).integrate(h=1e-5)
    assert study.values["min:u"][0] == pytest.approx(run.u.min(), rel=0, abs=ROUND_OFF)


def test_after_measures_the_steady_state():
    """The linear oscillator's amplitude is force / |omega^2 - w^2 + 2 i xi omega w|, once the free motion has gone.

    The free motion has decayed by exp(-0.2 * 4 * 60) = 1e-21 after 60 s. EIG-3 is of second order: at h = 0.01 and
    w = 4 its error of the amplitude is below (h w)^2 = 2e-3 relative to it, near resonance twice as much.
    """
    fixed = [("xi", 0.2), ("force", 1.0), ("u0", 3.0)]
    study = study_of(
        problems.single_dof, "force_omega=1:6:6", measures=["max:u"], fixed=fixed, after=60.0, t_end=75.0, h=0.01
    )
    w = study.columns["force_omega"]
    np.testing.assert_allclose(study.values["max:u"], 1 / np.abs(16 - w**2 + 1.6j * w), rtol=4e-3)


def test_members_that_diverge_are_nan_and_counted(tmp_path, capsys):
    """Beyond omega h = 2 EIG-3 is unstable: here for omega above 20."""
    assert main(arguments("single_dof --set omega=10:26:5 --h 0.1 --t-end 200", "max:u", "end:u", out=tmp_path)) == 0
    rows = rows_of(tmp_path)
    assert [row["status"] for row in rows] == ["completed"] * 3 + ["diverged"] * 2
    assert [row["max:u"] for row in rows[3:]] == ["nan", "nan"]
    np.testing.assert_array_equal(np.isnan(arrays_of(tmp_path)["end:u"]), [r["end:u"] == "nan" for r in rows])
    assert "3 completed, 2 diverged (NaN in the files)" in capsys.readouterr().out
    study = study_of(problems.single_dof, "omega=10:26:5", measures=["max:u"], after=100.0, t_end=200.0, h=0.1)
    assert study.status[4] is Status.DIVERGED  # in the part before, which is not measured


def test_if_no_member_reaches_the_end_the_command_fails(tmp_path):
    assert main(arguments("single_dof --set omega=30:40:2 --h 0.1 --t-end 200", "max:u", out=tmp_path)) == 1
    assert (tmp_path / "sweep.png").exists()


def test_batches_do_not_change_the_numbers(monkeypatch):
    options = {"random": 40, "seed": 1, "t_end": 1.0, "h": 0.01, "measures": ["end:u", "max:v"]}
    whole = study_of(problems.duffing, "omega=1:2", **options)
    monkeypatch.setattr(Study, "_batch_size", lambda study: 7)
    parts = study_of(problems.duffing, "omega=1:2", **options)
    for name, values in whole.values.items():
        np.testing.assert_array_equal(parts.values[name], values)


def test_a_batch_has_a_bounded_size():
    axes = [Axis.parse("peak=1:2", random=True)]
    study = Study.plan(problems.shear_building, axes, [Measure.parse("max:u0")], random=1_000_000, h=1e-3)
    k = np.size(study.problem.params)
    assert 8 * k * study._batch_size() <= 64 * 2**20  # bytes
    assert study._batch_size() > 1000


def test_an_interrupted_sweep_keeps_the_batches_that_were_complete(tmp_path, monkeypatch, capsys):
    begin = Study._run_group

    def interrupted(study, problems, members):
        if members[0] >= 2:
            raise KeyboardInterrupt
        begin(study, problems, members)

    monkeypatch.setattr(Study, "_batch_size", lambda study: 2)
    monkeypatch.setattr(Study, "_run_group", interrupted)
    assert main(arguments("duffing --set omega=1:2:4 --t-end 1 --h 0.01", "max:u", out=tmp_path)) == 130
    rows = rows_of(tmp_path)
    assert [row["status"] for row in rows] == ["completed"] * 2 + ["interrupted"] * 2
    assert [row["max:u"] == "nan" for row in rows] == [False, False, True, True]
    assert "2 completed, 2 interrupted" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("command", "measure", "message"),
    [
        ("nothing --set a=1:2:3", "max:u", "there is no problem nothing: take arenstorf, "),
        ("duffing --set mass=1:2:3", "max:u", "duffing has the parameters delta, a, b, gamma, omega, u0, v0, "),
        ("duffing --set a=1:2:3 --fix mass=1", "max:u", "duffing has the parameters delta, a, b, "),
        ("spring_pendulum --set u0=1:2:3", "max:u0", "has the entries u0[0] to u0[1], but not u0."),
        ("spring_pendulum --set v0[2]=1:2:3", "max:u0", "has the entries v0[0] to v0[1], but not v0[2]."),
        ("duffing --set a=1:2", "max:u", "--set must be NAME=FROM:TO:COUNT or NAME=FROM:TO:COUNT:log, such as"),
        ("duffing --set a=1:x:3", "max:u", "--set must be NAME=FROM:TO:COUNT"),
        ("duffing --set a=1:2:3 --random 5", "max:u", "--set must be NAME=FROM:TO or NAME=FROM:TO:log with --random"),
        ("duffing --set a=2:1:3", "max:u", "--set a must go from a number to a larger number, not from 2 to 1."),
        ("duffing --set a=0:1:3:log", "max:u", "--set a must start above 0 for logarithmic spacing, not at 0."),
        ("duffing --set a=0:1:1", "max:u", "--set a must have at least 2 values, not 1."),
        ("duffing", "max:u", "give one or two parameters with --set, not 0"),
        ("duffing --set a=1:2:3 --set b=1:2:3 --set omega=1:2:3", "max:u", "give one or two parameters with --set"),
        ("duffing --set a=1:2:3 --fix a=1", "max:u", "a is given twice"),
        ("duffing --set a=1:2:3 --fix b=1 --fix b=2", "max:u", "b is given twice"),
        ("duffing --set u0=1:2:3 --fix u0[0]=3", "max:u", "u0[0] is given twice"),
        ("duffing --set a=1:2:3 --fix b", "max:u", "--fix must be NAME=VALUE, such as omega=1.2, not 'b'."),
        ("elastic_bar --set length=1:2:2 --fix n=2.5", "max:u0", "--fix n must be a whole number, not 2.5."),
        ("elastic_bar --set n=4:8:4", "max:u0", "--set n takes whole numbers, but 4 values from 4 to 8 contain 5.3"),
        ("elastic_bar --set n=4:8:log --random 3", "max:u0", "--set n takes whole numbers: give whole FROM and TO"),
        ("duffing --set delta=-1:1:3", "max:u", "delta must not be negative, not -1"),
        ("duffing --set a=1:2:3", "mean:u", "--measure must be one of max, min, peak, end, drift, then a colon"),
        ("duffing --set a=1:2:3", "max:w0", "--measure must be one of max, "),
        ("duffing --set a=1:2:3", "max:u1-v0", "--measure must be one of max, "),
        ("duffing --set a=1:2:3", "max:u1", "--measure max:u1 does not fit: duffing has one degree of freedom."),
        ("kepler --set e=0:0.5:2", "max:u2", "kepler has 2 degrees of freedom, numbered from 0."),
        ("kepler --set e=0:0.5:2", "max:u", "--measure max:u must say which degree of freedom, such as max:u0."),
        ("duffing --set a=1:2:3", "max:energy", "duffing has no energy with these parameters."),
        (
            "yielding_frame --set peak=1:2:2",
            "max:forces",
            "u0, v0, u1-u0 (any degrees of freedom), moments, rotations, or energy",
        ),
        ("yielding_frame --set peak=1:2:2", "end:moments", "must say which of the 34 values, such as end:moments[0]."),
        ("yielding_frame --set peak=1:2:2", "max:moments[34]", "does not fit: moments has 34 values, numbered from 0."),
        ("yielding_frame --set peak=1:2:2", "drift:moments", "does not fit: take max, min, peak or end of an output."),
        ("hopper --set n=20:21:2 --after 1e-3", "max:u0", "--after does not fit: a second run would "),
        ("duffing --set a=1:2:3 --after 60", "max:u", "--after must be a time between 0 and 50, the span"),
        ("duffing --set a=1:2:3 --method euler", "max:u", "method must be one of "),
        ("duffing --set a=1:2:3 --h 0", "max:u", "h must be a positive, finite number"),
        ("duffing --set a=1:2:3 --t-end 0", "max:u", "t_span must end after it starts"),
    ],
)
def test_wrong_arguments_are_refused_before_anything_runs(command, measure, message, monkeypatch):
    monkeypatch.setattr(Study, "run", lambda study, progress: pytest.fail("ran"))
    with pytest.raises(SystemExit) as caught:
        main(arguments(command, measure))
    text = str(caught.value.code)
    assert text.startswith("eig3 sweep: ")
    assert message in text
    assert "\n" not in text


NINES = "9" * 5000


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (f"duffing --set omega=1:2:{NINES}", "--set omega cannot have so many values: their number has 5000 digits."),
        ("duffing --set omega=1:2:100000000000000", "a study of 1e+14 members needs 1.68e+16 bytes and"),
        ("duffing --set omega=1:2:9000000000 --set u0=0:1:9000000000", "a study of 8.1e+19 members needs"),
        ("duffing --set omega=1:2 --random 100000000000000", "a study of 1e+14 members needs"),
        ("duffing --set omega=1:2 --random 5 --seed -1", "--seed must be a whole number of at least 0, not -1."),
        ("duffing --set omega=1:2:5 --seed 3", "--seed is for random members: give --random too."),
        ("hardening_chain --set n=2:1e300:2", "--set n takes whole numbers below 2^53, not up to 1e+300."),
        ("hardening_chain --set n=2:1e300 --random 2", "--set n takes whole numbers below 2^53, not up to 1e+300."),
        ("hardening_chain --fix n=1e300 --set speed=1:2:2", "--fix n takes whole numbers below 2^53, not 1e+300."),
        (f"duffing --set omega={NINES}", "--set must be NAME=FROM:TO:COUNT or NAME=FROM:TO:COUNT:log, such as"),
    ],
)
def test_what_fits_in_no_memory_is_refused_in_a_sentence(command, message, monkeypatch):
    monkeypatch.setattr(Study, "run", lambda study, progress: pytest.fail("ran"))
    with pytest.raises(SystemExit) as caught:
        main(arguments(command, "max:u0"))
    text = str(caught.value.code)
    assert text.startswith(f"eig3 sweep: {message}")
    assert len(text) < 250
    assert "\n" not in text


def test_a_count_of_thousands_of_digits_is_refused_in_a_sentence(capsys):
    with pytest.raises(SystemExit):
        main(arguments(f"duffing --set omega=1:2 --random {NINES}", "max:u0"))
    last = capsys.readouterr().err.splitlines()[-1]
    assert "argument --random: must be a whole number of at least 1, of 15 digits at most, not '999" in last
    assert len(last) < 200


def test_without_a_step_the_sweep_takes_the_shortest_of_its_corners():
    """A tenth of 0.9 times the critical step 2 / omega, as `eig3 run` takes for one problem."""
    axes, measures = [Axis.parse("omega=10:500:3", random=False)], [Measure.parse("max:u0")]
    study = Study.plan(problems.two_frequency_oscillator, axes, measures, fixed=[("omega_fast", 100.0)], t_end=1000.0)
    assert study.h == pytest.approx(0.1 * 0.9 * 2 / 500, rel=0.01)  # the critical step is found to a per cent


def drawn(study):
    figure = Figure(layout="constrained")
    pictures.draw(figure, study)
    figure.draw_without_rendering()
    return figure


def test_curves_have_names_units_and_a_legend():
    study = study_of(problems.duffing, "u0=0:1:2", "omega=1:2:5:log", measures=["peak:u", "end:v"], t_end=1.0, h=0.01)
    above, below = drawn(study).axes
    assert (above.get_ylabel(), below.get_ylabel()) == ("peak u (m)", "last v (m/s)")
    assert below.get_xlabel() == "omega (rad/s)"
    assert below.get_xscale() == "log"
    assert [text.get_text() for text in above.get_legend().get_texts()] == ["u0 = 0", "u0 = 1"]
    for k, line in enumerate(above.lines):
        np.testing.assert_array_equal(line.get_xdata(), study.columns["omega"].reshape(2, 5)[k])
        np.testing.assert_array_equal(line.get_ydata(), study.values["peak:u"].reshape(2, 5)[k])


def test_a_map_has_a_colour_bar_and_leaves_out_members_that_diverged():
    study = study_of(problems.single_dof, "omega=10:40:6", "u0=-1:2:7", measures=["max:u", "end:u"], t_end=200.0, h=0.1)
    figure = drawn(study)
    first, second, bar, other = figure.axes
    assert (first.get_xlabel(), first.get_ylabel()) == ("omega (rad/s)", "u0 (m)")
    assert (bar.get_ylabel(), other.get_ylabel()) == ("largest u (m)", "last u (m)")
    shown = first.collections[0].get_array()
    np.testing.assert_array_equal(np.ma.getmaskarray(shown).ravel(), ~study.completed)
    np.testing.assert_array_equal(shown.compressed(), study.values["max:u"][study.completed])
    assert first.get_title() == "grey: no result"
    low, high = second.collections[0].get_clim()
    assert low == -high  # of values with both signs
    assert f"{np.sum(~study.completed)} of 42 members diverged" in figure.get_suptitle()


def test_a_random_sample_has_a_histogram_with_quantiles():
    study = study_of(
        problems.spring_pendulum, "k=60:120", "m=1:2", random=50, seed=1, measures=["max:u0"], t_end=0.5, h=1e-2
    )
    histogram, *against = drawn(study).axes
    assert histogram.get_ylabel() == "largest u0 (m)"
    assert sum(bar.get_width() for bar in histogram.patches) == 50
    quantiles = [line.get_ydata()[0] for line in histogram.lines]
    np.testing.assert_array_equal(quantiles, np.quantile(study.values["max:u0"], (0.05, 0.5, 0.95)))
    assert [axes.get_xlabel() for axes in against] == ["k (N/m)", "m (kg)"]


@pytest.mark.parametrize("name", problems.__all__)
def test_every_parameter_with_a_dimension_has_its_unit(name):
    """The units are read from the documentation, which gives none for pure numbers."""
    parameters = Parameters(getattr(problems, name))
    units = {parameter: parameters.unit(parameter, problems.single_dof()) for parameter in parameters.kinds}
    lengths = {"side", "l0", "l1", "r0", "x0", "length"} if name != "damped_bar" else set()
    masses = {"m", "m1", "m2", "body", "wheel", "car"}
    for parameter, unit in units.items():
        assert (unit == "m") or parameter not in lengths
        assert (unit == "kg") or parameter not in masses
        assert (unit == "rad/s") or parameter not in {"omega", "omega_fast"}
        assert (unit == "rad") or not parameter.startswith("theta")


def test_units_of_the_quantities():
    pendulum, relaxation = problems.spring_pendulum(), problems.van_der_pol()
    labels = [
        Measure.parse(text).label(pendulum)
        for text in ("max:u1", "end:v0", "drift:energy", "max: u1 - u1", "min:v1-v0")
    ]
    assert labels == [
        "largest u1 (rad)",
        "last v0 (m/s)",
        "drift of energy (J)",
        "largest u1-u1 (rad)",
        "smallest v1-v0 (rad/s - m/s)",
    ]
    assert Measure.parse("peak:v").label(relaxation) == "peak v (1/s)"
    assert eig3.problems.duffing().unit("v") == "m/s"


def test_without_matplotlib_the_table_is_written_all_the_same(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    assert main(arguments("duffing --set omega=1:2:3 --t-end 1 --h 0.01", "max:u", out=tmp_path)) == 0
    assert {path.name for path in tmp_path.iterdir()} == {"sweep.csv", "sweep.npz"}
    assert NO_PICTURES in capsys.readouterr().out
