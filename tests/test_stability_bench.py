"""`eig3 bench stability`: closed forms, eigenvalues and runs agree, and every figure is drawn."""

import sys
import xml.etree.ElementTree as ET

import numpy as np
import pytest

import eig3
from eig3 import problems
from eig3.bench import stability as bench
from eig3.bench import stability_pictures
from eig3.bench.choices import ARTICLE_METHODS
from eig3.bench.stability_sets import DAMPED, FAMILY_DAMPED, GROWING, UNDAMPED, WEAK_GRADES
from eig3.cli import main
from eig3.methods import LIBRARY
from eig3.stability import explain, is_stable

pytestmark = pytest.mark.system

#: The limits of the other grades are tested against theory in test_family_stability.py; here they would take seconds.
#: The undamped table runs RK8, whose runs are the longest.
TESTED = [case for case in DAMPED if case.method.name in (*ARTICLE_METHODS, "eig5")]
TESTED_UNDAMPED = [case for case in UNDAMPED if case.method.name not in ("eig4", "eig9", "eig12", "eig13")]
DAMPING = bench.DAMPING[::3]  # the ends: each value takes 18 runs of every method
GROWTH_AT, WEAK_GROWTH_AT = bench.GROWTH_AT[1:], bench.WEAK_GROWTH_AT[1:]  # the first takes up to 2e7 steps each time
DRAWN = [case for case in FAMILY_DAMPED if case in TESTED]  # with the article's methods
FIGURES = [*(f"figure{i}" for i in (1, 2, 3, 4, 5, 6, 7, 9)), "all_limits"]


@pytest.fixture(scope="module")
def everything(tmp_path_factory):
    """One whole run: its output, its folder, and its figures by name."""
    pytest.importorskip("matplotlib")
    out, lines, figures = tmp_path_factory.mktemp("stability"), [], {}
    save = stability_pictures.save

    def keep(figure, path):
        figures[path.name] = figure
        save(figure, path)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stability_pictures, "save", keep)
        patch.setattr(bench, "DAMPED", TESTED)
        patch.setattr(bench, "UNDAMPED", TESTED_UNDAMPED)
        patch.setattr(bench, "DAMPING", DAMPING)
        patch.setattr(bench, "GROWTH_AT", GROWTH_AT)
        patch.setattr(bench, "WEAK_GROWTH_AT", WEAK_GROWTH_AT)
        patch.setattr(stability_pictures, "FAMILY_DAMPED", DRAWN)
        bench.benchmark(out=out, write=lines.append)
    return "\n".join(lines), out, figures


def rows(printed, title):
    """The cells of the table below a title."""
    lines = printed.split(f"## {title}")[1].split("##")[0].splitlines()
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line.startswith("|")][2:]


@pytest.mark.parametrize(
    ("title", "expected"),
    [
        ("Undamped", [[case.label] for case in TESTED_UNDAMPED]),
        ("With physical damping", [[case.label, f"{xi:g}"] for case in TESTED for xi in DAMPING]),
    ],
)
def test_closed_form_eigenvalue_and_run_agree(everything, title, expected):
    table = rows(everything[0], title)
    assert [row[: len(expected[0])] for row in table] == expected
    for *_, value, eigenvalue, run in table:
        if value != "-":
            assert float(value) == pytest.approx(float(eigenvalue), abs=1.5e-6)  # six digits are printed
        if run != "-":
            assert float(run) == pytest.approx(float(eigenvalue), rel=bench.RESOLUTION + 5e-4, abs=5e-7)  # four digits


def test_growth_of_runs_is_that_of_the_eigenvalue_and_tends_to_its_leading_term(everything):
    table = rows(everything[0], "No stable step")
    assert len(table) == len(GROWING) * len(GROWTH_AT)
    for _, _, Omega, leading, eigenvalue, run in (row[:2] + [float(cell) for cell in row[2:]] for row in table):
        assert run == pytest.approx(eigenvalue, rel=1e-3)
        assert leading == pytest.approx(eigenvalue, rel=2.5 * Omega**2)  # the next term: 2.1 Omega^2 for AB2


def test_only_limits_that_runs_cannot_find_have_none(everything):
    for title in ("Undamped", "With physical damping"):
        without = [row[0] for row in rows(everything[0], title) if row[-1] == "-"]
        assert without == (["EIG-8", "RK5", "BM6"] if title == "Undamped" else [])


def test_weak_growth_of_runs_is_that_of_the_eigenvalue_and_tends_to_its_leading_term(everything):
    """A run of 2e7 steps shows a growth of 1e-13 a step to some 2 %: its round-off is 5e-8 by then. The next term is
    some 7 Omega^2 of the leading one."""
    table = rows(everything[0], "Weak growth")
    assert [row[0] for row in table[:: len(WEAK_GROWTH_AT)]] == [f"EIG-{grade}" for grade in WEAK_GRADES]
    for _, _, Omega, leading, eigenvalue, run in (row[:2] + [float(cell) for cell in row[2:]] for row in table):
        assert run == pytest.approx(eigenvalue, rel=1e-3, abs=5e-15)
        assert eigenvalue == pytest.approx(leading, rel=9 * Omega**2)


