"""The view of a run that one can turn: what its page holds, and what it does in a browser."""

import base64
import hashlib
import html
import json
import re
import zlib
from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure

import eig3
from eig3.animation import Film, Mechanism, wrapped
from eig3.animation.frames import Color, Frames
from eig3.animation.look import Look
from eig3.cli import main
from eig3.effects import Gravity, HertzContact, LinearSpring
from eig3.problem import Problem
from eig3.scene import Scene
from eig3.scene.mesh import surface
from eig3.view import coding
from eig3.view.frames import content

from .conftest import flying, made_up

HOSTILE = "</script><script>window.foreign = 1</script><!--<img src=x onerror='window.foreign = 1'>\"&$data"


def swinging(name: str = "scene") -> tuple[Problem, eig3.Solution]:
    scene = Scene(dimension=2)
    pivot, bob = scene.fixed((0, 0)), scene.mass(1.0, (0.75, 0))
    scene.add(LinearSpring(stiffness=98.1, rest_length=0.5), pivot, bob)
    scene.add(Gravity((0, -9.81)))
    problem = scene.problem((0, 8), name=name)
    t = np.linspace(0, 8, 801)
    angle = 1.2 * np.cos(4 * t)
    return problem, made_up(t, np.stack([np.sin(angle), -np.cos(angle)], axis=1))


def gas(shear: float = 0.0) -> tuple[Problem, eig3.Solution]:
    """Balls in a box of two periodic sides, which they cross several times, as if they were free."""
    random = np.random.default_rng(3)
    scene = Scene(dimension=3, box=(1.0, 2.0, None), shear=shear)
    balls = scene.mass(1.0, random.random((20, 3)) * [1, 2, 1], random.normal(size=(20, 3)))
    scene.add(HertzContact(10.0, radii=0.05), balls)
    problem = scene.problem((0, 7))
    return problem, flying(problem)


@pytest.fixture(scope="module")
def pendulum() -> tuple[Problem, eig3.Solution]:
    return swinging(HOSTILE)


def blocks(page: str) -> dict[str, str]:
    return dict(re.findall(r'<script type="text/plain" id="(\w+)">([^<]*)</script>', page))


def data(page: str) -> dict:
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', page)[1])


def decoded(text: str, frames: int, bits: int) -> np.ndarray:
    """The integers of a block, shape (frames, numbers), as the script of a page decodes them."""
    coded = zlib.decompress(base64.b64decode(text))
    rows = np.frombuffer(coded, dtype=np.uint8).reshape(frames, -1).astype(np.int32)
    if bits > 8:
        low, high = np.split(rows, 2, axis=1)
        rows = low + 256 * high
    d = (rows >> 1) ^ -(rows & 1)
    d[1:] = np.cumsum(d[1:], axis=0)
    return np.cumsum(d, axis=0) % 2**bits


def positions(page: str) -> tuple[np.ndarray, float]:
    """The positions in a page, shape (frames, points, axes), and half of the largest side of a cell."""
    found = data(page)
    low, high = (np.array(corner)[: 2 if found["flat"] else 3] for corner in found["motion"])
    q = decoded(blocks(page)["positions"], found["frames"], found["bits"])
    cells, size = np.swapaxes(q.reshape(found["frames"], low.size, found["points"]), 1, 2), high - low
    return low + (cells + 0.5 * (size > 0)) * size / 2 ** found["bits"], size.max() / 2 ** found["bits"] / 2


def test_a_page_has_the_positions_of_the_run(pendulum, tmp_path):
    problem, solution = pendulum
    page = problem.show(solution, tmp_path / "page.html")
    assert page.path.read_text(encoding="utf-8") == page.html
    found = data(page.html)
    t = np.linspace(found["time"]["start"], found["time"]["end"], found["frames"])
    u, _ = solution.at(t)
    x, half = positions(page.html)
    assert half < 1e-4  # m: of a motion of 2 m, with 16 bits
    np.testing.assert_allclose(x[:, 1], u, atol=half * (1 + 1e-9), rtol=0)
    np.testing.assert_allclose(x[:, 0], 0, atol=half * (1 + 1e-9), rtol=0)


