"""Tables in HTML, which notebooks show instead of `repr`."""

import html
import re
from html.parser import HTMLParser

import numpy as np
import pytest

import eig3

from .conftest import oscillator


@eig3.jit
def spring(t, u, v, p):
    return -p.k * u - p.c * v


explosion = eig3.jit(lambda t, u, v, p: u**3)
energy = eig3.jit(lambda t, u, v, p: 0.5 * v**2 + 0.5 * p[0] * u**2)


class Cells(HTMLParser):
    """The texts of the cells of each row; a tag that is not closed raises an error."""

    def __init__(self, page):
        super().__init__()
        self.rows, self.open = [], []
        self.feed(page)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if {"td", "th"} & {*self.open}:
            self.rows[-1][-1] += data


def rows_of(shown):
    return Cells(shown._repr_html_()).rows


def words_of(text):
    return sorted(re.findall(r"[\w.+-]+", text))


def damped(name="damped", **changes):
    return eig3.Problem(name, spring, 1.0, 0.0, {"k": 4.0, "c": 0.2}, (0.0, 5.0), **changes)


def solutions(folder):
    """Runs that ended well, with notes, without states, by divergence, and from files."""
    run = eig3.integrate(oscillator, (0, 1), 1.0, 0.0, h=0.01, params=(4.0, 0.2), invariants={"energy": energy})
    yield run
    yield eig3.load(run.save(folder / "run.npz"))
    yield eig3.integrate(explosion, (0, 10), 1.0, 1.0, h=0.01)
    yield eig3.integrate(explosion, (0, 10), 1.0, 1.0, h=0.01, t_eval=[9.0])
    yield eig3.integrate(oscillator, (0, 1), 1.0, 0.0, rtol=1e-6, params=(4.0, 0.2), check=True)
    members = eig3.ensemble(oscillator, (0, 1), 1.0, 0.0, h=[0.01, 0.1], params=(4.0, 0.2, 0.0))
    yield members
    yield eig3.load(members.save(folder / "members.npz"))
    yield eig3.ensemble(explosion, (0, 10), [1.0, 0.0], [1.0, 0.0], h=0.01)


def test_a_notebook_shows_the_words_of_repr(tmp_path):
    """A second wording, a lost fact or a cell that is not escaped gives other words."""
    for solution in solutions(tmp_path):
        page = solution._repr_html_()
        text = html.unescape(re.sub("<[^>]*>", " ", page))
        expected = re.sub(r"\bNote: |[=:] | = ", " ", repr(solution))
        assert words_of(re.sub(r"\bNote\b|[=:] | = ", " ", text)) == words_of(expected)
        assert Cells(page).rows


def test_facts_have_a_name_and_a_value(tmp_path):
    run, loaded, diverged, *_ = solutions(tmp_path)
    rows = dict(row for row in rows_of(run) if len(row) == 2)
    assert rows["states saved"] == "101"
    assert rows["t"] == "0 to 1"
    assert rows["drift of energy"] == f"{run.drift['energy']:.4g}"
    assert rows == dict(row for row in rows_of(loaded) if len(row) == 2)
    assert rows_of(diverged)[-1] == [diverged.message]


def test_a_problem_and_a_fit():
    problem = damped("a < b & c", units="rad", note="first line\nsecond <line>")
    rows = dict(rows_of(problem))
    assert "a &lt; b &amp; c" in problem._repr_html_()
    assert (rows["u0"], rows["v0"], rows["t_span"]) == ("1 rad", "0 rad/s", "0, 5 s")
    assert (rows["params"], rows["rhs"], rows["note"]) == ("k = 4, c = 0.2", "spring", problem.note)
    assert "exact" not in rows
    title, *lines = repr(problem).split("\n")
    assert title == "Problem: a < b & c"
    assert {"  u0 = 1 rad", "  params = k = 4, c = 0.2", "  note = first line", "    second <line>"} <= {*lines}

    times = np.linspace(0.5, 5, 10)
    fit = eig3.fit(problem, (times, problem.integrate(h=0.01, t_eval=times).u), {"k": 3.5}, h=0.01)
    (name, value), *_ = rows_of(fit)
    assert name == "k"
    assert float(value.split(" +- ")[0]) == pytest.approx(4.0, rel=1e-6)  # the data come from the same steps
    assert rows_of(fit)[-1] == [fit.message]


@pytest.mark.parametrize("name", ["spring_pendulum", "curtain", "bouncing_ball", "spinning_top"])
def test_problems_of_the_library(name):
    problem = getattr(eig3.problems, name)()
    rows = dict(rows_of(problem))
    size = np.size(problem.u0)
    assert rows["u0"].startswith(f"array of {size}" if size > 8 else f"{np.ravel(problem.u0)[0]:.10g}")


@pytest.mark.parametrize("name", ["argon", "yielding_frame", "four_bar", "kepler"])
def test_a_terminal_shows_the_facts_of_a_notebook(name):
    """A name with each of 12,000 degrees of freedom, or 34 events, would fill it."""
    problem = getattr(eig3.problems, name)()
    shown, rows = repr(problem), rows_of(problem)
    assert shown.startswith(f"{type(problem).__name__}: {name}\n  rhs = rhs\n  u0 = ")
    assert words_of(shown) == words_of(" ".join([type(problem).__name__, name, *map(" ".join, rows)]))
    assert len(shown) < 1000


def test_a_plan_is_a_grid():
    plan = eig3.plan(eig3.problems.single_dof(), 1e-3, methods=["rk4", "rk2", "ab2"])
    head, *rows = rows_of(plan)
    assert head == ["method", "h", "steps", "evaluations", "seconds", "error", ""]
    for row, prediction in zip(rows, plan.predictions, strict=False):
        assert row[0] == prediction.label
        if prediction.reaches:
            assert float(row[1]) == pytest.approx(prediction.h, rel=5e-3)  # three digits
            assert row[-1] == prediction.note
    lines = repr(plan).splitlines()
    assert [line.split()[0] for line in lines if line.startswith("  ")][1:] == [row[0].split()[0] for row in rows]


def test_long_values_of_a_problem_are_brief():
    events = {f"event {i}": eig3.Event(energy) for i in range(10)}
    pair = eig3.linear([1.0, 1.0], None, np.eye(2), t_span=(0, 1)).with_(events=events)
    shown = repr(pair)
    assert "K = sparse matrix of 2 x 2" in shown
    assert "event 7 and 2 more" in shown
    assert "event 8" not in shown
