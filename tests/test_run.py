"""The pictures of `eig3 run`: their axes, and the scale on which a failed run is drawn."""

import dataclasses
import functools
import inspect
import sys

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from matplotlib.figure import Figure

from eig3 import Status, drawing, problems
from eig3.cli import main
from eig3.command_line import NO_PICTURES, file_name
from eig3.planning.suggested_step import first_step
from eig3.run_report import Balance, draw, run
from eig3.stepping.march import March

from .conftest import made_up


def drawn(problem, method="eig3", status=None, **options):
    """Return the figure of a run, and its solution; `status` replaces the status of the run."""
    solution = problem.integrate(method=method, invariants={}, **options)
    if status:
        solution = dataclasses.replace(solution, status=status)
    figure = Figure(layout="constrained")
    balance = Balance.of(problem, solution) if problem.energy is not None and solution.success else None
    draw(figure, problem, solution, balance)
    return figure, solution


WAVING = "argon butane curtain double_wishbone flag four_bar hopper jelly ragdoll rod_chain sand_column slider_crank"
WAVING += " sodium_chloride squeezer tumbling_box"


@functools.cache
def usual(name):
    """The figure of a short run of a problem at its own step.

    The masses of a scene wave instead, so that no force is compiled, unless its picture needs events, z or the work.
    """
    build = getattr(problems, name)
    options = {"work": True} if "work" in inspect.signature(build).parameters else {}
    points = {
        "argon": 4,
        "curtain": 10,
        "flag": 5,
        "jelly": 3,
        "hopper": 60,
        "sand_column": 60,
    }  # fewer than by default
    problem = build(**options, **({"n": points[name]} if name in points else {}))
    if name in WAVING.split():
        t = np.linspace(*problem.t_span, 50)
        u = np.linspace(0.01, 0.02, len(problem.u0)) * np.sin(20 * t / t[-1])[:, None]
        solution, figure = made_up(t, problem.u0 + u), Figure(layout="constrained")
        draw(figure, problem, solution, None)
        return figure, solution
    h = first_step(problem, "eig3", problem.t_span[1] - problem.t_span[0])
    return drawn(problem, h=h, save_every=max(1, int(problem.t_span[1] / h / 200)))


@pytest.mark.parametrize("name", problems.__all__)
def test_panels_share_the_time_axis_and_name_their_units(name):
    figure, solution = usual(name)
    panels = drawing.time_panels(figure)
    assert len(panels) >= 2
    unit = "-" if name in ("arenstorf", "figure_eight", "henon_heiles") else "s"
    assert [axes.get_xlabel() for axes in panels] == [""] * (len(panels) - 1) + [f"t ({unit})"]
    assert figure.get_suptitle().endswith(" s") == (unit == "s")
    for axes in panels:
        assert axes.get_shared_x_axes().joined(axes, panels[0])
        assert axes.get_xlim() == panels[0].get_xlim()
        assert "(" in axes.get_ylabel() or axes.get_ylabel() == "number of the mass"
    assert panels[0].get_xlim()[0] == solution.t[0]
    for axes in drawing.pictures(figure):
        assert axes.get_xlabel().endswith(")")
        assert axes.get_ylabel().endswith(")")


@pytest.mark.parametrize("name", ["kepler", "elastic_bar", "shear_building"])
def test_panels_are_aligned(name):
    """This includes the energy panel, although legends and colour bars have different widths."""
    figure, _ = usual(name)
    figure.draw_without_rendering()
    edges = np.array([axes.get_position().intervalx for axes in drawing.time_panels(figure)])
    assert len(edges) == 3
    np.testing.assert_allclose(edges, edges[:1].repeat(3, axis=0), rtol=0, atol=1e-9)


def test_kepler_shows_its_orbit_about_the_focus():
    figure, solution = usual("kepler")
    (orbit,) = drawing.pictures(figure)
    assert orbit.get_aspect() == 1
    by_label = {line.get_label(): line for line in orbit.lines}
    assert by_label["sun (focus)"].get_xydata().tolist() == [[0, 0]]
    np.testing.assert_array_equal(by_label["planet's path"].get_xydata(), solution.u)
    x, y = by_label["exact orbit"].get_xydata().T
    np.testing.assert_allclose((x + 0.9) ** 2 + y**2 / (1 - 0.9**2), 1, rtol=0, atol=1e-12)  # round-off


