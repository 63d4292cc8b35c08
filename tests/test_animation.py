"""Animations: the states in the frames, what is drawn of them, and the files."""

import pickle
import shutil
import subprocess
import sys
from itertools import pairwise

import numpy as np
import pytest

pytest.importorskip("matplotlib")
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import art3d
from PIL import Image

import eig3
from eig3 import problems
from eig3 import run_report as run_module
from eig3.animation import Curves, Film, Portrait, second_process
from eig3.animation import animate as animate_module
from eig3.animation import film as film_module
from eig3.animation import writers as writers_module
from eig3.animation.animate import captions, stage
from eig3.animation.film import RATE, excursions, film_speed, is_resolved, shown_duration
from eig3.animation.redraw import Redraw
from eig3.cli import main
from eig3.drawing import before_growth
from eig3.effects import (
    BreakingString,
    Gravity,
    HertzContact,
    LinearSpring,
    MassImpact,
    PlaneContact,
    RigidStop,
    SampledMotion,
    SupportMotion,
)
from eig3.result.labels import Labels
from eig3.run_report import _resolved, _steps
from eig3.scene import Scene

from .conftest import made_up


def staged(problem, solution):
    """Return the figure of an animation, the function that shows a frame, and the film."""
    figure = Figure(figsize=(4.8, 3.6), layout="constrained")
    FigureCanvasAgg(figure)
    film = Film.of(before_growth(solution), has_seconds=problem.energy_unit != "-")
    return figure, stage(figure, problem.view or Curves(problem.labels), film, solution), film


def dots(axes, marker):
    """Return the places of the points of a mechanism that have this marker."""
    (line,) = [line for line in axes.lines if line.get_marker() == marker and line.get_linestyle() == "None"]
    return np.column_stack(line.get_data_3d() if hasattr(line, "get_data_3d") else line.get_data())


def texts(figure):
    return [text.get_text() for text in figure.texts]


sway = eig3.jit(lambda t: (0.3 * np.sin(2 * t), 0.6 * np.cos(2 * t)))


@pytest.fixture(scope="module")
def swinging():
    """A mass on a spring below a support that moves, above a floor."""
    scene = Scene(dimension=2)
    support, mass = scene.fixed((1.0, 2.0)), scene.mass(1.0, (1.3, 1.0))
    scene.add(LinearSpring(100.0, rest_length=0.8), support, mass)
    scene.add(Gravity((0.0, -9.81)))
    scene.add(PlaneContact(1e5, normal=(0.0, 1.0), offset=0.5), mass)
    scene.add(SupportMotion(sway, (1.0, 0.0)), support)
    problem = scene.problem((0.0, 2.0))
    return problem, mass, problem.integrate(h=1e-3, save_every=10)


def waving(problem):
    """Return a run in which all degrees of freedom move together."""
    u0, t = np.asarray(problem.u0, dtype=float), np.linspace(*problem.t_span, 200)
    wave = 0.05 * (np.abs(u0).max() or 1.0) * np.sin(20 * t / t[-1])
    return made_up(t, wave.reshape(-1, *[1] * u0.ndim) + u0)


def test_a_film_has_twenty_frames_a_second_and_lasts_six_to_ten_seconds():
    for duration in np.geomspace(1e-6, 1e6, 400):
        seconds = duration / film_speed(duration)
        assert 6 <= seconds <= 10
    assert [film_speed(t) for t in (6.0, 10.0, 80.0, 0.8)] == [1.0, 1.0, 10.0, 0.1]


def test_of_a_motion_with_many_periods_the_first_are_shown():
    assert shown_duration(20.0, 10.0) == 20.0
    assert shown_duration(100.0, 50.0) == 8.0  # four periods in real time
    assert shown_duration(1.0, 100.0) == pytest.approx(0.16)  # sixteen periods


