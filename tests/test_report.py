"""The report: numbers apart from the page, runs that go on, comparison of two runs, and a user's own problem."""

import errno
import json
import math
import random
import re
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import vl_convert
from matplotlib.figure import Figure

import eig3
from eig3 import problems
from eig3.bench import hard, loops, paper, precision, report, rivals, stability, sweep, trust
from eig3.bench.article import TABLES
from eig3.bench.hard_cases import HARD_CASES
from eig3.bench.plan import Outcome
from eig3.bench.problem_set import BenchmarkProblem
from eig3.bench.report import own_problem, parts, true_motion
from eig3.bench.report.comparison import Comparison, ratio_and_noise
from eig3.bench.report.record import Record
from eig3.bench.rivals.general import scipy_form
from eig3.bench.sweep import Point, WorkPrecisionSet
from eig3.bench.text import ratio as in_digits
from eig3.cli import main
from eig3.drawing import histories, time_panels

from .conftest import ROOT, linear_springs
from .test_users_report import exact, oscillator, spring

pytestmark = pytest.mark.system

SHORT = {
    "single_dof": BenchmarkProblem(lambda: problems.single_dof(t_end=20.0), 4.0, "oscillator"),
    "kepler": BenchmarkProblem(lambda: problems.kepler(e=0.3, t_end=6.0), 1.8, "orbit"),
}
#: Steps are halved until the accuracies are reached, whatever the machine does.
QUICK = "--method rk4 --no-rivals --repeats 1 --longest 1000 --mode pointer --accuracies 1e-1 1e-3"


@pytest.fixture
def small(monkeypatch):
    """Two short problems in place of the set."""
    for module in (parts, report):
        monkeypatch.setattr(module, "PROBLEM_SET", SHORT)
        monkeypatch.setattr(module, "VARIABLE_SPEED", {})


def command(*words):
    return main(["bench", "report", *map(str, words)])


def two_problems(out, *words):
    return command("--out", out, *QUICK.split(), "--problem", "single_dof", "--problem", "kepler", *words)


def interrupt_second(monkeypatch, module, name):
    """Let the second call be interrupted, as by Ctrl-C."""
    function, calls = getattr(module, name), []

    def interrupted(*arguments, **options):
        calls.append(arguments)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return function(*arguments, **options)

    monkeypatch.setattr(module, name, interrupted)


@pytest.mark.usefixtures("small")
def test_a_run_that_was_cut_off_goes_on_and_gives_what_an_uncut_run_gives(tmp_path, monkeypatch, capsys):
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    monkeypatch.setattr(report, "draw_pictures", lambda record, files: None)  # they would only take time
    assert two_problems(whole) == 0
    with monkeypatch.context() as patch:
        interrupt_second(patch, parts, "measure")
        assert two_problems(cut) == 130
    assert f"1 parts are not measured: eig3 bench report --out {cut} --resume continues." in capsys.readouterr().out
    assert "Not measured yet: precision_kepler." in (cut / "report.md").read_text()
    first = (cut / "precision_single_dof.json").read_bytes()
    assert command("--out", cut, "--resume", "--repeats", "1") == 0
    assert (cut / "precision_single_dof.json").read_bytes() == first
    records = [Record.open(folder) for folder in (whole, cut)]
    assert [record.missing for record in records] == [[], []]
    one, two = ([replace(point, seconds=[]) for r in record.results for point in r.points] for record in records)
    assert one == two
    assert len(one) > 4
    for result in records[1].results:
        assert min(point.errors["trajectory"] for point in result.points) < 1e-3
        picture = records[1].motion(result.name).read_bytes()
        assert picture[8:12] == b"WEBP"
        assert len(picture) < 40_000
    assert records[1].results[0].command == (
        "eig3 bench precision --problem single_dof --repeats 1 --longest 1000 --no-rivals --method rk4 "
        "--accuracies 0.1 0.001"
    )