def test_a_page_that_cannot_be_written_leaves_the_older_one(pendulum, limited_files, tmp_path):
    problem, solution = pendulum
    path = tmp_path / "view.html"
    path.write_text("older")
    with limited_files(5000), pytest.raises(OSError, match="File too large"):
        problem.show(solution, path)
    assert path.read_text() == "older"


@pytest.mark.parametrize("bits", [16, 12, 8])
def test_codes_are_exact_for_any_integers(bits):
    q = np.random.default_rng(1).integers(0, 2**bits, (7, 5, 3))
    q[:2, 0, 0] = 0, 2**bits - 1  # the largest jump
    found = decoded(coding.text_of(coding.differences(q, bits)), 7, bits)
    np.testing.assert_array_equal(found.reshape(q.shape), q)


@pytest.mark.parametrize("shear", [0.0, 0.3])
def test_atoms_are_inside_the_periodic_box_and_at_an_image_of_their_place(shear, tmp_path):
    problem, solution = gas(shear)
    page = problem.show(solution, tmp_path / "page.html").html
    x, half = positions(page)
    found = data(page)
    assert found["box"] == [1.0, 2.0, 0.0]
    assert ((x[..., :2] > 0) & (x[..., :2] < [1, 2])).all()
    t = np.linspace(found["time"]["start"], found["time"]["end"], found["frames"])
    away = x - problem.view.places(t, solution.at(t)[0])
    assert np.abs(away).max() > 2  # balls have crossed the box
    images = np.round(away[..., 1] / 2)
    away[..., 1] -= 2 * images
    away[..., 0] -= images * shear * 2 * t[:, None]
    away[..., 0] -= np.round(away[..., 0])
    np.testing.assert_allclose(away, 0, atol=half * (1 + 1e-9))


def test_wrapping_leaves_other_axes_and_scenes_without_a_box():
    x = np.array([[[2.5, -0.5]]])
    np.testing.assert_array_equal(wrapped(x, np.zeros(1), (1.0, 0.0)), [[[0.5, -0.5]]])
    np.testing.assert_array_equal(wrapped(x, np.zeros(1), ()), x)


def test_a_body_is_a_box_with_its_inertia():
    """The moments of a uniform box are m (b^2 + c^2) / 12."""
    sides = np.array([0.1, 0.2, 0.6])
    scene = Scene(dimension=3)
    scene.body(3.0, 3.0 / 12 * (sides @ sides - sides**2), (1, 2, 3), angular_velocity=(0.0, 0.0, 1.0))
    problem = scene.problem((0, 1))
    (solid,) = problem.view.solids
    centre, *ends = problem.view.places(np.zeros(1), problem.u0[None])[0, list(solid.points)]
    assert solid.kind == "box"
    np.testing.assert_allclose(centre, (1, 2, 3), rtol=1e-14)
    np.testing.assert_allclose(ends - centre, np.diag(sides / 2), atol=1e-14)


def test_a_film_is_not_larger_for_shapes_that_it_does_not_draw():
    """The body moves by 1 m along x, and a link shows it; its box has a side of 35 m."""
    scene = Scene(dimension=2)
    scene.body(1.0, 200.0, (0, 0), velocity=(1.0, 0.0)).point((0.1, 0.0))
    problem = scene.problem((0, 1))
    figure = Figure()
    problem.view(figure, Film.of(flying(problem)))
    (axes,) = figure.axes
    assert np.diff(axes.get_xlim()) < 2


@pytest.mark.parametrize(
    ("shape", "semi_axes"),
    [
        (("box", (2, 4, 6)), (1, 2, 3)),
        (("sphere", 0.5), (0.5, 0.5, 0.5)),
        (("cylinder", (0.5, 3)), (0.5, 0.5, 1.5)),
        (("capsule", (0.5, 3)), (0.5, 0.5, 2.0)),
    ],
)
def test_a_given_shape_turns_with_the_frame_of_its_body(shape, semi_axes):
    """The inertia has other principal axes, and the body is turned by a quarter about z."""
    inertia = np.array([[3.0, 0.4, 0.1], [0.4, 4.0, 0.2], [0.1, 0.2, 5.0]])
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    scene = Scene(dimension=3)
    scene.body(3.0, inertia, (1, 2, 3), turn, shape=shape)
    problem = scene.problem((0, 1))
    (solid,) = problem.view.solids
    centre, *ends = problem.view.places(np.zeros(1), problem.u0[None])[0, list(solid.points)]
    assert solid.kind == shape[0]
    np.testing.assert_allclose(ends - centre, np.diag(semi_axes) @ turn.T, atol=1e-14)


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        (("cone", 1), 'shape must be a kind, which is one of "box", "sphere", "cylinder", "capsule", with its sizes'),
        (("box", (1, 2)), "shape must have 3 positive sizes for a box"),
        (("sphere", -1), "shape must have 1 positive sizes for a sphere"),
    ],
)
def test_wrong_shapes_are_refused(shape, message):
    with pytest.raises(ValueError, match=message):
        Scene(dimension=3).body(1.0, np.ones(3), np.zeros(3), shape=shape)