def test_excursions_are_periods():
    t = np.linspace(0, 5, 5002)
    assert excursions(made_up(t, np.cos(2 * np.pi * t))) == pytest.approx(5, rel=1e-4)  # not all peaks are states


def test_frames_are_read_between_the_saved_states_and_a_support_is_where_it_is(swinging):
    problem, mass, solution = swinging
    figure, show, film = staged(problem, solution)
    np.testing.assert_allclose(np.diff(film.t), film.speed / RATE, rtol=1e-9)
    u = solution.at(film.t)[0]
    for i in (0, 37, len(film.t) - 1):
        show(i)
        np.testing.assert_array_equal(dots(figure.axes[0], "o"), [mass.positions(u)[i]])
        np.testing.assert_allclose(dots(figure.axes[0], "^"), [[1 + 0.3 * np.sin(2 * film.t[i]), 2.0]], rtol=1e-14)
        (spring,) = figure.axes[0].collections[0].get_segments()
        np.testing.assert_allclose(spring[[0, -1]], [*dots(figure.axes[0], "^"), *dots(figure.axes[0], "o")])
        assert f"t = {film.t[i]:.2f} s" in texts(figure)


def test_the_whole_motion_is_within_the_limits_at_one_scale_above_a_filled_plane(swinging):
    problem, mass, solution = swinging
    figure, show, _ = staged(problem, solution)
    figure.canvas.draw()
    axes = figure.axes[0]
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    x, y = mass.positions(solution.u).T
    assert left < x.min() < x.max() < right
    assert low < y.min() < 2 < high  # the support is at 2 m
    box = axes.get_window_extent()
    assert box.width / (right - left) == pytest.approx(box.height / (high - low), rel=1e-9)
    show(60)
    assert (axes.get_xlim(), axes.get_ylim()) == ((left, right), (low, high))
    (ground,) = axes.patches
    assert ground.get_path().contains_point((1.0, 0.49))
    assert not ground.get_path().contains_point((1.0, 0.51))


def test_a_scene_of_one_dimension_stands_upright_under_gravity_and_its_string_breaks():
    scene = Scene(dimension=1)
    hook, ball = scene.fixed(2.0), scene.mass(2.0, 1.0)
    scene.add(Gravity(-9.81))
    scene.add(BreakingString(stiffness=200.0, rest_length=1.0, strength=30.0), hook, ball)
    scene.add(RigidStop(normal=1.0, restitution=0.6), ball)
    problem = scene.problem((0, 1))
    t = np.linspace(0, 1, 101)
    fall = made_up(t, np.column_stack([1 - t**2 / 2, t > 0.5]))
    figure, show, film = staged(problem, fall)
    axes = figure.axes[0]
    for i in (0, np.searchsorted(film.t, 0.49) - 1, np.searchsorted(film.t, 0.51), len(film.t) - 1):
        show(i)
        np.testing.assert_array_equal(dots(axes, "o"), [[0.0, film.u[i, 0]]])
        assert len(axes.collections[0].get_segments()) == (film.t[i] < 0.5)
    assert axes.get_ylabel() == "x (m)"
    assert axes.patches[0].get_path().contains_point((0, -0.01))