@pytest.mark.parametrize(("name", "paths"), [("spring_pendulum", 1), ("double_pendulum", 2)])
def test_pendulums_show_the_paths_of_their_masses(name, paths):
    figure, solution = usual(name)
    (plane,) = drawing.pictures(figure)
    assert plane.get_aspect() == 1
    drawn_paths = [line.get_xydata() for line in plane.lines if line.get_label().startswith("path of")]
    assert len(drawn_paths) == paths
    if name == "spring_pendulum":
        np.testing.assert_allclose(np.hypot(*drawn_paths[0].T), np.abs(solution.u[:, 0]), rtol=1e-14)
    else:  # the rods keep their lengths of 1 m
        np.testing.assert_allclose(np.hypot(*(drawn_paths[0] - drawn_paths[1]).T), 1, rtol=1e-14)


def test_oscillators_show_their_phase_portrait():
    figure, solution = usual("duffing")
    (portrait,) = drawing.pictures(figure)
    np.testing.assert_array_equal(portrait.lines[0].get_xydata(), np.column_stack([solution.u, solution.v]))


@pytest.mark.parametrize("name", ["elastic_bar", "damped_bar", "hardening_chain"])
def test_rows_of_masses_show_their_field(name):
    figure, solution = usual(name)
    for axes, values, quantity in zip(
        drawing.time_panels(figure), (solution.u, solution.v), ("displacement (", "velocity ("), strict=False
    ):
        (image,) = axes.images
        np.testing.assert_array_equal(image.get_array(), values.T)
        assert image.get_clim() == (-np.abs(values).max(), np.abs(values).max())
        assert image.colorbar.ax.get_ylabel().startswith(quantity)


def test_a_long_run_shows_periods_that_can_be_distinguished():
    figure, _ = drawn(problems.single_dof(), h=0.01, save_every=10)
    low, high = drawing.time_panels(figure)[0].get_xlim()
    assert (high - low) * 4.0 / (2 * np.pi) == pytest.approx(25, abs=1)  # omega = 4 rad/s
    assert drawing.time_panels(figure)[0].get_title() == "the first 25 of 637 periods"


@pytest.mark.parametrize(
    ("problem", "h"),
    [
        (problems.elastic_bar(n=100), 1.1 / 101 / 5000),  # the critical step is 1 / 101 / 5000
        (problems.single_dof(), 0.51),  # the critical step is 0.5
    ],
)
def test_a_run_that_blew_up_is_drawn_on_the_scale_of_its_motion(problem, h):
    """The displacement is at most 1 in the exact solution; five times that is the beginning of the growth."""
    figure, solution = drawn(problem, h=h)
    assert solution.status is Status.DIVERGED
    assert np.abs(solution.u).max() > 1e250
    shown = drawing.before_growth(solution)
    assert len(shown.t) > 5
    assert np.isfinite(shown.u).all()
    assert 0.99 < np.abs(shown.u).max() <= 5  # no mass of the bar is exactly at the top of the pulse
    first, *_, last = panels = drawing.time_panels(figure)
    limits = first.images[0].get_clim() if first.images else first.get_ylim()
    assert np.abs(limits).max() <= 1.1 * 5  # with matplotlib's margin
    assert shown.t[-1] < first.get_xlim()[1] < solution.t[-1]
    assert last.get_yscale() == "log"
    for axes in panels:
        assert list(axes.lines[-1].get_xdata()) == [shown.t[-1]] * 2
    title = figure.get_suptitle()
    assert f"diverged; the last state is at t = {solution.t[-1]:.4g} s" in title
    assert f"shown up to t = {shown.t[-1]:.4g} s" in title