def test_faces_around_a_solid_point_outwards():
    """By Gauss, the volume is a sixth of the sum of the triple products of the corners."""
    corners = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)], dtype=float)
    cells = np.array([(0, 1, 2, 3), (1, 2, 3, 4)])
    edges = corners[cells[:, 1:]] - corners[cells[:, :1]]
    signs = np.sign(np.linalg.det(edges))
    cells[signs < 0] = cells[signs < 0][:, [0, 2, 1, 3]]
    found = np.linalg.det(corners[surface(cells)]).sum() / 6
    assert found == pytest.approx(np.abs(np.linalg.det(edges)).sum() / 6, rel=1e-14)


def test_an_output_for_each_point_is_a_colour():
    """Of a point at 2 t + number, as the only output with one value a point."""
    t = np.linspace(0, 1, 5)
    mechanism = Mechanism(lambda t, u: u.reshape(len(t), 3, 2), fixed=[0])
    states = np.arange(6.0) * t[:, None]
    film = SimpleNamespace(t=t, u=states, v=np.tile(np.arange(6.0), (5, 1)), clock=(1.0, "s"))
    outputs = {"heat": 2 * t[:, None] + np.arange(3), "load": t[:, None] + np.ones(2), "total": t}
    frames = Frames.of(mechanism, film)
    look = Look.of(mechanism, SimpleNamespace(t=t, u=states, outputs=outputs, labels=None))
    (_, unit, speed), (name, _, heat), (other, _, load) = look.colors(frames)
    assert (unit, name, other) == ("m/s", "heat", "load")
    np.testing.assert_allclose(speed, np.tile(np.hypot([0, 2, 4], [1, 3, 5]), (len(frames.t), 1)), rtol=1e-9)
    np.testing.assert_allclose(heat, 2 * frames.t[:, None] + np.arange(3), rtol=1e-14)
    np.testing.assert_allclose(load[:, 1:], frames.t[:, None] + np.ones(2), rtol=1e-14)
    assert not load[:, 0].any()


def test_a_page_runs_its_own_scripts_only_and_refers_to_nothing(pendulum, tmp_path):
    problem, solution = pendulum
    page = problem.show(solution, tmp_path / "page.html").html
    assert len(page.encode()) < 0.8e6  # of which the library is 0.57 MB
    tags = re.findall(r"<script([^>]*)>(.*?)</script>", page, flags=re.DOTALL)
    own = [text for attributes, text in tags if not attributes]
    assert len(own) == 2
    (policy,) = re.findall(r'http-equiv="Content-Security-Policy" content="([^"]*)"', page)
    rules = dict(rule.split(" ", 1) for rule in policy.split("; "))
    digests = [base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in own]
    assert rules["script-src"].split() == [f"'sha256-{digest}'" for digest in digests]
    assert rules["default-src"] == "'none'"
    assert html.escape(HOSTILE) in page
    assert HOSTILE not in page
    assert data(page)["name"] == HOSTILE
    addresses = set(re.findall(r"https?://[^\"'` )]*", page))
    assert addresses <= {"http://www.w3.org/1999/xhtml"}  # a name of the library, which loads nothing
    assert not re.search(r"<(link|img|iframe|base)\b", page.replace(html.escape(HOSTILE), "").split("<script")[0])


def test_a_notebook_gets_the_page_in_a_frame(pendulum, monkeypatch):
    problem, solution = pendulum
    monkeypatch.setitem(__import__("sys").modules, "ipykernel", SimpleNamespace())
    page = problem.show(solution)
    assert page.path is None
    (inside,) = re.findall(r'srcdoc="([^"]*)"', page._repr_html_())
    assert html.unescape(inside) == page.html