def test_a_scene_in_space_is_drawn_in_space():
    scene = Scene(dimension=3)
    post, balls = scene.fixed((0, 0, 1)), scene.mass(1.0, [(0, 0, 0.5), (0.3, 0, 0.5)])
    scene.add(LinearSpring(100.0, 0.4), post, balls[0])
    scene.add(HertzContact(1e4, contact_distance=0.2), balls[0], balls[1])  # which is not a line
    scene.add(Gravity((0, 0, -9.81)))
    scene.add(PlaneContact(1e5, normal=(0.6, 0, 0.8), offset=0.1), balls)  # their radius
    problem = scene.problem((0, 1))
    t = np.linspace(0, 1, 101)
    figure, show, film = staged(problem, made_up(t, problem.u0 - 0.3 * np.sin(t)[:, None] * np.arange(6)))
    axes = figure.axes[0]
    show(20)
    figure.canvas.draw()
    (lines,) = [artist for artist in axes.collections if isinstance(artist, art3d.Line3DCollection)]
    assert len(lines.get_segments()) == 1
    polygons = [part for part in axes.collections if isinstance(part, art3d.Poly3DCollection)]
    (plane,), balls = (np.asarray(part._faces)[..., :3] for part in polygons)
    centres = film.u[20].reshape(3, 2).T
    np.testing.assert_allclose(balls.mean(axis=1), centres, rtol=0, atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(balls - centres[:, None], axis=2), 0.1, rtol=1e-12)
    np.testing.assert_allclose(plane @ [0.6, 0, 0.8], 0, atol=1e-12)  # m; its corners are in the plane
    limits = np.array([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()]).T
    assert (plane >= limits[0] - 1e-12).all()
    assert (plane <= limits[1] + 1e-12).all()


@pytest.mark.parametrize("contact", [lambda reach: HertzContact(1e5, reach), lambda reach: MassImpact(reach)])
def test_contacts_are_discs_of_their_radius(contact):
    """Three balls on a floor, each of which touches it, and a post that they can strike. Pixels tell what is drawn."""
    radii = np.array([0.1, 0.2, 0.3])
    scene = Scene(dimension=2)
    balls, post = scene.mass(1.0, np.array([[0.0, 0.1], [0.5, 0.2], [1.2, 0.3]])), scene.fixed((2.0, 0.5))
    first, second = np.triu_indices(3, 1)
    scene.add(contact(radii[first] + radii[second]), balls[first], balls[second])
    scene.add(contact(radii + 0.15), balls, post)
    scene.add(PlaneContact(1e5, normal=(0.0, 1.0), offset=radii))
    problem = scene.problem((0, 1))
    np.testing.assert_allclose(problem.view.radii, [*radii, 0.15], rtol=1e-12)
    t = np.linspace(0, 1, 101)
    motion = 0.1 * np.sin(3 * t)[:, None] * np.repeat([1.0, 0.0], 3)  # to the right
    figure, show, film = staged(problem, made_up(t, problem.u0 + motion))
    show(40)
    figure.canvas.draw()
    axes, pixels = figure.axes[0], np.asarray(figure.canvas.buffer_rgba())

    def color(x, y):
        column, row = axes.transData.transform((x, y))
        return pixels[len(pixels) - 1 - int(row), int(column), :3].tolist()

    points = np.vstack([film.u[40].reshape(2, 3).T, [2.0, 0.5]])
    for (x, y), radius in zip(points, [*radii, 0.15], strict=True):
        for angle in np.radians([20, 90, 160]):  # above the floor
            way = np.array([np.cos(angle), np.sin(angle)])
            assert color(*((x, y) + 0.85 * radius * way)) != [255, 255, 255]
            assert color(*((x, y) + 1.15 * radius * way)) == [255, 255, 255]
    (floor,) = axes.patches
    assert floor.get_path().contains_point((0.5, -1e-6))
    assert not floor.get_path().contains_point((0.5, 1e-6))
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    assert (left < (points[:, 0] - problem.view.radii)).all()
    assert (right > (points[:, 0] + problem.view.radii)).all()
    assert low < 0 < 0.65 < high


def test_two_balls_share_their_reach_and_contacts_without_reach_have_no_disc():
    scene = Scene(dimension=1)
    balls = scene.mass(1.0, [0.0, 1.0, 3.0])
    scene.add(MassImpact(0.4), balls[0], balls[1])
    scene.add(MassImpact(), balls[1], balls[2])
    radii = scene.problem((0, 1)).view.radii
    np.testing.assert_allclose(radii, [0.2, 0.2, 0.0], rtol=1e-12)