@pytest.mark.usefixtures("small")
def test_the_page_is_drawn_again_without_measuring_and_what_does_not_fit_its_run_is_refused(
    tmp_path, monkeypatch, capsys
):
    run, again, compared, empty = (tmp_path / name for name in ("run", "again", "compared", "empty"))
    command("--out", run, *QUICK.split(), "--problem", "kepler")
    content = (run / "run.json").read_text()
    for name in ("integrate", "stepper"):
        monkeypatch.setattr(eig3.Problem, name, lambda *arguments, **options: pytest.fail("measured"))
    assert command("--from", run, "--out", again) == 0
    names = {"report.md", "report.html", "precision_kepler.svg", "motion_kepler.webp"}
    assert names <= {path.name for path in again.iterdir()}
    for name in ("report.md", "report.html"):
        assert (again / name).read_text() == (run / name).read_text()
    capsys.readouterr()
    assert command("--from", run, "--against", run, "--out", compared) == 0
    assert "0 became slower and 0 became faster by more than the noise." in capsys.readouterr().out
    assert "## Beside another run" in (compared / "report.md").read_text()

    def refused(message, *words):
        with pytest.raises(SystemExit, match=message) as caught:
            command(*words)
        assert "\n" not in str(caught.value)

    refused("--out DIR to measure, or --from DIR to draw")
    refused("holds a run: continue it with --resume", "--out", run)
    refused("in which repeats is 1, not 2", "--out", run, "--resume", "--repeats", "2")
    refused("in which methods is .'rk4'., not .'rk8'.", "--out", run, "--resume", "--method", "rk8")
    refused("empty has no run.json", "--out", empty, "--resume")
    refused("empty has no run.json", "--from", empty)
    refused("empty has no run.json", "--out", tmp_path / "new", "--against", empty)
    refused("--from only draws", "--from", run, "--repeats", "1")
    refused("--problem must be one of single_dof, kepler, your own as module:name, not orbit", "--out", empty,
            "--problem", "orbit")  # fmt: skip
    (run / "run.json").write_text(content.replace('"cores":', '"cores":9'))
    refused("times of both do not belong together", "--out", run, "--resume")
    elsewhere = content.replace("precision_kepler", "../precision_kepler")
    cleared = content.replace('"cpu":"', '"cpu":"\\u001b[2J')  # it would clear the terminal
    for damaged in ("{", "[]", '{"format": 7}', elsewhere, cleared):
        (run / "run.json").write_text(damaged)
        refused(r"run\.json is damaged or no file of a report", "--from", run)
    (run / "run.json").write_text(content)
    for damaged in ("", "{}", '{"command": "x", "seconds": 1, "data": {}}', "\x00", '{"command": "x", "seconds": 1}'):
        (run / "precision_kepler.json").write_text(damaged)
        refused(r"precision_kepler\.json is damaged or no file of a report", "--from", run)


@pytest.mark.usefixtures("small")
def test_everything_is_on_the_page(tmp_path, monkeypatch):
    """With one rival, and few rows in the parts that are not about a problem: others would only take time."""
    for module in (parts, report):
        monkeypatch.setattr(module, "PROBLEM_SET", {"kepler": SHORT["kepler"]})
    monkeypatch.setattr(sweep, "RIVALS", {"scipy rk45": rivals.RIVALS["scipy rk45"]})
    monkeypatch.setattr(loops, "N_STEPS", 500)
    monkeypatch.setattr(loops, "ARTICLE_PROBLEMS", loops.ARTICLE_PROBLEMS[:1])
    monkeypatch.setattr(paper, "TABLES", [table for table in TABLES if table.number == 4])
    monkeypatch.setattr(paper, "steps_of", lambda table, quick: table.steps[:2])
    monkeypatch.setattr(hard, "HARD_CASES", {1: HARD_CASES[1]})
    monkeypatch.setattr(trust, "PROBLEM_SET", {"kepler": SHORT["kepler"]})
    monkeypatch.setattr(trust, "VARIABLE_SPEED", {})
    monkeypatch.setattr(trust, "FURTHER", {})
    monkeypatch.setattr(trust, "FIXED", ("eig3",))
    monkeypatch.setattr(trust, "ACCURACIES", (1e-3,))
    for name, nothing in (("UNDAMPED", ()), ("DAMPED", ()), ("GROWING", {}), ("weakly_growing", dict)):
        monkeypatch.setattr(stability, name, nothing)
    words = "--method eig3 --repeats 2 --longest 0.001 --mode pointer --accuracies 1e-1 1e-3"
    assert command("--out", tmp_path, *words.split()) == 0
    record = Record.open(tmp_path)
    assert record.missing == []
    assert [result.name for result in record.results] == ["kepler"]
    assert record.results[0].of("scipy rk45")
    assert list(record.texts) == ["c", "stability", "hard", "trust"]
    assert [table.table.number for table in record.article] == [4]
    assert all(len(seconds) == 2 for columns in record.timings.values() for seconds in columns.values())
    markdown, page = ((tmp_path / f"report.{end}").read_text() for end in ("md", "html"))
    headings = ["How to read it", "The article's tables and claims", "Beside C", "Stability limits", "Hard cases"]
    for heading in (*headings, "Can the error"):
        assert f"## {heading}" in markdown
    assert record.run.command in page
    for part in record.run.parts:
        mode = " --mode pointer" if part.startswith("precision") else ""
        assert f"Measured by `{record.measured[part].command}{mode}`." in markdown
    assert (tmp_path / "table4.svg").exists()
    before = Record.open(tmp_path)
    for row in before.timings.values():
        row["pointer"] = [seconds / 2 for seconds in row["pointer"]]  # an older run that was twice as fast
    found = {
        (row.first.problem, row.first.mode): row.ratio for row in Comparison.of(record, before).rows if row.first.mode
    }
    assert found[("single_dof beside C", "pointer")] == pytest.approx(2)
    assert found[("single_dof beside C", "inline")] == found[("Table 4", "pointer")] == 1