def test_without_a_path_the_browser_opens_a_temporary_page(pendulum, monkeypatch):
    problem, solution = pendulum
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda address: opened.append(address) or True)
    page = problem.show(solution)
    assert opened == [page.path.as_uri()]
    monkeypatch.setattr("webbrowser.open", lambda address: False)
    with pytest.raises(RuntimeError, match=r"path must be given, such as 'view.html'"):
        problem.show(solution)


def test_what_cannot_be_shown_is_refused(pendulum, tmp_path):
    problem, solution = pendulum
    with pytest.raises(ValueError, match=r"has no geometry: set its view with problem.with_\(view="):
        eig3.problems.single_dof().show(solution, tmp_path / "page.html")
    with pytest.raises(ValueError, match=r"path must end with .html, not 'page.gif'"):
        problem.show(solution, tmp_path / "page.gif")
    with pytest.raises(FileNotFoundError, match="path must be in an existing folder"):
        problem.show(solution, tmp_path / "none" / "page.html")


def test_the_command_writes_a_page_or_refuses_before_the_run(tmp_path, capsys, monkeypatch):
    path = tmp_path / "page.html"
    main(["run", "spring_pendulum", "--t-end", "8", "--show", str(path)])
    assert data(path.read_text())["name"] == "spring_pendulum"
    assert f"Shown in {path}" in capsys.readouterr().out
    monkeypatch.setattr(Problem, "integrate", None)
    with pytest.raises(SystemExit, match="eig3 run: single_dof has no geometry"):
        main(["run", "single_dof", "--show", str(path)])


def test_without_a_browser_the_files_of_the_run_are_written(tmp_path, monkeypatch):
    monkeypatch.setattr("webbrowser.open", lambda address: False)
    with pytest.raises(SystemExit, match="path must be given"):
        main(["run", "spring_pendulum", "--t-end", "1", "--out", str(tmp_path), "--show"])
    assert (tmp_path / "spring_pendulum.npz").exists()


def of_grains(jitter: float) -> tuple[Frames, list[Color]]:
    """A made-up motion of 20,000 grains in 200 frames, which also tremble at random by `jitter`."""
    random, count, t = np.random.default_rng(1), 20_000, np.linspace(0, 8, 200)
    start, rate, size = (
        random.random((count, 3)),
        random.normal(0, 0.05, (count, 3)),
        random.normal(0, 0.03, (count, 3)),
    )
    x = np.stack([start + rate * now + size * np.sin(3 * now + 6 * start) for now in t])
    x += jitter * random.normal(size=x.shape)
    mechanism = Mechanism(lambda t, u: u, radii=np.full(count, 0.01))
    speed = np.linalg.norm(np.gradient(x, t, axis=0), axis=2)
    film = SimpleNamespace(t=t, clock=(1.0, "s"), speed=1.0)
    return Frames(mechanism, film, t, x, x, x), [Color("speed", "m/s", speed)]


@pytest.mark.system
@pytest.mark.parametrize(("jitter", "least_bits"), [(0.0, 16), (0.1, 8)])
def test_twenty_thousand_grains_fit_in_twenty_megabytes(jitter, least_bits):
    found, texts = content(*of_grains(jitter), [], Look())
    assert sum(len(text) for text in texts.values()) < 19.2e6  # the scripts and the library have less than 0.8 MB
    assert found["bits"] >= least_bits


# In a browser --------------------------------------------------------------------------------------------------------


@pytest.fixture
def opened(browser, pendulum, tmp_path) -> Iterator:
    """The page of the pendulum, paused at its start. At the end, no error may have been logged."""
    problem, solution = pendulum
    path = problem.show(solution, tmp_path / "page.html").path
    context = browser.new_context(viewport={"width": 700, "height": 500})
    tab, wrong = context.new_page(), []
    tab.on("console", lambda message: wrong.append(message.text) if message.type == "error" else None)
    tab.on("pageerror", lambda error: wrong.append(str(error)))
    tab.on("request", lambda request: wrong.append(request.url) if request.url.startswith("http") else None)
    tab.goto(path.as_uri())
    tab.wait_for_selector("#message[hidden]", state="attached")
    tab.keyboard.press("Home")
    yield tab
    assert tab.evaluate("window.foreign") is None
    context.close()
    assert not wrong


