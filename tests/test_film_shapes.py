"""What films draw besides points: the shapes of bodies, periodic boxes, and limits without points that fly away."""

import json
import re
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import eig3
from eig3.animation import Film, Mechanism, Solid, film
from eig3.animation import axes as axes_module
from eig3.animation.look import Look
from eig3.animation.shapes import edges_of_box, half_size, surface
from eig3.effects import Gravity, HertzContact, HertzMindlin, LinearSpring
from eig3.problems import tumbling_box
from eig3.scene import Scene

from .conftest import flying, made_up

pytest.importorskip("matplotlib")

from matplotlib import colormaps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure


def axes_of(view, solution):
    """Draw the last frame of a film, and return its axes."""
    figure = Figure()
    FigureCanvasAgg(figure)
    film = Film.of(solution)
    view(figure, film)(len(film.t) - 1)
    figure.canvas.draw()
    return figure.axes[0]


AXES = np.diag([0.2, 0.2, 0.7])


def is_on_cylinder(x):
    across, along = np.hypot(x[..., 0], x[..., 1]) / 0.2, abs(x[..., 2]) / 0.7
    return (np.isclose(across, 1) & (along <= 1 + 1e-12)) | (np.isclose(along, 1) & (across <= 1 + 1e-12))


SHAPES = {
    "box": lambda x: (abs(x / np.diag(AXES)) == 1).all(axis=-1),
    "sphere": lambda x: np.isclose(np.square(x / np.diag(AXES)).sum(axis=-1), 1),
    "cylinder": is_on_cylinder,
    # the distance from the part of the axis between the middles of the half balls
    "capsule": lambda x: np.isclose(np.hypot(np.hypot(*x.T[:2]), np.maximum(abs(x.T[2]) - 0.5, 0)).T, 0.2),
}


@pytest.mark.parametrize("kind", SHAPES)
def test_the_corners_of_faces_are_on_the_surface(kind):
    """The body is turned and moved; round-off is some 1e-16."""
    turned = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    centre = np.array([1.0, 2.0, 3.0])
    x = np.concatenate([[centre], centre + AXES @ turned])[None]
    faces = (surface(Solid(kind, (0, 1, 2, 3)), x)[0] - centre) @ turned.T
    assert SHAPES[kind](np.round(faces, 13)).all()
    sides = faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0]
    assert (np.linalg.norm(np.cross(*sides), axis=1) > 1e-6).all()  # the light on a face needs its first corners


def test_bodies_in_the_plane_are_outlines():
    x = np.array([[[0.0, 0.0], [0.3, 0.0], [0.0, 0.2]]])
    box, ball = (surface(Solid(kind, (0, 1, 2)), x)[0, 0] for kind in ("box", "sphere"))
    np.testing.assert_allclose(sorted(map(tuple, box)), [(-0.3, -0.2), (-0.3, 0.2), (0.3, -0.2), (0.3, 0.2)])
    np.testing.assert_allclose(np.square(ball / [0.3, 0.2]).sum(axis=1), 1)


def test_a_free_body_is_a_box_with_its_inertia():
    problem, t = tumbling_box(), np.linspace(0, 1, 11)
    faces = axes_of(problem.view, made_up(t, problem.u0 + t[:, None] * (np.arange(12) == 0))).collections[-1]
    corners = np.unique(np.round(np.asarray(faces._faces)[..., :3].reshape(-1, 3), 9), axis=0)
    assert len(corners) == 8
    lengths = np.unique(np.round(np.linalg.norm(corners - corners[0], axis=1), 6))
    assert {0.1, 0.2, 0.3} <= set(lengths)  # three of the distances between corners are the sides


def test_points_are_inside_their_box_with_its_edges():
    side, random = np.full(3, 1.2), np.random.default_rng(3)
    scene = Scene(dimension=3, box=side)
    scene.mass(1.0, random.random((20, 3)) * side, random.normal(size=(20, 3)))
    scene.add(Gravity((0.0, 0.0, -0.1)))
    problem = scene.problem((0, 1))
    solution = flying(problem)
    x = problem.view.places(solution.t[-1:], solution.u[-1:])[0]
    assert ((x < 0) | (x > side)).any()  # the places themselves leave the box
    axes = axes_of(problem.view, solution)
    edges = edges_of_box(np.zeros(3), side)
    (lines,) = axes.collections
    np.testing.assert_allclose(lines._segments3d, edges)
    limits = np.array([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()]).T
    np.testing.assert_allclose(limits, [-0.08 * side, 1.08 * side], rtol=1e-12)