def test_sampled_motions_add_up():
    scene = Scene(dimension=1)
    ground, mass = scene.fixed(0.5), scene.mass(1.0, 1.0)
    scene.add(LinearSpring(10.0, 0.5), ground, mass)
    scene.add(SampledMotion([0.0, 4.0], [0.0, 2.0]), ground)
    scene.add(SampledMotion([0.0, 1.0], [0.0, 1.0], direction=(-2.0,)), ground)
    places = scene.problem((0, 5)).view.places(np.array([0.0, 0.5, 2.0]), np.ones((3, 1)))
    np.testing.assert_allclose(places[:, 0], [[0.5, 0], [-0.25, 0], [-0.5, 0]], rtol=1e-14)
    np.testing.assert_array_equal(places[:, 1], [[1.0, 0]] * 3)


@pytest.mark.parametrize("name", problems.__all__)
def test_every_problem_has_a_picture_that_moves(name):
    few = {"sand_column": 200, "argon": 4, "hopper": 1000, "butane": 2}  # spheres and discs, which take seconds
    problem = getattr(problems, name)(**{"n": few[name]} if name in few else {})
    figure, show, film = staged(problem, waving(problem))
    pictures = []
    for i in (0, len(film.t) - 1):
        show(i)
        figure.canvas.draw()
        figure.set_layout_engine("none")  # as in a film
        pictures.append(np.asarray(figure.canvas.buffer_rgba()).copy())
        assert any(text.startswith("t = ") for text in texts(figure))
    assert (pictures[0] != pictures[1]).any()
    for axes in figure.axes:
        assert axes.get_xlabel() or not len(axes.get_xticks())
        assert axes.get_ylabel() or not any(label.get_visible() for label in axes.get_yticklabels())
        assert axes.get_window_extent().width > 50  # pixels


def check_frames(problem, solution):
    """Check the pixels of some frames against a whole drawing; return whether all are drawn on one background."""
    (figure, show, film), (other, show_other, _) = (staged(problem, solution) for _ in range(2))
    for each in (figure, other):
        each.canvas.draw()
        each.set_layout_engine("none")
    last = len(film.t) - 1
    redraw = Redraw(other, show_other, last)
    for i in (0, 29, 30, last, 5):
        show(i)
        figure.canvas.draw()
        np.testing.assert_array_equal(redraw(i), np.asarray(figure.canvas.buffer_rgba())[..., :3])
    return redraw.background is not None


@pytest.mark.parametrize("name", ["bouncing_ball", "butane", "elastic_bar", "flag", "henon_heiles", "quarter_car"])
def test_frames_are_those_of_a_whole_drawing(name):
    """Views in the plane and in space, with faces and balls, and with limits that move."""
    problem = getattr(problems, name)(**{"n": 2} if name == "butane" else {})
    assert check_frames(problem, waving(problem))


@pytest.mark.parametrize("change", ["limits", "camera", "ticks", "place", "hidden", "added"])
def test_a_view_may_change_anything_in_a_frame(change):
    """What differs neither in the first frame nor in the last is still drawn where it changes."""

    def view(figure, film):
        axes = figure.add_subplot(projection="3d" if change == "camera" else None)
        (line,) = axes.plot([0.0], [0.0], *([[0.0]] if change == "camera" else []), "o")
        bar = axes.axvspan(0, 0.01, zorder=0) if change != "camera" else None
        state = [False, None]  # whether something has changed, and what was added

        def show(i):
            line.set_color("C1" if i % 2 else "C2")
            now = 25 < i < 32
            if now == state[0]:
                return
            if change == "limits":
                axes.set_xlim(0, 2 if now else 1)
            elif change == "camera":
                axes.view_init(30, 10 if now else -60)
            elif change == "ticks":
                axes.xaxis.get_major_ticks()[0].label1.set_color("C3" if now else "k")
            elif change == "place":
                axes.set_position((0.2, 0.2, 0.3 if now else 0.6, 0.6))
            elif change == "hidden":
                bar.set_visible(not now)
            elif now:
                state[1] = axes.axvspan(0.01, 0.03, zorder=-1)
            else:
                state[1].remove()
            state[0] = now

        return show

    problem = problems.single_dof(t_end=8.0).with_(view=view)
    t = np.linspace(0, 8, 200)
    assert not check_frames(problem, made_up(t, np.sin(t)))