def shot(tab) -> bytes:
    tab.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    return tab.locator("main > canvas").screenshot()


def clock(tab) -> str:
    return tab.locator("#clock").inner_text()


@pytest.mark.system
def test_the_slider_and_the_mouse_change_the_picture(opened):
    before = shot(opened)
    assert shot(opened) == before  # it stands still
    opened.locator("#time").fill("100")
    later = shot(opened)
    assert later != before
    assert clock(opened) != "t = 0.00 s"
    box, seen = opened.locator("main > canvas").bounding_box(), opened.evaluate("camera.position.toArray()")
    opened.mouse.move(box["x"] + 300, box["y"] + 200)
    opened.mouse.down()
    opened.mouse.move(box["x"] + 380, box["y"] + 230)
    opened.mouse.up()
    assert shot(opened) != later
    opened.keyboard.press("r")
    assert opened.evaluate("camera.position.toArray()") == pytest.approx(seen, rel=1e-9)


@pytest.mark.system
def test_keys_play_step_and_jump(opened):
    frames = opened.evaluate("data.frames")
    opened.keyboard.press("5")
    assert float(opened.locator("#time").input_value()) == pytest.approx((frames - 1) / 2, abs=0.51)
    opened.keyboard.press("End")
    assert clock(opened) == "t = 8.00 s"
    opened.keyboard.press("ArrowLeft")
    assert float(opened.locator("#time").input_value()) == frames - 2
    opened.keyboard.press("Home")
    opened.keyboard.press(" ")
    while float(opened.locator("#time").input_value()) < 3:
        opened.wait_for_timeout(50)
    opened.keyboard.press(" ")
    assert opened.locator("#play").get_attribute("aria-label") == "Play"
    assert shot(opened) == shot(opened)


@pytest.mark.system
def test_the_button_saves_a_picture(opened):
    with opened.expect_download() as caught:
        opened.locator("#picture").click()
    path = caught.value.path()
    assert path.read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
    assert path.stat().st_size > 5000
    assert caught.value.suggested_filename.endswith(".png")


@pytest.mark.system
def test_colours_have_a_scale(opened):
    before = shot(opened)
    opened.locator("#color").select_option("speed")
    opened.wait_for_selector("#legend:visible")
    assert re.fullmatch(r"[\d.]+ m/s", opened.locator("#high").inner_text())
    opened.locator("#axes").click()
    assert shot(opened) != before


@pytest.mark.system
def test_the_browser_decodes_what_was_coded(opened, pendulum):
    _, solution = pendulum
    found = opened.evaluate("[...Array(data.frames).keys()].map(k => [0, 1].map(axis => motion.place(k, 1, axis)))")
    t = np.linspace(0, 8, len(found))
    size = np.ptp(solution.u, axis=0).max()
    np.testing.assert_allclose(found, solution.at(t)[0], atol=2 * size / 2**16)


@pytest.mark.system
def test_the_page_begins_with_the_camera_and_the_colour_of_the_user(browser, tmp_path):
    problem, solution = gas()
    tab = browser.new_page()
    tab.goto(problem.show(solution, tmp_path / "page.html", camera=(30, 40, 2), color="speed").path.as_uri())
    tab.wait_for_selector("#legend:visible")
    assert tab.locator("#color").input_value() == "speed"
    seen = np.array(tab.evaluate("camera.position.clone().sub(controls.target).toArray()"))
    distance = np.linalg.norm(seen)
    turn, rise = np.radians([30, 40])
    level = np.cos(rise)
    np.testing.assert_allclose(
        seen / distance, [level * np.cos(turn), level * np.sin(turn), np.sin(rise)], atol=1e-4
    )  # POLE
    tab.evaluate("() => { data.camera[2] = 1; resetView(); }")
    nearer = tab.evaluate("camera.position.distanceTo(controls.target)")
    assert distance == pytest.approx(2 * nearer, rel=1e-9)


def test_a_film_and_a_page_show_the_same_times(pendulum, tmp_path):
    problem, solution = pendulum
    film, found = Film.of(solution), data(problem.show(solution, tmp_path / "page.html").html)
    assert [found["time"]["start"], found["time"]["end"], found["speed"]] == [film.t[0], film.t[-1], film.speed]