def test_the_planners_cases_are_one_table(tmp_path):
    outcomes = [
        Outcome("a, energy 0.01", ["a", *["1"] * 10], True, True, ""),
        Outcome("b, energy 0.01", ["b", *["2"] * 10], False, True, "RK4 takes 2.00 times as long as RK8"),
    ]
    record = Record.create(tmp_path, "eig3 bench report", SETTINGS, ["plan_a", "plan_b"])
    for name, outcome in zip("ab", outcomes, strict=True):
        record.keep(f"plan_{name}", f"eig3 bench plan --repeats 5 --problem {name}", 1.0, [vars(outcome)])
    text = Record.open(tmp_path).texts["plan"]
    assert text.command == "eig3 bench plan --repeats 5 --problem a --problem b"
    assert "in 1 of 2 cases. It reaches the accuracy in 2." in text.markdown
    assert "- b, energy 0.01: RK4 takes 2.00 times as long as RK8" in text.markdown


SETTINGS = {"repeats": 5, "longest": 0.02, "modes": None}
WRONG = [
    None, True, "", "x", "$\\x$", -1, 0, 1e308, 5e-324, 10**400, [], {}, [1], {"a": 1}, "\ud800", math.nan, math.inf
]  # fmt: skip


def paths_in(value, above=()):
    """The keys and indices that lead to everything that JSON holds."""
    entries = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, entry in entries:
        yield (*above, key)
        yield from paths_in(entry, (*above, key))


def damage(rng, path):
    """Cut the text of a JSON file, change a character of it, or delete or change one of its values."""
    text, how = path.read_text(), rng.randrange(8)
    place = rng.randrange(len(text))
    if how == 0:
        path.write_text(text[:place])
    elif how == 1:
        path.write_text(text[:place] + rng.choice('0"{}[],:xe-') + text[place + 1 :])
    else:
        content = holder = json.loads(text)
        depth = rng.randrange(1, 6)  # there are many more of the deep ones
        *above, last = rng.choice([keys for keys in paths_in(content) if len(keys) <= depth])
        for key in above:
            holder = holder[key]
        if how == 2:
            del holder[last]
        else:
            holder[last] = rng.choice(WRONG)
        path.write_text(json.dumps(content))


def test_the_sample_is_small():
    """Every clone has it: a new sample needs a smaller page, or fewer pictures."""
    assert sum(path.stat().st_size for path in (ROOT / "bench/sample").iterdir()) < 5e6