def portrait(figure, film):
    """A view of a module that another process cannot import."""
    return Portrait()(figure, film)


def test_two_processes_draw_the_same_film(still, tmp_path, monkeypatch):
    """The second one ends with 0, 1, or does not start. Without it this one draws all frames."""
    problem, solution = still
    alone = problem.with_(view=Portrait()).animate(solution, tmp_path / "alone.gif").read_bytes()
    started = []
    start = second_process._start
    monkeypatch.setattr(second_process, "_start", lambda *given: started.append(start(*given)) or started[-1])
    monkeypatch.setattr(second_process, "cores", lambda: 2)
    monkeypatch.setattr(second_process, "_LEAST", 0.0)
    monkeypatch.setattr(second_process, "_START", 0.0)
    for view in (Portrait(), portrait, lambda *given: portrait(*given)):
        assert problem.with_(view=view).animate(solution, tmp_path / "shared.gif").read_bytes() == alone
    assert [process and process.returncode for process in started] == [0, 1, None]


def test_a_second_process_ends_with_an_interrupt(monkeypatch):
    monkeypatch.setattr(second_process, "cores", lambda: 2)
    program = [sys.executable, "-c", "import time; time.sleep(600)"]
    process = subprocess.Popen(program)
    monkeypatch.setattr(second_process, "_start", lambda *given: process)
    monkeypatch.setattr(second_process, "_LEAST", 0.0)
    with pytest.raises(KeyboardInterrupt), second_process.with_second_process(lambda: np.zeros, 8):
        raise KeyboardInterrupt
    assert process.poll() is not None


@pytest.mark.parametrize("name", ["spring_pendulum", "double_pendulum", "kepler"])
def test_paths_reach_the_point_that_moves(name):
    problem = getattr(problems, name)()
    figure, show, film = staged(problem, waving(problem))
    show(90)
    *_, path, trail = [line.get_xydata() for line in figure.axes[0].lines if line.get_linestyle() == "-"]
    place = dots(figure.axes[0], "o")[-1] if name != "kepler" else film.u[90]
    np.testing.assert_allclose([path[-1], trail[-1]], [place] * 2, rtol=1e-12)
    assert len(trail) < len(path)


def test_a_bar_is_drawn_over_its_length():
    problem = problems.elastic_bar(n=50)
    figure, show, film = staged(problem, waving(problem))
    show(12)
    line = figure.axes[0].lines[-1]
    np.testing.assert_allclose(line.get_xdata(), np.arange(1, 51) / 51, rtol=1e-14)
    np.testing.assert_array_equal(line.get_ydata(), film.u[12])


def test_buildings_touch_where_their_floors_do():
    problem = problems.pounding_buildings()
    u = np.array([[-0.03, -0.02, 0.01, 0.0, 0.02, 0.01]])  # m; the third floors meet
    x = problem.view.places(np.zeros(1), u)[0]
    left, right = x[:8], x[8:]
    assert left[7].tolist() == right[6].tolist()
    assert (left[[1, 3, 5], 0] < right[[0, 2, 4], 0]).all()


def test_a_run_with_states_too_far_apart_is_made_again_for_a_shorter_time():
    problem = problems.two_frequency_oscillator(t_end=100.0)
    solution = problem.integrate(h=2e-4, save_every=500)
    assert not is_resolved(solution)
    shorter = _resolved(problem, solution, lambda shorter: _steps(shorter, 2e-4, None, None))
    assert is_resolved(shorter)
    assert 2 * np.pi / 1000 < shorter.t[-1] < 100  # s; it contains a period of the fast mode