def test_a_link_across_the_boundary_of_a_box_is_not_drawn():
    t = np.linspace(0, 1, 11)

    def places(t, u):
        return np.stack(
            [np.column_stack([2.8 + 0.5 * t, 1 + 0 * t]), np.column_stack([2.6 + 0 * t, 1 + 0 * t])], axis=1
        )

    mechanism = Mechanism(places, links=[(0, 1)], box=(3.0, 2.0))
    shown = mechanism._is_inside(np.stack([places(t, t) % 3.0], axis=1))
    np.testing.assert_array_equal(shown[:, 0], 2.8 + 0.5 * t < 3.0)


def test_two_discs_of_a_few_do_not_scale_the_film():
    """The others stay within 1 m, and all of them are in the picture."""
    scene = Scene(dimension=2)
    places = np.stack(np.meshgrid(np.linspace(0, 1, 6), np.linspace(0, 1, 6)), axis=-1).reshape(-1, 2)
    velocities = np.zeros((36, 2))
    velocities[:2] = 30.0, 0.0  # to the same side
    scene.mass(1.0, places, velocities)
    scene.add(Gravity((0.0, -0.1)))
    problem = scene.problem((0, 1))
    solution = flying(problem)
    axes = axes_of(problem.view, solution)
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    assert right < 3.0
    assert left < 0.0 < 1.0 < right
    assert low < -0.05 < 1.0 < high
    colored = axes_of(partial(problem.view, look=Look.of(problem.view, solution, color="speed")), solution)
    assert colored.figure.axes[1].get_ylim()[1] < 1.0  # m/s, without the two
    whole = partial(problem.view, look=Look.of(problem.view, solution, limits="all"))
    assert axes_of(whole, solution).get_xlim()[1] > 30.0


@pytest.mark.parametrize("kind", SHAPES)
def test_a_body_reaches_as_far_as_its_surface(kind):
    """The polygons of a round body have 24 sides, inside the surface by at most 1 - cos(pi / 24) of its size."""
    turned = AXES @ np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    corners = surface(Solid(kind, (0, 1, 2, 3)), np.concatenate([np.zeros((1, 3)), turned])[None])[0].reshape(-1, 3)
    reach, found = half_size(kind, turned[None])[0], corners.max(axis=0)
    assert (found <= reach * (1 + 1e-12)).all()
    np.testing.assert_allclose(found, reach, rtol=0, atol=(1 - np.cos(np.pi / 24)) * np.linalg.norm(np.diag(AXES)))


def still(x, velocity=0.0, **fields):
    """Return a mechanism of points that move along x by u, and a run in which u = velocity t."""
    t = np.linspace(0.0, 1.0, 11)
    u = velocity * t[:, None] * np.eye(np.shape(x)[1])[0]
    return Mechanism(lambda t, u: np.asarray(x) + u[:, None], **fields), made_up(t, u)


def pixels_of(mechanism, solution, **look):
    """Return the axes and the pixels of the last frame."""
    view = partial(mechanism, look=Look.of(mechanism, solution, **look))
    axes = axes_of(view, solution)
    return axes, np.asarray(axes.figure.canvas.buffer_rgba())[..., :3]


def color_at(axes, pixels, place):
    from mpl_toolkits.mplot3d.proj3d import proj_transform

    flat = proj_transform(*place, axes.get_proj())[:2] if len(place) == 3 else place
    column, row = axes.transData.transform(flat)
    return pixels[len(pixels) - 1 - int(row), int(column)].astype(int)