def test_damaged_files_are_drawn_or_refused_by_name(tmp_path, monkeypatch, capsys):
    """Pictures are left out, and so is the code of the charts: they would only take time."""
    monkeypatch.setattr(report, "draw_pictures", lambda record, files: None)
    monkeypatch.setattr(vl_convert, "javascript_bundle", lambda: "")
    sample, whole, broken = ROOT / "tests/data/report", tmp_path / "whole", tmp_path / "broken"
    names = ["precision_bouncing_ball", "plan_single_dof", "article_4", "article_5", "c"]
    whole.mkdir()
    for name in names:
        shutil.copy(sample / f"{name}.json", whole)
    run = json.loads((sample / "run.json").read_text())
    (whole / "run.json").write_text(json.dumps({**run, "parts": names}))
    refused, why = [], "is damaged or no file of a report: remove it and measure it again."
    for seed in range(120):
        rng = random.Random(seed)
        shutil.copytree(whole, broken)
        path = broken / f"{rng.choice(['run', *names])}.json"
        damage(rng, path)
        folders = [("--from", broken, "--against", whole), ("--from", whole, "--against", broken)][seed % 2]
        try:
            assert command(*folders, "--out", tmp_path / "page") == 0
        except SystemExit as error:
            refused.append((str(error), f"eig3 bench report: {path} {why}"))
        shutil.rmtree(broken)
        capsys.readouterr()
    for content in (b"", b"a secret"):  # a picture may be a link to a file of the user
        (whole / "motion_bouncing_ball.webp").write_bytes(content)
        with pytest.raises(SystemExit, match=r"motion_bouncing_ball.webp is not a WebP picture: remove it\.$"):
            command("--from", whole, "--out", tmp_path / "page")
    assert all(message == expected for message, expected in refused)
    assert 60 < len(refused) < 120  # some changes, as that of a word or of a digit, leave a report


def test_labels_and_problems_without_a_stable_run_can_be_drawn(tmp_path):
    """A label is no formula of matplotlib's, and a problem that nothing solves is named."""
    folder = tmp_path / "run"
    folder.mkdir()
    points = [Point("rk4", r"$\x$", "pointer", 0.1, 10, 20, True, {"trajectory": 1e-3}, [1.0])]
    unstable = [replace(points[0], stable=False, errors={}, seconds=[])]
    record = Record.create(folder, "eig3 bench report", SETTINGS, ["precision_x", "precision_y"])
    for name, found in (("x", points), ("y", unstable)):
        result = WorkPrecisionSet(name, f"the {name}", "", "trajectory", (1e-2,), False, "exact", 0.0, found, [])
        record.keep(f"precision_{name}", "eig3 bench precision", 1.0, result.as_json())
    assert command("--from", folder) == 0
    assert "No method that was chosen solves the y." in (folder / "report.md").read_text()
    assert r"$\x$" in (folder / "precision_x.svg").read_text()


def times(rng, median, repeats=5, spread=0.01):
    return [float(x) for x in median * np.exp(spread * rng.standard_normal(repeats))]


def record_of(folder, seed, scale=(), errors=(), settings=(0.1, 0.05, 0.025), uncertainty=0.0, unstable=None):
    """A record of one problem with four methods and a rival, whose times scatter by 1 %.

    The method `unstable` is so with the first setting.
    """
    rng, points = np.random.default_rng(seed), []
    for method in ("eig3", "rk4", "rk5", "rk8", "scipy rk45"):
        mode = "" if method in rivals.RIVALS else "pointer"
        for h in settings:
            seconds = times(rng, dict(scale).get(method, 1.0) * 1e-3 / h)
            error = dict(errors).get(method, h**2)
            stable = method != unstable or h != settings[0]
            points.append(Point(method, method, mode, h, 10, 20, stable, {"trajectory": error}, seconds * stable))
    result = WorkPrecisionSet("x", "x", "", "trajectory", (1e-2,), False, "exact", uncertainty, points, [])
    folder.mkdir()
    record = Record.create(folder, "eig3 bench report", SETTINGS, ["precision_x"])
    record.keep("precision_x", "eig3 bench precision --problem x", 1.0, result.as_json())
    return Record.open(folder)


def test_only_the_method_that_became_slower_is_marked(tmp_path):
    old, new = record_of(tmp_path / "old", 1), record_of(tmp_path / "new", 2, scale={"rk5": 1.5})
    same = Comparison.of(old, old)
    assert same.marked == []
    assert {row.ratio for row in same.rows} == {1.0}
    found = Comparison.of(new, old)
    (row,) = found.marked
    assert (row.first.method, row.mark, row.settings) == ("rk5", "slower", 3)
    assert row.ratio == pytest.approx(1.5, rel=0.03)  # the error of a median of five is 0.6 %, here of three settings
    (back,) = Comparison.of(old, new).marked
    assert (back.first.method, back.mark) == ("rk5", "faster")
    assert found.control == pytest.approx(1, rel=0.03)
    assert "1 became slower and 0 became faster" in found.summary
    assert len(found.everything.splitlines()) == 2 + len(found.rows)
    assert re.search(r"\| x +\| pointer \| +rk5 \| +3 \| +1\.\d+ \|", found.markdown)