def test_a_blow_up_within_the_largest_number_is_drawn_on_the_same_scale():
    """Up to 1e29 at the end of the span, here with the status of a run that failed."""
    figure, solution = drawn(problems.single_dof(t_end=20.0), h=0.52, status=Status.DIVERGED)
    assert np.abs(solution.u).max() < 1e100
    assert np.abs(drawing.time_panels(figure)[0].get_ylim()).max() <= 1.1 * 5
    assert "growth begins" in [text.get_text() for text in drawing.time_panels(figure)[0].texts]


@pytest.mark.parametrize("name", ["spring_pendulum", "hardening_spring", "hardening_chain"])
def test_a_run_that_blows_up_in_its_first_steps_can_be_drawn(name):
    problem = getattr(problems, name)()
    figure, solution = drawn(problem, h=20 * problem.critical_step().h)
    assert solution.status is Status.DIVERGED
    figure.draw_without_rendering()  # raises where a limit or a tick overflows
    assert all(np.isfinite([*axes.get_xlim(), *axes.get_ylim()]).all() for axes in figure.axes)


def history(values, status):
    """A solution with these displacements, and velocities of the same size."""
    solution = problems.single_dof(t_end=1.0).integrate(h=0.1, invariants={})
    return dataclasses.replace(solution, t=np.arange(float(len(values))), u=values, v=values, status=status)


t = np.arange(1000.0)
SLOW = 1.001 ** np.maximum(0.0, t - 500) * np.sin(0.1 * t)  # by a factor of 1.6 at the end
FAST = 2 ** np.maximum(0.0, t - 600) * np.cos(3 * t)


@pytest.mark.parametrize("values", [t, t**2, np.sin(0.1 * t), np.exp(-0.1 * t), np.zeros(1000), SLOW])
@pytest.mark.parametrize("status", [Status.INTERRUPTED, Status.DIVERGED])
def test_a_motion_without_a_blow_up_is_drawn_whole(values, status):
    """A start from rest, free fall, an oscillation and a decay; a run of these can end without any instability."""
    assert len(drawing.before_growth(history(values, status)).t) == 1000


def test_a_blow_up_is_cut_where_it_leaves_the_size_of_the_motion():
    """From step 600 it doubles at every step, and is at five times its size three steps later, or four at a zero."""
    assert 600 < len(drawing.before_growth(history(FAST, Status.DIVERGED)).t) <= 604
    assert len(drawing.before_growth(history(FAST, Status.COMPLETED)).t) == 1000


def test_growth_from_the_start_is_cut_at_five_times_its_size():
    """At a factor of 1.5 a step, five times are reached after log(5) / log(1.5) = 3.97 steps."""
    assert len(drawing.before_growth(history(1.5 ** t[:800], Status.DIVERGED)).t) == 4


def test_axes_of_a_users_own_drawing_stay_beside_the_energy():
    def own(figure, solution):
        for axes, values in zip(figure.subplots(2), (solution.u, solution.v), strict=True):
            axes.plot(solution.t, values)

    figure, _ = drawn(dataclasses.replace(problems.hertz_impact(), draw=own), h=1e-4)
    figure.draw_without_rendering()
    above, below, energy = (axes.get_position() for axes in figure.axes)
    assert above.y0 > below.y1
    assert max(above.x1, below.x1) < energy.x0


def test_an_interrupted_run_is_marked_and_drawn_whole():
    figure, solution = drawn(problems.duffing(), h=0.1, status=Status.INTERRUPTED)
    first = drawing.time_panels(figure)[0]
    assert [text.get_text() for text in first.texts] == ["interrupted"]
    assert first.get_xlim()[1] == solution.t[-1]