def test_a_run_that_diverged_is_shown_up_to_the_growth():
    problem = problems.single_dof(t_end=20.0)
    solution = problem.integrate(h=0.52)
    assert solution.status is eig3.Status.DIVERGED
    figure, show, film = staged(problem, solution)
    assert film.t[-1] < solution.t[-1]
    assert any("diverged, shown up to t = " in text for text in texts(figure))
    show(len(film.t) - 1)
    low, high = figure.axes[0].get_ylim()
    assert -20 < low < high < 20


def test_states_too_far_apart_are_refused(swinging, tmp_path):
    """The second run has two states, which do not tell where the ball was between them: it rebounds from a contact."""
    oscillator, (ball, _, _) = problems.single_dof(t_end=100.0), swinging
    for problem, options in ((oscillator, {"h": 0.01, "save_every": 1000}), (ball, {"h": 1e-3, "save_every": None})):
        with pytest.raises(ValueError, match=r"^solution must have states closer together .*smaller save_every"):
            problem.animate(problem.integrate(**options), tmp_path / "film.gif")
    assert not any(tmp_path.iterdir())


def test_a_run_that_failed_at_its_first_step_has_no_motion_to_show(tmp_path):
    problem = problems.single_dof()
    solution = problem.integrate(h=1e200, t_end=1e201)  # its square overflows
    assert len(solution.t) == 1
    with pytest.raises(ValueError, match=r"^solution has no motion to show, because it has fewer than two states"):
        problem.animate(solution, tmp_path / "film.gif")


def test_long_paths_are_read_in_parts(swinging, monkeypatch):
    film = Film.of(swinging[2])
    sizes = []
    monkeypatch.setattr(film_module, "_VALUES", 200)  # 100 states of two displacements
    second = film.path(lambda t, u: sizes.append(len(t)) or u[:, 1])
    assert max(sizes) == 100
    np.testing.assert_array_equal(second, film.solution.at(film.times)[0][:, 1])


def test_a_problem_without_a_view_shows_its_degrees_of_freedom(tmp_path):
    @eig3.jit
    def rhs(t, u, v, p, a):
        a[0], a[1] = -u[0], -4 * u[1]

    problem = eig3.Problem("plain", rhs, (1.0, 0.5), (0.0, 0.0), (), (0.0, 7.0), names=("left", "right"))
    figure, show, film = staged(problem, waving(problem))
    show(30)
    (axes,) = figure.axes
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["left", "right"]
    marks = [line.get_xydata()[0] for line in axes.lines if line.get_marker() == "o"]
    np.testing.assert_array_equal(marks, [(film.t[30], u) for u in film.u[30]])


def test_a_time_without_unit_has_none():
    problem = problems.henon_heiles(t_end=40.0)
    figure, _, _ = staged(problem, waving(problem))
    assert "t = 0.0" in texts(figure)
    assert "5 units of time a second" in texts(figure)


def test_changed_problems_keep_their_view_unless_params_change(swinging):
    problem, _, _ = swinging
    assert problem.with_(u0=[1.2, 1.1]).view is problem.view
    assert problem.with_(params=problem.params * 1.01).view is None
    view = Portrait()
    assert problem.with_(params=problem.params * 1.01, view=view).view is view


def test_views_can_be_pickled(swinging):
    problem, _, solution = swinging
    view = pickle.loads(pickle.dumps(problem.view))
    np.testing.assert_array_equal(
        view.places(solution.t[:5], solution.u[:5]), problem.view.places(solution.t[:5], solution.u[:5])
    )


@pytest.fixture
def brief(monkeypatch):
    """Films last three tenths of a second, so that they are written quickly."""
    monkeypatch.setattr(film_module, "_SECONDS", 0.3)
    monkeypatch.setattr(film_module, "_REAL_TIME", (0.2, 0.4))