def test_changed_results_and_settings_without_a_partner_are_listed(tmp_path):
    old = record_of(tmp_path / "old", 1)
    new = record_of(tmp_path / "new", 1, errors={"rk8": 1.02e-2}, settings=(0.1, 0.05, 0.02))
    found = Comparison.of(new, old)
    assert found.changed == [
        "x, pointer, rk8, 0.1: trajectory error 0.0102, before 0.01",
        "x, pointer, rk8, 0.05: trajectory error 0.0102, before 0.0025",
    ]
    assert "x, pointer, rk4, 0.02" in found.unpaired
    assert "x, pointer, rk4, 0.025" in found.unpaired
    assert {row.settings for row in found.rows} == {2}


def test_errors_that_the_truth_or_round_off_explains_are_not_listed(tmp_path):
    known = {"rk4": 1e-12, "rk5": 2e-6, "rk8": 4e-6}
    old = record_of(tmp_path / "old", 1, errors=known, settings=(0.1,), uncertainty=1e-6)
    new = record_of(tmp_path / "new", 1, errors={"rk4": 9e-12, "rk5": 3e-6, "rk8": 2e-6}, settings=(0.1,))
    assert Comparison.of(new, old).changed == ["x, pointer, rk8, 0.1: trajectory error 2e-06, before 4e-06"]
    worse = record_of(tmp_path / "worse", 1, errors={**known, "rk4": 1e-3}, settings=(0.1,), uncertainty=1e-6)
    assert Comparison.of(worse, old).changed == ["x, pointer, rk4, 0.1: trajectory error 0.001, before 1e-12"]


def test_a_method_that_became_unstable_is_listed(tmp_path):
    old, new = record_of(tmp_path / "old", 1), record_of(tmp_path / "new", 1, unstable="rk5")
    found = Comparison.of(new, old)
    assert found.changed == ["x, pointer, rk5, 0.1: unstable, before stable"]
    assert found.unpaired == []
    assert {row.first.method: row.settings for row in found.rows}["rk5"] == 2


def test_a_rival_of_another_version_tells_nothing_about_the_machine(tmp_path):
    old, new = record_of(tmp_path / "old", 1), record_of(tmp_path / "new", 1, scale={"scipy rk45": 2.0})
    assert Comparison.of(new, old).control == pytest.approx(2, rel=1e-4)  # seconds are kept with five digits
    new.run.environment["scipy"], old.run.environment["scipy"] = "1.1", "1.0"
    found = Comparison.of(new, old)
    assert found.control is None
    assert found.marked == []
    assert "Of 4 pairs" in found.summary
    assert "Noise alone marks 0.04 of them on average" in found.summary
    assert "scipy (1.1, before 1.0)" in found.summary


@pytest.mark.parametrize("shared", [0.0, 0.05])
def test_noise_alone_exceeds_the_stated_noise_in_one_of_a_hundred_runs_at_most(shared):
    """Also where a disturbance hits all settings of a round. 2000 draws of 1 % have a standard deviation of 4.4."""
    rng, exceeded = np.random.default_rng(0), 0
    for _ in range(2000):
        sides = [np.exp(0.05 * rng.standard_normal((4, 5)) + shared * rng.standard_normal((1, 5))) for side in range(2)]
        ratio, noise = ratio_and_noise(list(zip(*sides, strict=True)))
        exceeded += abs(math.log(ratio)) > math.log(noise)
    assert exceeded <= 20 + 3 * 4.4


def test_without_repeats_nothing_is_marked():
    ratio, noise = ratio_and_noise([([2.0], [1.0])])
    assert (ratio, noise) == (pytest.approx(2.0), math.inf)


def panels(problem, **options):
    """The labels and the legends of the panels that a report draws of the motion of a problem."""
    figure = Figure()
    (problem.draw or histories)(figure, problem.integrate(rtol=1e-3, invariants={}, **options))
    return [
        (axes.get_ylabel(), [entry.get_text() for entry in axes.get_legend().get_texts()])
        for axes in time_panels(figure)
    ]


