"""What films draw besides points: the shapes of bodies, periodic boxes, and limits without points that fly away."""

import numpy as np
import pytest

from eig3.animation import Film, Mechanism, Solid
from eig3.animation.shapes import edges_of_box, surface
from eig3.effects import Gravity
from eig3.problems import argon, tumbling_box
from eig3.scene import Scene

pytest.importorskip("matplotlib")

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


def is_on_capsule(x):
    """All points have the distance 0.2 from the part of the axis between the middles of the half balls."""
    return np.isclose(np.hypot(np.hypot(x[..., 0], x[..., 1]), np.maximum(abs(x[..., 2]) - 0.5, 0)), 0.2)


SHAPES = {
    "box": lambda x: (abs(x / np.diag(AXES)) == 1).all(axis=-1),
    "sphere": lambda x: np.isclose(np.square(x / np.diag(AXES)).sum(axis=-1), 1),
    "cylinder": is_on_cylinder,
    "capsule": is_on_capsule,
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
    problem = tumbling_box(t_end=0.5)
    faces = axes_of(problem.view, problem.integrate(h=1e-3, save_every=10)).collections[-1]
    corners = np.unique(np.round(np.asarray(faces._faces)[..., :3].reshape(-1, 3), 9), axis=0)
    assert len(corners) == 8
    lengths = np.unique(np.round(np.linalg.norm(corners - corners[0], axis=1), 6))
    assert {0.1, 0.2, 0.3} <= set(lengths)  # three of the distances between corners are the sides


def test_atoms_are_inside_their_box_with_its_edges():
    problem = argon(n=4, t_end=2e-12)
    solution = problem.integrate(h=4e-15, save_every=5)
    mechanism = problem.view.keywords["mechanism"] if hasattr(problem.view, "keywords") else problem.view
    side = np.asarray(mechanism.box)
    x = mechanism.places(solution.t[-1:], solution.u[-1:])[0]
    assert ((x < 0) | (x > side)).any()  # the places themselves leave the box
    axes = axes_of(problem.view, solution)
    edges = edges_of_box(np.zeros(3), side)
    assert any(
        np.shape(getattr(part, "_segments3d", ())) == edges.shape and np.allclose(part._segments3d, edges)
        for part in axes.collections
    )
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


def test_a_disc_that_flies_away_does_not_scale_the_film():
    scene = Scene(dimension=2)
    places = np.random.default_rng(2).uniform(0, 1, (200, 2))
    velocities = np.zeros((200, 2))
    velocities[0] = 100.0, 0.0
    scene.mass(1.0, places, velocities)
    scene.add(Gravity((0.0, -0.1)))
    problem = scene.problem((0, 1))
    axes = axes_of(problem.view, problem.integrate(h=1e-2))
    assert axes.get_xlim()[1] < 3.0  # it is at 100 m