def test_a_cloth_on_a_ball_covers_it_and_the_ball_covers_the_cloth_behind_it():
    """The cloth is a square above the ball; the camera looks from above, and then from below."""
    square = [(-1, -1, 0.6), (1, -1, 0.6), (1, 1, 0.6), (-1, 1, 0.6)]
    given = {"faces": [(1, 2, 3, 4)], "hidden": [1, 2, 3, 4], "fixed": [0], "radii": [0.5, 0, 0, 0, 0]}
    mechanism, solution = still([(0, 0, 0), *square], **given)
    above, below = (pixels_of(mechanism, solution, camera=(-60, angle)) for angle in (80, -80))
    blue, grey = (color_at(*seen, (0.0, 0.0, z)) for seen, z in ((above, 0.6), (below, -0.5)))
    assert blue[2] > blue[0] + 50
    assert np.ptp(grey) < 30  # the ball lets a fifth of the cloth behind it through


def test_many_faces_are_drawn_as_the_polygons_of_a_few(monkeypatch):
    """A folded sheet on a plane; its nearer part covers the other. Only the pixels at the edges of faces may differ."""
    a, b = (each.ravel() for each in np.meshgrid(np.linspace(-1, 1, 36), np.linspace(-1, 1, 36)))
    number = np.arange(36**2).reshape(36, 36)
    corners = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    faces = np.stack(corners, axis=-1).reshape(-1, 4)
    sheet = np.stack([np.sin(3 * a), b + 0.3 * a, 0.4 * np.cos(3 * a)], axis=1)
    planes = [((0.0, 0.0, 1.0), -0.45)]
    mechanism, solution = still(sheet, faces=faces, hidden=np.arange(36**2), planes=planes)
    look = {"color": np.tile(b, (11, 1)), "limits": ((-1.2, 1.2), (-1.2, 0.9), (-0.5, 0.5))}
    _, found = pixels_of(mechanism, solution, **look)
    monkeypatch.setattr(axes_module, "_MANY", 2000)
    _, wanted = pixels_of(mechanism, solution, **look)
    away = np.abs(found.astype(int) - wanted).max(axis=2)
    assert (away > 0).any()  # drawn in another way
    assert np.mean(away > 10) < 0.005  # of 255; the sheet covers 0.23 of the picture


def test_limits_are_the_axes_and_what_is_outside_in_space_is_not_drawn():
    x = [(0, 0, 0), (5, 0, 0)]
    mechanism, solution = still(x, radii=[0.3, 0.3], links=[(0, 1)])
    limits = ((-1, 1), (-1, 2), (-1, 1.5))
    axes, _ = pixels_of(mechanism, solution, limits=limits)
    assert (axes.get_xlim(), axes.get_ylim(), axes.get_zlim()) == limits
    lines, balls = axes.collections
    assert len(balls.get_paths()) == 1
    assert not len(lines.get_segments())
    mechanism, solution = still([(0, 0), (5, 0)])
    axes, _ = pixels_of(mechanism, solution, limits=((0, 1), (0, 2)))
    assert (axes.get_xlim(), axes.get_ylim()) == ((0, 1), (0, 2))


def test_a_camera_has_its_azimuth_elevation_and_distance():
    mechanism, solution = still([(0, 0, 0), (1, 1, 1)])
    axes, near = pixels_of(mechanism, solution, camera=(25, -10))
    assert (axes.azim, axes.elev) == (25, -10)
    _, far = pixels_of(mechanism, solution, camera=(25, -10, 2))
    height, less = (np.ptp(np.flatnonzero((pixels < 240).any(axis=(1, 2)))) for pixels in (near, far))
    assert less < 0.7 * height