def test_the_motion_of_a_users_problem_has_its_names_and_units():
    plain = eig3.Problem("plain", linear_springs, [1.0, 0.5], [0.0, 0.0], [4.0], (0.0, 1.0))
    assert panels(plain) == [("displacement (m)", ["$u_{0}$", "$u_{1}$"]), ("velocity (m/s)", ["$u_{0}$", "$u_{1}$"])]
    assert [label for label, _ in panels(plain.with_(units=""))] == ["displacement", "velocity"]
    assert panels(plain.with_(names=("x", "tilt"), units=("mm", "rad"))) == [
        ("displacement (mm)", ["x"]),
        ("displacement (rad)", ["tilt"]),
        ("velocity (mm/s)", ["v_x"]),
        ("velocity (rad/s)", ["v_tilt"]),
    ]


def test_small_ratios_keep_a_digit():
    found = [in_digits(value) for value in (12.3, 1.0, 0.043, 0.01, 0.0099, 0.0034, 2.34e-5)]
    assert found == ["12.30", "1.00", "0.04", "0.01", "0.01", "0.003", "2e-05"]


def test_a_slow_rival_has_no_ratio_of_zero():
    runs = [
        Point(method, method, mode, 0.1, 10, 20, True, {"trajectory": 1e-4}, [seconds])
        for method, mode, seconds in (("rk4", "pointer", 1e-5), ("scipy dop853", "", 0.1))
    ]
    result = WorkPrecisionSet("x", "x", "", "trajectory", (1e-2,), False, "exact", 0.0, runs, [])
    assert re.search(r"\| ratio of the times +\| +0\.0001 \|", precision.render(result))


@pytest.mark.usefixtures("few_reported")
def test_a_users_problem_with_the_name_of_another_is_not_taken_for_it(tmp_path, monkeypatch):
    """And where the time is short, something is measured all the same."""
    monkeypatch.setattr(own_problem, "_INLINED", 0)
    monkeypatch.setattr(own_problem, "_TIMING", 0.0)
    problem = eig3.Problem("kepler", linear_springs, [1.0, 0.5], [0.0, 0.0], [4.0], (0.0, 20.0))
    page = eig3.report(problem, tmp_path, accuracies=[1e-4], rivals=["heyoka", "scipy dop853"], repeats=1)
    (result,) = Record.open(page.parent).results
    assert result.source.startswith("RK8 with ")
    left = " ".join(result.skipped)
    assert "(would take too long)" in left
    assert re.search(r"heyoka \((needs the equations in its own symbols|not installed)\)", left)
    (ours,) = (point for point in result.points if point.mode == "pointer")
    assert ours.errors["trajectory"] < 1e-3
    assert min(point.errors["trajectory"] for point in result.of("scipy dop853")) < 1e-4
    assert not result.of("heyoka")


@pytest.mark.usefixtures("symplectic_euler")
def test_a_users_report_measures_the_named_methods(tmp_path):
    page = eig3.report(
        oscillator(), tmp_path, accuracies=[1e-2], rivals=False, repeats=1, methods=["symplectic-euler", "cd"]
    )
    (result,) = Record.open(page.parent).results
    assert {*result.methods} == {"symplectic-euler", "cd"}


def test_the_truth_of_a_users_problem_is_known_to_its_uncertainty():
    problem = oscillator()
    grid = own_problem.Grid.of(problem)
    truth = own_problem.find_truth(problem, grid, 1e-8)
    t = np.linspace(0, 20, grid.count + 1)
    error = np.abs(truth.u(t) - exact(t)[0]).max()
    # of the two runs of RK8 that differ by the uncertainty, the better one errs by 1/255 of it, and by round-off
    assert error < truth.uncertainty + 1e-12
    assert truth.uncertainty <= 1e-9
    assert "RK5" in truth.source


def test_runs_that_contradict_each_other_leave_the_larger_uncertainty(monkeypatch):
    differences = iter((1e-4, 1e-7, 5e-5))
    monkeypatch.setattr(true_motion, "_run", lambda *_: SimpleNamespace(success=True, n_steps=_[-1]))
    monkeypatch.setattr(true_motion, "_difference", lambda one, two: next(differences))
    solution, uncertainty = true_motion._halved(None, own_problem.Grid((0.0, 1.0), 976), 1e-12)
    assert (solution.n_steps, uncertainty) == (8 * 976, 5e-5)


