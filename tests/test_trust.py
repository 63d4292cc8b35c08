"""`eig3 bench trust`: its runs, its table, its picture, and what it says about estimates."""

from functools import partial

import numpy as np
import pytest

import eig3
from eig3 import problems
from eig3.bench import trust
from eig3.cli import main

pytestmark = pytest.mark.system


def checked(true, estimated, *, is_smooth=True, is_noted=False, problem="a"):
    return trust.Checked(problem, is_smooth, "EIG-3", estimated, true, is_noted)


def test_the_verdict_counts_runs():
    found = [
        checked(1e-6, 1.5e-6),
        checked(1e-6, 2.5e-6),
        checked(1e-6, 4e-6, is_smooth=False),
        checked(1e-6, 0.9e-7),
        checked(1e-6, 0.9e-7, is_noted=True),
    ]
    said = trust.verdict(found)
    assert "in 1 and within a factor of 3 in 2 of 3 runs without a note; 1 runs have a note" in said
    assert "in 0 and within a factor of 3 in 0 of 1 runs without a note; 0 runs have a note" in said
    assert "Of all 5 runs, 1 have an estimate below a tenth" in said
    row = trust.render(found).splitlines()[2].split("|")
    assert [cell.strip() for cell in row[1:]] == ["a", "5", "1e-06 to 1e-06", "1", "2", "1", "0.090", "4.0", ""]


def test_the_command_writes_a_page_and_a_picture_of_true_estimates(tmp_path, capsys, monkeypatch):
    """The estimates of a smooth problem are within a factor of 2 in 99 of 100 runs without a note."""
    found, benchmark = [], trust.benchmark
    monkeypatch.setattr(trust, "benchmark", lambda **settings: found.extend(benchmark(**settings)))
    assert main(["bench", "trust", "--problem", "softening_spring", "--repeats", "1", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert (tmp_path / trust.PICTURE).read_text().count("true error") >= 2
    assert (tmp_path / "trust.md").read_text().splitlines()[0] == "# Can the error be trusted?"
    assert "| softening_spring |" in printed
    plain = [x.ratio for x in found if not x.is_noted]
    assert len(plain) > 30
    assert sum(1 / trust.TWICE <= ratio <= trust.TWICE for ratio in plain) >= 0.99 * len(plain)


def test_chaos_says_from_when_on_no_digit_is_right():
    """The double pendulum of 60 s: an estimate far below the true error has a note."""
    found = trust.benchmark(only=["double pendulum, 60 s"], write=lambda _: None)
    low = [x for x in found if x.ratio < trust.TENTH and not x.is_noted]
    assert not low
    assert np.median([x.ratio for x in found]) == pytest.approx(1.0, abs=0.2)


@eig3.jit
def satellite(t, u, v, p, a):
    pull = -p[0] * (u[0] ** 2 + u[1] ** 2) ** -1.5
    a[0], a[1] = pull * u[0], pull * u[1]


apsis = eig3.jit(lambda t, u, v, p: u[0] * v[0] + u[1] * v[1])


@eig3.jit
def isolated(t, u, v, z, p, a, dz):
    """A building on an isolator by Bouc and Wen."""
    a[0] = -3.0 * np.sin(6.0 * t) * np.exp(-0.1 * t) - 0.08 * v[0] - 4.0 * u[0] - 5.0 * z[0]
    dz[0] = 100 * (v[0] - 0.5 * abs(v[0]) * z[0] * abs(z[0]) - 0.5 * v[0] * z[0] * z[0])


def assert_accurate(accuracy, solve, *, within=2.0):
    solution = solve(accuracy=accuracy)
    true = solve(rtol=1e-12, method="rk8", t_eval=solution.t)
    assert solution.success
    assert np.abs(solution.u - true.u).max() <= within * accuracy * np.abs(true.u).max()
    return solution


def test_a_frame_under_a_record_has_the_accuracy():
    assert_accurate(1e-4, problems.ten_storey_frame().integrate)


def test_an_orbit_and_its_events_have_the_accuracy():
    """Five days of a satellite; the times of its perigees follow from the period by Kepler's third law."""
    mu, r, speed = 398600.4418, 7000.0, 9.0
    options = {"params": [mu], "events": {"perigee": eig3.Event(apsis, direction=1)}}
    solution = eig3.integrate(
        satellite, (0, 432000.0), [r, 0.0], [0.0, speed], accuracy={"u": 1e-7, "perigee": 1e-9}, **options
    )
    period = 2 * np.pi * np.sqrt((1 / (2 / r - speed**2 / mu)) ** 3 / mu)
    exact = period * np.arange(1, 1 + len(solution.events["perigee"]))
    assert len(exact) > 20
    np.testing.assert_allclose(solution.events["perigee"].t, exact, rtol=0, atol=2e-9 * 432000)


def test_an_isolator_has_the_accuracy():
    assert_accurate(1e-5, partial(eig3.integrate, isolated, (0, 20), [0.0], [0.0], z0=0.0))