def test_every_method_is_explained(everything):
    for case in TESTED:
        assert explain(case.method) in everything[0]
    for name in ("bm6", "rkn12"):
        assert explain(name) in everything[0]
    assert {case.method.name for case in DAMPED} == set(LIBRARY) - {"bm6", "rkn12"}


def test_the_page_holds_the_tables_and_every_picture(everything):
    printed, out, figures = everything
    page = (out / "stability.md").read_text()
    for title in ("Undamped", "With physical damping", "No stable step", "Weak growth"):
        assert rows(page, title) == rows(printed, title)
    assert list(figures) == FIGURES
    for name in FIGURES:
        assert f"![{name}]({name}.svg)" in page


@pytest.mark.parametrize("name", FIGURES)
def test_picture_is_complete(everything, name):
    from matplotlib import image

    _, out, figures = everything
    pixels = image.imread(out / f"{name}.png")
    assert min(pixels.shape[:2]) > 500
    assert 0.01 < (pixels[..., :3].min(axis=-1) < 0.9).mean() < 0.9  # neither empty nor filled
    svg = (out / f"{name}.svg").read_text()
    assert ET.fromstring(svg).tag == "{http://www.w3.org/2000/svg}svg"
    assert "<dc:date>" not in svg
    for axes in figures[name].axes:
        for label in (axes.get_xlabel(), axes.get_ylabel()):
            assert label.endswith(("(-)", "(rad)", "(%)", "(s)", "(m)"))
        assert axes.get_legend() or figures[name].legends
        for line in axes.lines:
            assert np.isfinite(line.get_ydata()).any()


def test_figure_1_shows_the_region_of_is_stable(everything):
    """Points on both sides of each boundary drawn; below beta = 1/2 only steps between two limits are stable."""
    for alpha, beta, Omega, stable in (
        (1.5, 0.5, 1.40, True),
        (1.5, 0.5, 1.43, False),
        (0.99, 0.5, 0.5, False),
        (1.0, 1.0, 0.81, True),
        (1.0, 1.0, 0.82, False),
        (1.0, 0.25, 1.1, False),
        (1.0, 0.25, 1.2, True),
        (1.0, 0.25, 1.6, True),
        (1.0, 0.25, 1.7, False),
    ):
        assert is_stable(eig3.EIG3(alpha, beta), Omega) is stable
    left, right = everything[2]["figure1"].axes
    np.testing.assert_allclose([line.get_xdata()[-1] for line in left.lines], [1, 2])
    np.testing.assert_allclose([line.get_xdata()[-1] for line in right.lines], [3**-0.5, 2, 2])


def test_figure_9_stays_bounded_to_the_limit_and_blows_up_above(everything):
    highest = [np.abs(axes.lines[1].get_ydata()).max() for axes in everything[2]["figure9"].axes]
    assert highest[:3] == pytest.approx([1, 1, 1], abs=1e-12)
    assert highest[3] > 50


def test_central_difference_pays_for_its_solve():
    case = next(case for case in DAMPED if case.label == "CD implicit")
    stepper = problems.single_dof(omega=1.0, xi=0.1).stepper(h=1.9, method=case.method)
    stepper.advance(100)
    assert 3 <= (stepper.n_rhs - 1) / 100 <= 7  # one to three iterations of two, and one


def test_command_runs_it(monkeypatch, tmp_path):
    calls = []
    monkeypatch.setattr(bench, "benchmark", lambda **settings: calls.append(settings))
    out = tmp_path / "new" / "folder"
    assert main(["bench", "stability"]) == 0
    assert main(["bench", "stability", "--out", str(out)]) == 0
    assert calls == [{"out": None}, {"out": out}]
    assert not out.parent.exists()  # the benchmark, which writes nothing here, makes the folder with its first file


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--out", "/dev/null/x"], "cannot create the folder"),
        (["--out"], "expected one argument"),
        (["--repeats", "3"], "unrecognized arguments: --repeats"),
    ],
)
def test_wrong_usage_is_refused(arguments, message, capsys):
    with pytest.raises(SystemExit) as caught:
        main(["bench", "stability", *arguments])
    assert caught.value.code == 2
    assert message in capsys.readouterr().err


def test_without_matplotlib_the_output_says_that_there_are_no_pictures(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    for table in ("UNDAMPED", "DAMPED"):
        monkeypatch.setattr(bench, table, getattr(bench, table)[:1])
    for places in ("GROWTH_AT", "WEAK_GROWTH_AT"):
        monkeypatch.setattr(bench, places, ())
    assert main(["bench", "stability", "--out", str(tmp_path)]) == 0
    assert "no pictures, since matplotlib is not installed" in capsys.readouterr().out
    assert [path.name for path in tmp_path.iterdir()] == ["stability.md"]