def test_an_energy_without_relative_errors_is_left_out():
    orbit = problems.kepler(e=0.3)
    mu = float(orbit.params[0])
    parabola = orbit.with_(u0=[1.0, 0.0], v0=[0.0, math.sqrt(2 * mu)])
    assert abs(parabola.energy_of(parabola.u0, parabola.v0)) < 1e-15 * mu
    kicked = orbit.with_(events={"kick": eig3.Event(lambda t, u, v, p: u[0], apply=lambda t, u, v, p: None)})
    for problem, reason in ((parabola, "at the start, so that relative errors"), (kicked, "events may take some")):
        judged, skipped = own_problem._judged(problem)
        assert judged.energy is None
        assert reason in " ".join(skipped)
    assert own_problem._judged(orbit)[0].energy is orbit.energy


def test_a_rival_reads_parameters_that_are_a_number():
    y0, slope = scipy_form(eig3.Problem("oscillator", spring, 1.0, 0.0, 4.0, (0.0, 20.0)))
    assert slope(0.0, y0).tolist() == [0.0, -4.0]


def test_a_run_compares_enough_states_of_the_grid():
    grid = own_problem.Grid((0.0, 1.0), 976)
    for n_steps in (1, 61, 100, 600, 5000, 123_456):
        fitted = grid.fit(n_steps)
        steps = grid.steps(fitted)
        states = fitted // steps["save_every"]
        assert n_steps <= fitted <= max(61, 1.25 * n_steps)
        assert grid.count % states == 0
        assert fitted % states == 0
        assert states >= min(976, fitted / 8)


@eig3.jit
def raises(t, u, v, p):
    if t > 1:
        raise ValueError("too late")
    return -u


explodes = eig3.jit(lambda t, u, v, p: u * u * u)

OWN = """
import eig3
from eig3 import problems
number = 3
def broken():
    raise ValueError("no data")
def ball():
    return problems.bouncing_ball().with_(events={"end": eig3.Event(lambda t, u, v, p: u, terminal=True)})
"""


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("nothing_there:x", "--problem nothing_there:x: there is no module nothing_there here or among the installed"),
        ("mine:missing", "the module mine has no missing"),
        ("mine:", "the module mine has no empty name"),
        ("mine:number", "problem must be an eig3.Problem or a function that returns one, not int"),
        ("mine:broken", r"broken\(\) fails \(ValueError: no data\)"),
        ("mine:ball", "problem must have no terminal event, such as 'end' of bouncing_ball"),
        ("needs:x", r"the module needs cannot be imported \(No module named 'not_installed'\)"),
        ("wrong:x", r"the module wrong cannot be imported \(SyntaxError"),
    ],
)
def test_a_wrong_name_of_a_users_problem_gets_a_sentence(name, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for module, text in (("mine", OWN), ("needs", "import not_installed"), ("wrong", "x = (")):
        (tmp_path / f"{module}.py").write_text(text)
    with pytest.raises(SystemExit, match=message) as caught:
        command("--out", "new", "--problem", name)
    assert "\n" not in str(caught.value)
    for module in ("mine", "needs", "wrong"):
        sys.modules.pop(module, None)


def test_wrong_arguments_of_a_users_report_are_refused_before_it_begins(tmp_path):
    problem, out = oscillator(), tmp_path / "new"
    for wrong, message in (
        ({"accuracies": ()}, "accuracies must be a sequence of numbers between 0 and 1"),
        ({"accuracies": (1e-3, 2)}, "accuracies must be a sequence of numbers between 0 and 1"),
        ({"accuracies": 1e-4}, "accuracies must be a sequence of numbers between 0 and 1"),
        ({"accuracies": ("small",)}, "accuracies must be a sequence of numbers between 0 and 1"),
        ({"repeats": 0}, "repeats must be a whole number"),
        ({"rivals": ("scipy",)}, "rivals must be True, False or names of scipy dop853"),
    ):
        with pytest.raises(ValueError, match=message):
            eig3.report(problem, out, **wrong)
    with pytest.raises(ValueError, match=r"method must be one of .* not 'euler'"):
        eig3.report(problem, out, methods=["euler"])
    with pytest.raises(TypeError, match="methods must be names of methods"):
        eig3.report(problem, out, methods=[eig3.EIG3(alpha=1.2)])
    with pytest.raises(TypeError, match=r"problem must be an eig3\.Problem"):
        eig3.report(spring, out)
    assert not out.exists()


def test_missing_packages_are_named_before_anything_is_written(tmp_path, monkeypatch):
    monkeypatch.setattr(report.importlib.util, "find_spec", lambda name: None if name in ("scipy", "jinja2") else name)
    with pytest.raises(ImportError, match=r"eig3\.report needs scipy, jinja2: .*eig3\[bench\]"):
        eig3.report(oscillator(), tmp_path / "new")
    with pytest.raises(SystemExit, match=r"eig3 bench report needs scipy, jinja2: .*eig3\[bench\]"):
        command("--out", tmp_path, *QUICK.split())
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("function", ["mkdir", "write_bytes", "write_text"])
def test_a_folder_that_cannot_be_written_is_an_os_error(function, tmp_path, monkeypatch):
    def full(*arguments, **options):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, function, full)
    with pytest.raises(OSError, match=r"out: cannot .*No space left on device.*hoose another folder\.$") as caught:
        eig3.report(oscillator(), tmp_path / "new")
    assert "--out" not in str(caught.value)


