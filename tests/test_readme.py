"""The blocks of every README run: Python as written, with the output shown, and the commands."""

import contextlib
import io
import itertools
import re

import numpy as np
import pytest

import eig3
from eig3.cli import main
from eig3.stability import limit

from .conftest import BLOCKS, OWN_METHOD, README_FILES, ROOT

LINES = 150  # of the first page


def texts(readme, wanted):
    return [text for language, text in BLOCKS[readme] if language == wanted]


def shown(code, language, text):
    """Return the output that a block shows: in the block of text after it, or in the comments at its end."""
    if language == "text":
        return text
    (comments,) = re.search(r"((?:^# .*\n)*)\Z", code, flags=re.MULTILINE).groups()
    return re.sub("^# ", "", comments, flags=re.MULTILINE)


MARKS = {"bench/README.md": pytest.mark.system}  # its examples are benchmarks


@pytest.mark.usefixtures("few_reported")
@pytest.mark.parametrize("readme", [pytest.param(name, marks=MARKS.get(name, ())) for name in README_FILES])
def test_examples_print_what_they_show(readme, symplectic_euler, tmp_path, monkeypatch):
    """The blocks of one file share a namespace, and a block that shows no output prints nothing."""
    monkeypatch.chdir(tmp_path)
    namespace = {}
    for (language, code), (next_language, next_text) in itertools.pairwise([*BLOCKS[readme], ("", "")]):
        if language != "python" or code == OWN_METHOD:  # which the fixture has imported as a file
            continue
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(code, readme, "exec"), namespace)
        assert printed.getvalue() == shown(code, next_language, next_text)
    for code in code_of_tables(readme) if readme == "eig3/OTHER_CODES.md" else ():
        eval(compile(code, readme, "eval"), namespace)


def code_of_tables(readme):
    """Return the code in the last column of the tables, which follow the blocks that define its names."""
    rows = re.findall(r"^\|.*\| (.*?) *\|$", (ROOT / readme).read_text(), flags=re.MULTILINE)
    return [code for cell in rows for code in re.findall(r"`([^`]+)`", cell)]


@pytest.mark.parametrize("code", ["SciPy", "LAMMPS", "OpenSees", "MuJoCo"])
def test_a_table_maps_the_names_of_each_code(code):
    """Each row has code of this library, or says that there is none."""
    text = (ROOT / "eig3/OTHER_CODES.md").read_text()
    (table,) = re.findall(rf"^\| in {code} you write .*\n\| -.*\n((?:\|.*\n)+)", text, flags=re.MULTILINE)
    rows = table.splitlines()
    assert len(rows) >= 15
    assert [row for row in rows if not re.search(r"`[^`]+`[^|]*\|$", row)] == []


def test_the_effects_of_the_tables_are_most_of_all():
    """Effects without a counterpart in another code are not there, such as SofteningSpring."""
    text = (ROOT / "eig3/OTHER_CODES.md").read_text()
    known = [name for name in eig3.effects.__all__ if f"{name}(" in text]
    assert len(known) >= 25


@pytest.mark.parametrize("readme", README_FILES)
def test_every_block_is_one_that_is_tested(readme):
    languages = [language for language, _ in BLOCKS[readme]]
    assert {*languages} <= {"sh", "python", "text"}
    assert all(languages[i - 1] == "python" for i, language in enumerate(languages) if language == "text")
    assert (ROOT / readme).read_text().count("```") == 2 * len(languages)


def anchors(page):
    """Return the anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(), flags=re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("readme", README_FILES)
def test_links_lead_to_files_and_headings(readme):
    page = ROOT / readme
    links = re.findall(r"\]\(([^)]+)\)", page.read_text())
    for link in (link for link in links if not link.startswith("https://")):
        path, _, anchor = link.partition("#")
        target = page.parent / path if path else page
        assert target.exists(), link
        assert not anchor or anchor in anchors(target), link


def test_the_first_page_is_short():
    assert len((ROOT / "README.md").read_text().splitlines()) <= LINES


def test_every_page_is_reached_from_the_first():
    """In one step, so that no page is lost."""
    first = (ROOT / "README.md").read_text()
    assert [readme for readme in README_FILES[1:] if f"]({readme})" not in first] == []


@eig3.jit
def spring(t, u, v, p):
    return -u


@eig3.jit
def springs(t, u, v, p, a):
    for j in range(u.size):
        a[j] = -u[j]


def test_the_method_of_the_readme_works(symplectic_euler):
    errors = []
    for h in (0.01, 0.005):
        run = eig3.integrate(spring, (0, 10), 1.0, 0.0, h=h, method="symplectic-euler")
        errors.append(np.abs(run.u - np.cos(run.t)).max())
        vector = eig3.integrate(springs, (0, 10), [1.0, 2.0], [0.0, 0.0], h=h, method=symplectic_euler())
        np.testing.assert_allclose(vector.u, run.u[:, None] * [1, 2], rtol=0, atol=1e-12)
        assert run.n_rhs == run.n_steps + 1
    assert np.log2(errors[0] / errors[1]) == pytest.approx(1, abs=0.05)
    assert limit(symplectic_euler()) == pytest.approx(2, abs=1e-8)


@pytest.mark.parametrize("command", texts("problems/README.md", "sh")[0].splitlines())
def test_the_scenes_of_the_readme_run(command, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    program, *arguments = command.split()
    assert program == ".venv/bin/eig3"
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    name = arguments[1]
    for expected in (f"{name}: ", "steps of h = ", "ns a step", "energy: ", "work done: ", f"{name}.png"):
        assert expected in printed
    with np.load(tmp_path / "out" / f"{name}.npz") as history:
        assert history["u"].shape == history["v"].shape
        assert len(history["t"]) == len(history["u"])
    assert (tmp_path / "out" / f"{name}.csv").exists() == (name not in ("curtain", "pounding_buildings"))
    assert (tmp_path / "out" / f"{name}.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("command", texts("eig3/ensembles/README.md", "sh")[0].replace("\\\n", "").splitlines())
def test_the_studies_of_the_readme_run(command, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    program, *arguments = command.split()
    assert program == ".venv/bin/eig3"
    assert main(arguments) == 0
    assert "diverged" not in capsys.readouterr().out
    out = tmp_path / arguments[-1]
    assert {path.name for path in out.iterdir()} == {"sweep.csv", "sweep.npz", "sweep.png"}


@pytest.mark.parametrize("readme", README_FILES)
def test_commands_are_those_that_run(readme):
    """CI runs those of the first README, `test_suites` those of pytest-benchmark, and the tests above the others."""
    commands = texts(readme, "sh")
    if readme == "README.md":
        assert len(commands) == 2
        assert commands[0].endswith("eig3 bench\n")
        assert commands[1].endswith("pytest -q -n auto --dist worksteal\n")
        runner = (ROOT / ".ci" / "run").read_text()
        assert "readme_command 1" in runner
        assert "readme_command 2" in runner
    elif readme == "bench/README.md":
        (lines,) = (block.splitlines() for block in commands)
        assert all(line.startswith(".venv/bin/pytest bench --benchmark-only ") for line in lines)
    else:
        assert len(commands) == (readme in ("problems/README.md", "eig3/ensembles/README.md"))


def test_every_benchmark_and_problem_is_in_its_readme():
    from eig3.bench import BENCHMARKS

    bench, problems = ((ROOT / name / "README.md").read_text() for name in ("bench", "problems"))
    assert [name for name in BENCHMARKS if f"`eig3 bench {name}" not in bench] == []
    assert [name for name in eig3.problems.__all__ if f"`{name}`" not in problems] == []