@pytest.fixture
def still(brief):
    """A small problem and its solution."""
    problem = problems.single_dof(t_end=0.5)
    return problem, problem.integrate(h=0.01)


def test_the_gif_has_all_frames_at_their_times(brief, swinging, tmp_path):
    problem, _, solution = swinging
    path = problem.animate(solution, tmp_path / "swing.gif")
    assert path == tmp_path / "swing.gif"
    with Image.open(path) as film:
        assert film.n_frames == len(Film.of(solution).t) == 8  # of about three tenths of a second
        assert film.info["duration"] == 1000 / RATE
        assert film.info["loop"] == 0  # without end
        assert film.size == (480, 360)
        pictures = []
        for i in (0, 3, 7):
            film.seek(i)
            pictures.append(np.asarray(film.convert("RGB")))
    assert all((one != other).any() for one, other in pairwise(pictures))
    assert pictures[0][-1, -1].tolist() == [255, 255, 255]


def test_of_many_curves_the_first_and_the_last_are_drawn_in_different_colours(brief, tmp_path):
    """A palette keeps the colours of the legend too, where curves lie on each other."""
    names = tuple(f"floor {i}" for i in range(12))
    t = np.linspace(0, 6, 121)
    solution = made_up(t, np.outer(np.sin(t), np.ones(12)))
    curves = Curves(Labels(names))
    figure = Figure()
    stage(figure, curves, Film.of(solution), solution)
    legend = figure.axes[0].get_legend()
    found = [text.get_text() for text in legend.get_texts()]
    assert legend.get_title().get_text() == "10 of 12"
    assert len(found) == 10
    assert (found[0], found[-1]) == (names[0], names[-1])
    with Image.open(animate_module.animate(curves, solution, tmp_path / "floors.gif")) as film:
        pixels = np.asarray(film.convert("RGB"))[:, 350:].reshape(-1, 3)
    colours, counts = np.unique(pixels, axis=0, return_counts=True)
    # a line of the legend has 20 x 2 pixels, and one of the ten colours is grey
    assert np.sum((counts >= 36) & (np.ptp(colours.astype(int), axis=1) > 20)) == 9


def test_the_page_has_its_frames_and_refers_to_nothing_else(still, tmp_path):
    problem, solution = still
    page = problem.animate(solution, tmp_path / "LAST_RUN of $frames & FRAMES.html").read_text()
    assert "<title>LAST_RUN of $frames &amp; FRAMES</title>" in page
    assert page.count("iVBORw0KGgo") == len(Film.of(solution).t)  # the first bytes of a PNG file
    assert "http" not in page
    assert "src=" not in page.replace("image.src =", "")
    assert "Pause" in page


@pytest.fixture
def counting(tmp_path_factory, monkeypatch):
    """A program in the place of ffmpeg counts what it gets, and writes the number to its last argument."""
    program = tmp_path_factory.mktemp("programs") / "ffmpeg"
    program.write_text(
        f"#!{sys.executable}\nimport sys\nname = sys.argv[-1].removeprefix('file:')\n"
        "open(name, 'w').write(str(len(sys.stdin.buffer.read())))\n"
    )
    program.chmod(0o755)
    monkeypatch.setattr(shutil, "which", lambda name: str(program))


@pytest.mark.parametrize("kind", ["gif", "html", "mp4"])
def test_an_older_film_stays_until_the_new_one_is_complete(still, tmp_path, counting, kind):
    def view(figure, film):
        def show(i):
            if i == 5:
                raise KeyboardInterrupt

        return show

    problem, solution = still
    path = tmp_path / f"film.{kind}"
    path.write_text("older")
    with pytest.raises(KeyboardInterrupt):
        problem.with_(view=view).animate(solution, path)
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_text() == "older"
    problem.animate(solution, path)
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_bytes() != b"older"
    if kind == "mp4":
        assert int(path.read_text()) == len(Film.of(solution).t) * 480 * 360 * 3  # bytes of all frames