def test_problems_that_would_have_the_same_files_are_refused(tmp_path):
    with pytest.raises(SystemExit, match="--problem a:b_c and --problem a_b:c would be kept in the same files"):
        command("--out", tmp_path, "--problem", "a:b_c", "--problem", "a_b:c")


def test_the_command_of_a_users_problem_has_the_settings_that_were_given():
    settings = parts.Settings(["mine:ball", "mine:x"], None, 2, modes=["inline"], rivals=False, accuracies=[1e-3, 1e-5])
    assert [part.command for part in parts.parts_of(settings)] == [
        f"eig3 bench report --out DIR --problem mine:{name} --repeats 2 --mode inline --no-rivals "
        "--accuracies 0.001 1e-05"
        for name in ("ball", "x")
    ]


def test_a_problem_that_no_chosen_method_solves_is_named_and_has_no_results(tmp_path):
    unsolved = WorkPrecisionSet("x", "a ball", "", "trajectory", (1e-2,), False, "exact", 0.0, [], [])
    record = Record.create(tmp_path, "eig3 bench report", SETTINGS, ["precision_x"])
    record.keep("precision_x", "eig3 bench precision --problem x", 1.0, unsolved.as_json())
    assert record.results == []
    assert record.unsolved == ["a ball"]


def test_the_picture_of_a_motion_is_small_and_goes_with_its_record(tmp_path, monkeypatch):
    monkeypatch.setattr(parts, "_LARGEST", 2000)  # no quality is so small at the full width
    record = Record.create(tmp_path, "", {}, ["precision_x"])
    parts.draw_motion(record, "x", SHORT["kepler"].build())
    assert 0 < record.motion("x").stat().st_size <= 2000
    assert Record.create(tmp_path, "", {}, ["precision_x"]).motion("x") is None


def test_a_users_problem_that_cannot_be_run_says_why(tmp_path, monkeypatch):
    late = eig3.Problem("late", raises, 1.0, 0.0, [], (0.0, 5.0))
    with pytest.raises(ValueError, match="too late"):
        eig3.report(late, tmp_path)
    unbounded = eig3.Problem("unbounded", explodes, 1.0, 1.0, [], (0.0, 5.0))
    monkeypatch.setattr("eig3.bench.report.true_motion._SECONDS", 0.0)
    with pytest.raises(ValueError, match=r"problem unbounded does not reach the end of t_span with RK8: .*non-finite"):
        eig3.report(unbounded, tmp_path)


def test_numbers_that_are_not_finite_are_null_in_json(tmp_path):
    record = record_of(tmp_path / "x", 1, errors={"rk4": math.inf})
    content = json.loads((tmp_path / "x" / "precision_x.json").read_text(), parse_constant=pytest.fail)
    assert None in [point["errors"]["trajectory"] for point in content["data"]["points"]]
    assert math.inf in [point.errors["trajectory"] for point in record.results[0].points]