def test_without_matplotlib_the_history_is_written_all_the_same(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    printed = []
    run(problems.hertz_impact, out=tmp_path, write=printed.append)
    assert {path.name for path in tmp_path.iterdir()} == {"hertz_impact.npz", "hertz_impact.csv"}
    assert printed[-1].endswith(NO_PICTURES)


def test_energies_without_a_unit():
    for unit in ("", "-"):
        text = Balance(np.arange(2.0), np.array([1.0, 2.0]), np.array([0.0, 1.0]), unit).summary()
        assert text.startswith("  energy: 1 at the start, 2 at the end, between 1 and 2\n  work done: 1 at the end, ")


def test_no_file_of_an_earlier_run_is_left(tmp_path, monkeypatch):
    """The second run has too many values for a table, and no pictures."""
    run(problems.hertz_impact, out=tmp_path, write=lambda line: None)
    monkeypatch.setattr("eig3.run_report._CSV_VALUES", 1)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    run(problems.hertz_impact, out=tmp_path, write=lambda line: None)
    assert [path.name for path in tmp_path.iterdir()] == ["hertz_impact.npz"]


@pytest.mark.parametrize("name", ["../../x", "..", "a/b", "/etc/x", ".", "", "con"])
def test_no_name_of_a_problem_leaves_the_folder(name, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    out = tmp_path / "a" / "b"
    out.mkdir(parents=True)
    run(lambda: problems.hertz_impact().with_(name=name), out=out, write=lambda line: None)
    assert {path for path in tmp_path.rglob("*") if path.is_file()} == set(out.iterdir())
    assert {path.name for path in out.iterdir()} == {f"{file_name(name)}.npz", f"{file_name(name)}.csv"}


@pytest.mark.parametrize(
    ("name", "plain"),
    [
        ("quarter car, 2+1 dof-v1.5", "quarter car_ 2+1 dof-v1.5"),
        ("Brücke", "Brücke"),
        ("../../x", "_.._x"),
        ("/etc/x", "_etc_x"),
        ("C:\\x", "C__x"),
        ("a\0b\nc", "a_b_c"),
        (".hidden", "hidden"),
        *((name, "problem") for name in ("", ".", "..", "  ")),
        *((name, f"_{name}") for name in ("con", "COM1", "nul.x")),
        ("console", "console"),
    ],
)
def test_a_file_name_stays_readable(name, plain):
    assert file_name(name) == plain


@given(st.text(st.characters(), max_size=500))
@example("x" * 500)
@example("\U0001d538" * 500)
@example("\ud800")
def test_any_name_becomes_a_plain_file_name(name):
    plain = file_name(name)
    assert plain
    assert not plain.startswith(".")
    assert not set(plain) & set('/\\:*?"<>|\0\r\n')
    assert len(f"{plain}.npz".encode()) < 110


def test_dollars_in_a_name_are_no_formula():
    figure, _ = drawn(problems.hertz_impact().with_(name=r"$\frac$"), h=1e-4)
    figure.draw_without_rendering()
    assert figure.get_suptitle().startswith(r"$\frac$, ")


def test_the_energy_has_the_unit_of_the_problem():
    printed = []
    run(problems.hertz_impact, write=printed.append)
    assert "energy: 0.5 J/kg at the start" in printed[-1]


def test_an_interrupted_run_is_written_and_ends_the_command(tmp_path, monkeypatch, capsys):
    def interrupted(stepper, count, *arguments):
        take(stepper, 10, *arguments)
        raise KeyboardInterrupt

    take = March.take
    monkeypatch.setattr(March, "take", interrupted)
    monkeypatch.setattr("eig3.run.short.MOST_SECONDS", 0.0)
    assert main(["run", "duffing", "--t-end", "1", "--out", str(tmp_path)]) == 130
    assert "The run was interrupted after t = " in capsys.readouterr().out
    assert (tmp_path / "duffing.npz").exists()


def test_a_run_that_is_interrupted_before_it_begins_ends_the_command(monkeypatch, capsys):
    def interrupted(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr("eig3.stepping.march.evaluation", interrupted)
    assert main(["run", "duffing", "--h", "0.1", "--t-end", "1"]) == 130
    assert capsys.readouterr().err == "\nInterrupted.\n"


def test_a_balance_without_units_has_none_in_its_words():
    balance = Balance(np.arange(2.0), np.array([0.5, 0.25]), np.array([0.0, -0.25]), "-")
    assert balance.summary().splitlines() == [
        "  energy: 0.5 at the start, 0.25 at the end, between 0.25 and 0.5",
        "  work done: -0.25 at the end, between -0.25 and 0; change of energy minus work: at most 0",
    ]