def test_an_error_of_ffmpeg_is_reported(still, tmp_path, monkeypatch):
    program = tmp_path / "ffmpeg"
    program.write_text(f"#!{sys.executable}\nimport sys\nsys.exit('no encoder')\n")
    program.chmod(0o755)
    monkeypatch.setattr(shutil, "which", lambda name: str(program))
    with pytest.raises(OSError, match=r"^ffmpeg could not write film.mp4: no encoder"):
        still[0].animate(still[1], tmp_path / "film.mp4")


def test_without_ffmpeg_a_sentence_says_what_to_install(still, tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(ImportError, match=r"^mp4 needs ffmpeg, which was not found: pip install imageio-ffmpeg"):
        still[0].animate(still[1], tmp_path / "film.mp4")
    assert not (tmp_path / "film.mp4").exists()
    with pytest.raises(SystemExit, match=r"^eig3 run: mp4 needs ffmpeg"):
        main(["run", "single_dof", "--animate", "--format", "mp4"])


def test_without_matplotlib_a_sentence_says_what_to_install(still, tmp_path, monkeypatch):
    monkeypatch.setattr(writers_module, "find_spec", lambda name: None)
    with pytest.raises(ImportError, match=r"^an animation needs matplotlib: pip install 'eig3\[plot\]'\.$"):
        still[0].animate(still[1], tmp_path / "film.gif")


def test_other_formats_and_folders_are_refused(still, tmp_path):
    for name in ("film", "film.avi"):
        with pytest.raises(ValueError, match=f"^path must end with .gif or .mp4 or .html, not '{name}'"):
            still[0].animate(still[1], tmp_path / name)
    with pytest.raises(TypeError, match=r"^solution must be a Solution, such as a member ensemble\[0\], not list"):
        still[0].animate([still[1]], tmp_path / "film.gif")
    with pytest.raises(FileNotFoundError, match=r"^path must be in an existing folder: create '.*films' first\.$"):
        still[0].animate(still[1], tmp_path / "films" / "film.gif")


def test_the_command_writes_a_film_beside_the_other_files_or_here(brief, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    command = ["run", "single_dof", "--t-end", "0.6", "--animate"]
    assert main(command) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["single_dof.gif"]
    assert "Written to .: single_dof.gif" in capsys.readouterr().out
    assert main([*command, "--format", "html", "--out", "out"]) == 0
    assert {path.suffix for path in (tmp_path / "out").iterdir()} == {".npz", ".csv", ".png", ".html"}


def test_the_beginning_of_a_run_is_called_so(brief, tmp_path, monkeypatch):
    """The run has too few states for a film. A shorter run has enough, and is shown as a part of the run."""
    said = []
    monkeypatch.setattr(animate_module, "captions", lambda *given: said.extend(captions(*given)) or said)
    monkeypatch.setattr(run_module, "_STATES", 10)
    monkeypatch.chdir(tmp_path)
    assert main(["run", "single_dof", "--t-end", "100", "--h", "0.01", "--animate"]) == 0
    assert any(line.startswith("the first ") for line in said)


def test_a_step_that_is_too_long_is_refused_before_the_run(tmp_path, monkeypatch, capsys):
    """The remedy is a step with which the film can be made, so that nobody has to guess one."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit, match=r"^eig3 run: h = 0\.5 is too long for an animation .* take h = 0\.062 or"):
        main(["run", "single_dof", "--h", "0.5", "--animate"])
    assert not list(tmp_path.iterdir())
    assert not capsys.readouterr().out
    assert is_resolved(problems.single_dof(t_end=250.0).integrate(h=0.062))


def test_a_format_without_a_film_is_refused():
    with pytest.raises(SystemExit, match=r"^eig3 run: --format is the format of an animation: give --animate too"):
        main(["run", "single_dof", "--format", "gif"])