def test_many_discs_have_their_place_and_area():
    """A disc is a polygon of 24 sides: its area is 12 sin(pi / 12) of the square of its radius."""
    x = np.stack(np.meshgrid(np.arange(40.0), np.arange(30.0)), axis=-1).reshape(-1, 2)
    radii = np.tile([0.2, 0.4], len(x) // 2)
    axes, pixels = pixels_of(*still(x, radii=radii))
    (left, right), (low, high) = axes.transData.transform([(-0.5, -0.5), (39.5, 29.5)]).T
    inside = pixels[len(pixels) - round(high) : len(pixels) - round(low), round(left) : round(right)]
    cover = (255 - inside[..., 0]) / (0.8 * (255 - int("1f", 16)))  # of C0 with the opacity 0.8
    scale = (right - left) / 40
    assert cover.sum() == pytest.approx(12 * np.sin(np.pi / 12) * np.sum((scale * radii) ** 2), rel=0.01)  # 1 of 255


VALUES = np.tile([0.0, 1.0, 3.0], (11, 1))


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("radius", [0.0, 0.3])
def test_values_colour_points_on_the_scale(dimension, radius):
    """Of viridis, the ends and the third."""
    x = np.eye(3)[:, :dimension] * 2
    mechanism, solution = still(x, radii=[radius] * 3)
    axes, pixels = pixels_of(mechanism, solution, color=VALUES)
    wanted = 255 * colormaps["viridis"]([0.0, 1 / 3, 1.0])[:, :3]
    opacity = 0.8 if dimension == 2 and radius else 1.0  # on white
    found = [color_at(axes, pixels, place) for place in x]
    np.testing.assert_allclose(found, 255 * (1 - opacity) + opacity * wanted, atol=3)  # roundings to 1 of 255
    assert len(axes.figure.axes) == 2


def test_the_scale_of_speeds_has_the_unit_of_the_axes():
    mechanism, solution = still([(0.0, 0.0), (0.0, 1.0)], velocity=3.0, labels=("x (au)", "y (au)"))
    axes, _ = pixels_of(mechanism, solution, color="speed")
    assert axes.figure.axes[1].get_ylabel() == "speed (au/s)"
    (dots,) = axes.collections
    np.testing.assert_array_equal(dots.get_facecolor()[:, :3], np.tile(dots.get_facecolor()[0, :3], (2, 1)))


def test_an_output_colours_the_moving_points_and_faces_have_the_mean_of_their_corners():
    x = [(0, 0), (1, 0), (1, 1), (0, 1), (3, 0)]
    mechanism, solution = still(x, faces=[(0, 1, 2, 3)], hidden=[0, 1, 2, 3], fixed=[4])
    outputs = {"heat": np.tile([0.0, 2.0, 4.0, 10.0], (11, 1)), "total": np.ones(11)}
    solution = replace(solution, outputs=outputs)
    axes, pixels = pixels_of(mechanism, solution, color="heat")
    np.testing.assert_allclose(
        color_at(axes, pixels, (0.4, 0.6)), 255 * np.array(colormaps["viridis"](0.4)[:3]), atol=3
    )
    assert axes.figure.axes[1].get_ylabel() == "heat"
    with pytest.raises(ValueError, match=r"^color must be 'speed' or 'heat', or an array of shape .*, not 'total'"):
        Look.of(mechanism, solution, color="total")


def test_forces_colour_the_points_of_a_scene(tmp_path):
    """Of two masses on a spring that falls, one has its weight more and the other less; a support has no force."""
    scene = Scene(dimension=3)
    high, low = scene.mass(1.0, (0, 0, 1.5)), scene.mass(2.0, (0, 0, 0))
    scene.add(LinearSpring(30.0, 1.0), high, low)
    scene.add(Gravity((0, 0, -10.0)))
    scene.add(LinearSpring(0.0, 1.0), scene.fixed((0, 0, 3)), high)
    problem = scene.problem((0, 0.1))
    solution = problem.integrate(h=0.01, save_to=tmp_path / "run")
    loaded, complete = eig3.load(tmp_path / "run"), problem.load(tmp_path / "run")
    look = Look.of(problem.view, solution, color="force")
    np.testing.assert_allclose(look.values["force"][0], [10 + 15, 20 - 15, 0], rtol=1e-12)
    axes, _ = pixels_of(problem.view, solution, color="force")
    assert axes.figure.axes[1].get_ylabel() == "force (N)"
    with pytest.raises(ValueError, match=r'^color="force" needs the accelerations: load the solution with '):
        Look.of(problem.view, loaded, color="force")
    np.testing.assert_array_equal(Look.of(problem.view, complete, color="force").values["force"], look.values["force"])


@pytest.mark.parametrize(
    ("look", "message"),
    [
        ({"limits": ((0, 1), (2, 2))}, r'limits must be "main", "all", or the least and the largest coordinate along'),
        ({"limits": (0, 1)}, r"of the 2 axes, such as \(\(0.0, 1.0\), \(0.0, 1.0\)\), not \(0, 1\)\.$"),
        ({"limits": "most"}, r"limits must be .* not 'most'\.$"),
        ({"camera": (30, 20)}, r"camera needs points in space: leave it out, because these points move in a plane\.$"),
        ({"color": np.ones((11, 4))}, r"color must have a value .* of shape \(11, 3\), not \(11, 4\)\.$"),
        ({"color": 3.0}, r"color must have a value .* of shape \(11, 3\), not \(\)\.$"),
        ({"color": np.full((11, 3), np.nan)}, "color must be finite"),
        (
            {"color": "sped"},
            r"color must be 'speed', or an array of shape \(saved times, 3\), not 'sped': an output can",
        ),
    ],
)
def test_a_look_that_does_not_fit_is_refused(look, message):
    mechanism, solution = still(np.eye(3)[:, :2])
    with pytest.raises(ValueError, match=message):
        Look.of(mechanism, solution, **look)


@pytest.mark.parametrize("camera", [(0, 91), (0,), (0, 0, 0), (np.nan, 0), "top", "12", 30])
def test_a_camera_must_be_angles(camera):
    mechanism, solution = still(np.eye(3))
    with pytest.raises(ValueError, match=r"^camera must be \(azimuth, elevation\) in degrees, with an elevation from"):
        Look.of(mechanism, solution, camera=camera)


def test_a_film_without_points_has_no_look(tmp_path):
    problem, (_, solution) = tumbling_box().with_(view=None), still(np.eye(3))
    with pytest.raises(ValueError, match=r"has no geometry: .* or leave out limits, camera and color for a film of"):
        problem.animate(solution, tmp_path / "film.gif", color="speed")


def test_a_film_and_a_page_take_the_same_look(tmp_path, monkeypatch):
    monkeypatch.setattr(film, "_SECONDS", 0.2)
    problem = tumbling_box(t_end=0.5)
    solution = flying(problem)
    plain = problem.animate(solution, tmp_path / "film.gif").read_bytes()
    look = {"limits": ((-1, 1), (-1, 1), (-1, 2)), "camera": (10, 20, 1.5), "color": "speed"}
    assert problem.animate(solution, tmp_path / "film.gif", **look).read_bytes() != plain
    page = problem.show(solution, tmp_path / "page.html", **look).html
    data = json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', page)[1])
    assert data["limits"] == np.transpose(look["limits"]).tolist()
    assert (data["camera"], data["colored"]) == ([10, 20, 1.5], "speed")


@pytest.mark.parametrize(("wall", "radius"), [(None, 0.15), (0.3, 0.3)])
def test_fixed_points_of_a_second_group_are_discs_that_the_first_touches(wall, radius):
    """The walls of Hertz's contact have what the largest of the balls leaves, and Mindlin's their wall_radius."""
    scene = Scene(dimension=2)
    balls, posts = scene.mass(1.0, [(0.0, 1.0), (1.0, 1.0)], inertia=0.1), scene.fixed([(0.0, 0.0), (1.0, 0.0)])
    radii = np.array([0.1, 0.2])
    if wall is None:
        scene.add(HertzContact(1e4, radii=radii), balls)
        scene.add(HertzContact(1e4, 0.35), balls, others=posts)
    else:
        scene.add(HertzMindlin(1e6, 0.3, 0.5, 0.9, radii=radii, wall_radius=wall), balls, others=posts)
    found = scene.problem((0, 1)).view.radii
    np.testing.assert_allclose(found, [*radii, radius, radius], rtol=1e-12)


def test_values_colour_bodies_by_their_number():
    """Points that show the axes of bodies have no value."""
    scene = Scene(dimension=3)
    for place in (0, 1):
        scene.body(1.0, (0.1, 0.2, 0.3), (place, 0, 0), angular_velocity=(0, 0, 1.0), shape=("sphere", 0.4))
    problem = scene.problem((0, 1))
    solution = flying(problem)
    values = np.tile([1.0, 2.0], (len(solution.t), 1))
    axes, pixels = pixels_of(problem.view, solution, color=values)
    dark, light = (color_at(axes, pixels, place) for place in [(0, 0, 0), (1, 0, 0)])
    assert light[0] > 120 > dark[0]  # viridis begins with violet and ends with yellow
    assert light[1] > 120 > dark[1]
