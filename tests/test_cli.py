"""The command line, and the benchmarks it runs."""

import io
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import eig3
from eig3 import problems
from eig3.bench import BENCHMARKS, article_runs, loops, paper, precision, stability, text, timing
from eig3.bench.article import TABLES, Table
from eig3.bench.sweep import WorkPrecisionSet
from eig3.cli import main
from eig3.command_line import Files
from eig3.methods import LIBRARY
from eig3.run_report import run

from .conftest import python

WITH_OUT = ("paper", "precision", "stability", "scenes", "report")


def test_version_and_help(capsys):
    for arguments, expected in ((["--version"], f"eig3 {eig3.__version__}"), (["--help"], "usage: eig3")):
        with pytest.raises(SystemExit) as caught:
            main(arguments)
        assert caught.value.code == 0
        assert expected in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "required: command"),
        (["integrate"], "invalid choice"),
        (["bench", "paper", "--fast"], "unrecognized arguments: --fast"),
        (["bench", "paper", "--table", "6"], "invalid choice"),
        (["bench", "paper", "--repeats", "0"], "must be a whole number of at least 1"),
        (["bench", "paper", "--repeats", "x"], "must be a whole number of at least 1"),
        (["bench", "paper", "--out", "/dev/null/x"], "cannot create the folder"),
    ],
)
def test_wrong_usage_is_refused(arguments, message, capsys):
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("t_end", ["1e9", "1e300"])
@pytest.mark.parametrize("name", ["shear_building", "quarter_car"])
def test_a_record_that_fits_in_no_memory_is_refused_in_a_sentence(name, t_end):
    with pytest.raises(SystemExit) as caught:
        main(["run", name, "--t-end", t_end])  # the status of a text is 1
    text = str(caught.value.code)
    assert text.startswith("eig3 run: this does not fit in the memory: a record up to ")
    assert text.endswith(" are free; take a shorter t_end.")


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="needs /proc, in which nobody can write")
@pytest.mark.parametrize(
    "command",
    [
        "run kepler --out /proc",
        "run kepler --out /proc/motion.dump",
        "run kepler --show /proc/view.html",
        "show kepler --out /proc/view.html",
        "bench --out /proc",
        *(f"bench {name} --out /proc" for name in WITH_OUT),
    ],
)
def test_a_folder_that_cannot_be_written_is_refused_before_the_run(command, capsys):
    with pytest.raises(SystemExit) as caught:
        main(command.split())
    assert caught.value.code == 2
    printed = capsys.readouterr()
    assert re.search("error: argument --(out|show): cannot write to the folder '/proc': ", printed.err)
    assert printed.err.endswith("; choose another folder\n")
    assert printed.out == ""


def test_only_the_folder_that_a_command_writes_to_is_created(tmp_path, capsys):
    """The last of several options counts, and a command that ends with an error leaves nothing."""
    last = tmp_path / "b" / "c"
    assert main(["run", "kepler", "--t-end", "1", "--out", str(tmp_path / "a"), "--out", str(last)]) == 0
    assert sorted(tmp_path.iterdir()) == [tmp_path / "b"]
    assert (last / "kepler.npz").exists()
    for arguments in (["run", "keppler"], ["run", "kepler", "--h", "-1"], ["run", "kepler", "--out", "motion.csv"]):
        with pytest.raises(SystemExit):
            main([*arguments[:2], "--out", str(tmp_path / "a"), *arguments[2:]])
    assert sorted(tmp_path.iterdir()) == [tmp_path / "b"]
    assert "--out: must be a folder, and not the file 'motion.csv': leave" in capsys.readouterr().err


def test_a_file_that_cannot_be_written_leaves_the_older_one_and_the_others(limited_files, tmp_path):
    (tmp_path / "long").write_text("older")
    files, printed = Files(tmp_path, "eig3 run"), []
    with limited_files(5000):
        for name, size in (("long", 6000), ("short", 10)):
            with files.writing(name) as path:
                path.write_text("x" * size)
    message = r"^eig3 run: cannot write to the folder .*: long \(File too large\)\. Choose another folder with --out\.$"
    with pytest.raises(SystemExit, match=message):
        files.finish(printed.append)
    assert printed == [f"\nWritten to {tmp_path}: short"]
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"long": "older", "short": "x" * 10}
    with files.writing("long") as path:
        path.write_text("newer")
    files.check()
    assert (tmp_path / "long").read_text() == "newer"


def test_an_output_that_is_closed_or_full(monkeypatch):
    monkeypatch.setattr(sys, "stdout", None)
    assert main(["cache", "--path"]) == 0

    class Full(io.StringIO):
        def flush(self):
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(sys, "stdout", Full())
    with pytest.raises(SystemExit, match=r"^eig3 cache: \[Errno 28\] No space left on device$"):
        main(["cache", "--path"])


def test_the_command_is_installed_and_its_help_imports_no_benchmark():
    code = (
        "import runpy, sys\n"
        "for option in ('--version', '--help'):\n"
        "    sys.argv[1:] = [option]\n"
        "    try: runpy.run_module('eig3', run_name='__main__')\n"
        "    except SystemExit as error: assert not error.code\n"
        "sys.exit(any(m.startswith(('eig3.bench.', 'eig3.problems')) for m in sys.modules))"
    )
    assert python("-c", code).startswith(f"eig3 {eig3.__version__}\nusage: eig3 ")


@pytest.mark.parametrize("command", ["run", "plan"])
def test_help_lists_the_problems(command, capsys):
    with pytest.raises(SystemExit):
        main([command, "--help"])
    printed = "".join(capsys.readouterr().out.split())
    assert ",".join(eig3.problems.__all__) in printed


@pytest.mark.parametrize("name", BENCHMARKS)
def test_every_benchmark_is_listed_and_describes_itself(name, capsys):
    for arguments, expected in ((["bench", "--help"], f"\n    {name} "), (["bench", name, "--help"], "options:")):
        with pytest.raises(SystemExit) as caught:
            main(arguments)
        assert caught.value.code == 0
        printed = capsys.readouterr().out
        assert expected in printed
    assert printed.startswith(f"usage: eig3 bench {name} ")


def test_bench_alone_is_the_quick_paper(monkeypatch):
    calls = []
    monkeypatch.setattr(paper, "benchmark", lambda **settings: calls.append(settings))
    main(["bench"])
    main(["bench", "--quick"])
    main(["bench", "paper", "--quick"])
    main(["bench", "paper"])
    main(["bench", "paper", "--quick", "--repeats", "5", "--table", "2"])
    quick = {"only": None, "repeats": paper.QUICK_REPEATS, "quick": True, "out": None}
    assert calls[:3] == [quick, quick, quick]
    assert calls[3] == {"only": None, "repeats": 10, "quick": False, "out": None}
    assert calls[4] == {"only": 2, "repeats": 5, "quick": True, "out": None}


@pytest.fixture
def short_tables(monkeypatch):
    """The article's tables with their two largest steps only."""
    short = [
        Table(t.number, t.title, t.metric, t.problem, t.steps[:2], {m: e[:2] for m, e in t.entries.items()})
        for t in TABLES
        if t.number < 5
    ]
    monkeypatch.setattr(paper, "TABLES", short)


@pytest.mark.system
@pytest.mark.usefixtures("short_tables")
def test_paper_prints_keeps_and_draws_everything(tmp_path, capsys):
    out = tmp_path / "new" / "folder"
    assert main(["bench", "paper", "--repeats", "2", "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    words = ["Table 1", "Table 4", "ns/step", "[a] printed 6.9e23", "Median times relative to EIG-3"]
    assert not [word for word in (*words, "does not hold here") if word not in printed]
    assert "3. With velocity terms CD takes 5.6 times EIG-3" in printed
    assert "4. On the pendulum" not in printed  # this claim needs Table 5

    results = json.loads((out / "results.json").read_text())
    assert {"cpu", "numba", "numpy", "python", "eig3"} <= set(results["environment"])
    assert results["settings"]["repeats"] == 2
    assert len(results["tables"]) == 4
    for table in results["tables"]:
        for cell in table["cells"]:
            assert len(cell["seconds"]) == 2
            assert cell["mean_seconds"] == pytest.approx(sum(cell["seconds"]) / 2)
            assert cell["n_rhs"] >= cell["n_steps"]
            if cell["entry"] and not cell["entry"]["mark"]:
                assert cell["error"] == pytest.approx(cell["entry"]["recomputed"], rel=0.02)
    assert (out / "tables.md").read_text().strip() in printed
    for number in (1, 2, 3, 4):
        assert (out / f"table{number}.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.system
@pytest.mark.usefixtures("short_tables")
def test_paper_prints_and_writes_all_that_it_can(tmp_path, capsys):
    (tmp_path / "results.json").mkdir()
    with pytest.raises(SystemExit, match=r"^eig3 bench: cannot write to .*: results\.json \(.+\)\. Choose another"):
        main(["bench", "paper", "--repeats", "1", "--table", "2", "--out", str(tmp_path)])
    assert f"Written to {tmp_path}: tables.md, table2.png\n" in capsys.readouterr().out
    assert {path.name for path in tmp_path.iterdir()} == {"results.json", "tables.md", "table2.png"}


@pytest.mark.system
def test_report_does_not_measure_what_it_cannot_write(tmp_path, monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")  # compiling C would only take time
    monkeypatch.setattr(paper, "benchmark", lambda **settings: pytest.fail("measured"))
    (tmp_path / "report.html").mkdir()
    with pytest.raises(SystemExit, match=r"^eig3 bench report: cannot write to .*: report\.html \("):
        main(["bench", "report", "--out", str(tmp_path)])


@pytest.mark.system
@pytest.mark.usefixtures("short_tables")
def test_without_matplotlib_the_output_says_that_there_are_no_pictures(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    main(["bench", "paper", "--repeats", "1", "--table", "2", "--out", str(tmp_path)])
    assert "no pictures, since matplotlib is not installed" in capsys.readouterr().out
    assert (tmp_path / "results.json").exists()


@pytest.mark.system
@pytest.mark.usefixtures("short_tables")
def test_an_interrupted_benchmark_keeps_the_complete_tables(tmp_path, capsys, monkeypatch):
    def interrupted_at_table_2(problem, h, method):
        if problem.name == "hardening_spring":
            raise KeyboardInterrupt
        return error_of(problem, h, method)

    error_of = article_runs.error_of
    monkeypatch.setattr(article_runs, "error_of", interrupted_at_table_2)
    assert main(["bench", "paper", "--repeats", "1", "--out", str(tmp_path)]) == 130
    assert "Interrupted." in capsys.readouterr().err
    assert [table["number"] for table in json.loads((tmp_path / "results.json").read_text())["tables"]] == [1]


@pytest.mark.system
def test_a_history_that_does_not_fit_is_timed_in_chunks(monkeypatch):
    problem = eig3.problems.spring_pendulum(t_end=1.0)
    monkeypatch.setattr(timing, "available_memory", lambda: 32.0 * 2 * 300)
    storage = timing.Storage.for_runs(problem, [1e-3])
    assert storage.u.shape == (300, 2)
    assert timing.kernel_run(problem.stepper(h=1e-3), 1000, storage=storage)() > 0
    whole = problem.integrate(h=1e-3)
    assert (storage.u[:100] == whole.u[901:1001]).all()


@pytest.mark.system
def test_speed_has_a_row_for_each_method_and_problem(capsys, monkeypatch):
    monkeypatch.setattr(loops, "N_STEPS", 2000)
    monkeypatch.setattr(loops, "ARTICLE_PROBLEMS", loops.ARTICLE_PROBLEMS[::3])  # one number, and a pair of numbers
    assert main(["bench", "speed", "--method", "eig3", "--method", "ab2", "--repeats", "1"]) == 0
    printed = capsys.readouterr().out
    assert printed.count("| single_dof, ") == 2
    with pytest.raises(SystemExit, match="must be one of"):
        main(["bench", "speed", "--method", "euler"])


@pytest.mark.system
@pytest.mark.usefixtures("symplectic_euler")
def test_a_users_method_is_in_no_benchmark(capsys, monkeypatch):
    assert "symplectic-euler" in eig3.METHODS
    monkeypatch.setattr(loops, "N_STEPS", 1000)
    monkeypatch.setattr(loops, "ARTICLE_PROBLEMS", loops.ARTICLE_PROBLEMS[:1])
    # compiling the inline kernels takes seconds, and the rows do not depend on it
    monkeypatch.setattr(loops, "kernel_loop", lambda *run, inline: lambda: 1.0)
    assert main(["bench", "speed", "--repeats", "1"]) == 0
    labels = [eig3.METHODS[name]().label for name in loops.METHODS]
    rows = [line.split("|")[1].strip() for line in capsys.readouterr().out.splitlines() if line.startswith("| single")]
    assert rows == [f"single_dof, {label}" for label in labels]

    measured = []

    def measure(name, chosen, methods, *settings, **options):
        measured.extend(methods)
        return WorkPrecisionSet(name, chosen.title, "", chosen.metric, chosen.targets, False, "", 0.0, [], [])

    monkeypatch.setattr(precision, "measure", measure)
    main(["bench", "precision", "--problem", "single_dof"])
    assert measured == list(LIBRARY)
    assert "symplectic-euler" not in measured

    monkeypatch.setattr(stability, "UNDAMPED", ())
    monkeypatch.setattr(stability, "GROWING", {})
    monkeypatch.setattr(stability, "DAMPING", ())
    monkeypatch.setattr(stability, "weakly_growing", dict)
    monkeypatch.setattr(stability, "explain", repr)
    assert main(["bench", "stability"]) == 0
    assert "symplectic" not in capsys.readouterr().out.lower()


def test_table_is_aligned_markdown():
    lines = text.table(["a", "bb"], [["long", "1"], ["c", "234"]]).splitlines()
    assert lines == ["| a    |  bb |", "| ---- | --: |", "| long |   1 |", "| c    | 234 |"]


def test_numbers_keep_their_zeros_and_printed_numbers_their_digits():
    assert [text.printed(x) for x in (None, 0.0, 3.1e-3, 7.32e38)] == ["-", "0.0", "0.0031", "7.32e+38"]
    assert [text.number(x) for x in (None, 0.0, 1, 198.2, 2.66512e-5)] == ["-", "0.0", "1.00", "198", "2.67e-05"]


def test_run_takes_any_problem_method_and_step(tmp_path, capsys):
    assert main(["run", "kepler", "--h", "0.01", "--method", "rk4", "--check", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "\n  error of u at most " in printed
    assert "Solution by RK4(): completed" in printed
    assert "steps of h = 0.01," in printed or "steps of h = 0.00999" in printed
    assert "change of energy: " in printed
    assert {path.name for path in tmp_path.iterdir()} == {"kepler.npz", "kepler.csv", "kepler.png"}
    header, first = (tmp_path / "kepler.csv").read_text().splitlines()[:2]
    assert header == "t,u0,u1,v0,v1"
    assert first.count(",") == 4
    assert main(["run", "quarter_car", "--t-end", "0.1", "--out", str(tmp_path)]) == 0
    assert (tmp_path / "quarter_car.csv").read_text().startswith("t,x0,x1,v_x0,v_x1,work\n")  # as in tables of pandas


def test_run_prints_and_writes_all_that_it_can(tmp_path, capsys):
    (tmp_path / "hertz_impact.npz").mkdir()
    with pytest.raises(SystemExit, match=r"^eig3 run: cannot write to .*: hertz_impact\.npz \(.+\)\. Choose another"):
        main(["run", "hertz_impact", "--out", str(tmp_path)])
    printed = capsys.readouterr().out
    assert "change of energy: " in printed
    assert printed.endswith(f"Written to {tmp_path}: hertz_impact.csv, hertz_impact.png\n")
    assert {path.suffix for path in tmp_path.iterdir()} == {".npz", ".csv", ".png"}


def test_run_finds_a_step_and_needs_no_energy_or_folder(capsys):
    assert main(["run", "van_der_pol"]) == 0
    printed = capsys.readouterr().out
    assert "energy: this problem defines none" in printed
    assert "Written" not in printed


def test_run_says_where_a_run_fails(capsys):
    assert main(["run", "hardening_spring", "--h", "0.5"]) == 1
    assert "diverged" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "nothing"], "eig3 run: there is no problem nothing: take arenstorf, "),
        (["run", "kepler", "--h", "-1"], "eig3 run: h must be a positive, finite number"),
        (["run", "kepler", "--method", "euler"], "eig3 run: method must be one of"),
    ],
)
def test_run_refuses_what_it_cannot_run(arguments, message):
    with pytest.raises(SystemExit, match=message):
        main(arguments)


OWN_PROBLEMS = """
import eig3

@eig3.jit
def rhs(t, u, v, p):
    return -p.k * u - p.c * v

fixed = eig3.Problem("pendulum", rhs, 1.0, 0.0, {"k": 4.0, "c": 0.1}, (0.0, 2.0))

def heavy(stiffness: "float" = 4.0):
    return fixed.with_(params={"k": stiffness, "c": 0.0})

def plain(stiffness=4, t_end=2.0):
    return heavy(stiffness).with_(t_span=(0.0, t_end))

def broken():
    raise RuntimeError("the table is missing.")

class scene:
    problem = heavy

scene = scene()

number = 3

def nothing():
    return number
"""


@pytest.mark.parametrize("name", ["mine.py:fixed", "mine:fixed", "mine:heavy", "mine.py:plain"])
def test_own_problems_run_in_all_commands(name, tmp_path, monkeypatch, capsys):
    (tmp_path / "mine.py").write_text(OWN_PROBLEMS)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "mine", raising=False)
    assert main(["run", name, "--h", "0.01", "--t-end", "1.5", "--out", "."]) == 0
    assert np.load("pendulum.npz")["t"][-1] == 1.5
    main(["plan", name, "--accuracy", "1e-3", "--method", "rk4"])
    assert "Plan for pendulum" in capsys.readouterr().out
    axis = "k=3:5:4" if name.endswith("fixed") else "stiffness=3:5:4"
    assert main(["sweep", name, "--set", axis, "--measure", "max:u"]) == 0
    assert "4 completed" in capsys.readouterr().out


HARD_PROBLEM = """
import eig3

@eig3.jit
def rhs(t, u, v, z, p, a, dz):
    if t > -3:
        raise IndexError("no value there")
    a[0] = -u[0]
    dz[:] = 1.0

@eig3.jit
def square(t, u, v, z, p):
    return u[0] ** 2

unknowns, outputs = {"u": 7.0, "a, b": 8.0}, {"F, N": square}
problem = eig3.Problem("hard", rhs, [1.0], [0.0], (), (-5.0, -2.0), z0=unknowns, outputs=outputs)
"""


@pytest.mark.parametrize("command", ["run kepler", "sweep kepler --set e=0:0.5:2 --measure max:u0"])
def test_files_are_written_though_the_report_cannot_be_printed(command, tmp_path, monkeypatch):
    class Full(io.StringIO):
        def write(self, text):
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(sys, "stdout", Full())
    with pytest.raises(SystemExit, match="No space left on device"):
        main([*command.split(), "--t-end", "1", "--h", "0.01", "--out", str(tmp_path)])
    assert {path.suffix for path in tmp_path.iterdir()} == {".npz", ".csv", ".png"}


def test_a_problem_with_negative_times_and_an_unknown_named_u(tmp_path, monkeypatch):
    (tmp_path / "hard.py").write_text(HARD_PROBLEM)
    monkeypatch.chdir(tmp_path)
    assert main(["run", "hard.py:problem", "--t-end", "-4", "--out", "."]) == 0
    with np.load("hard.npz") as history:
        assert history["t"][-1] == -4
        assert (history["u"][0], history["z.u"][0]) == (1, 7)
    assert Path("hard.csv").read_text().startswith('t,u0,v0,u,"a, b"\n-5.0')
    sweep = ["sweep", "hard.py:problem", "--t-end", "-4", "--set", "u0[0]=1:2:2", "--out", ".", "--measure"]
    assert main([*sweep, "max:F, N"]) == 0
    assert Path("sweep.csv").read_text() == 'u0[0],"max:F, N",status\n1.0,1.0,completed\n2.0,4.0,completed\n'
    many = HARD_PROBLEM.replace('"u": 7.0, "a, b": 8.0', '"q": [7.0, 7.5], "q0": 8.0, "t": 9.0')
    (tmp_path / "many.py").write_text(many)
    main(["run", "many.py:problem", "--t-end", "-4", "--out", "."])
    assert Path("hard.csv").read_text().startswith("t,u0,v0,q[0],q[1],q0,z.t\n")
    with pytest.raises(SystemExit, match=r"path must end with .extxyz, .xyz, .dump, .dcd, .pvd, .vtkhdf, not 'X.PVD'"):
        main(["run", "spring_pendulum", "--out", "X.PVD"])


@pytest.mark.parametrize("command", ["run", "plan --accuracy 1e-3", "sweep --set u0[0]=1:2:2 --measure max:u0"])
def test_an_error_in_compiled_code_is_a_sentence_with_its_line(command, tmp_path, monkeypatch):
    (tmp_path / "hard.py").write_text(HARD_PROBLEM)
    monkeypatch.chdir(tmp_path)
    name, *options = command.split()
    with pytest.raises(SystemExit, match=rf"^eig3 {name}: IndexError: no value there \(hard.py, line 7\).$"):
        main([name, "hard.py:problem", *options])


def test_a_plan_without_a_method_that_reaches_the_accuracy_fails(capsys):
    assert main(["plan", "single_dof", "--accuracy", "1e-30", "--method", "rk4"]) == 1
    assert "not reached: the accuracy is below round-off" in capsys.readouterr().out


def test_a_page_shows_the_motion(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["show", "spring_pendulum", "--rtol", "1e-6", "--t-end", "2", "--out", "view.html"]) == 0
    assert "Shown in view.html" in capsys.readouterr().out
    assert "spring_pendulum" in Path("view.html").read_text()
    with pytest.raises(SystemExit, match="eig3 show: single_dof has no geometry: set its view"):
        main(["show", "single_dof"])


@pytest.mark.system
def test_a_report_of_an_own_problem(tmp_path, monkeypatch, capsys):
    (tmp_path / "mine.py").write_text(OWN_PROBLEMS)
    monkeypatch.chdir(tmp_path)
    main(["report", "mine.py:fixed", "--accuracy", "1e-2", "--out", "pages"])
    assert f"Written: {Path('pages', 'report.html')}" in capsys.readouterr().out
    assert "pendulum" in Path("pages", "report.md").read_text()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("mine.py:fixd", "eig3 run mine.py:fixd: the module mine.py has no fixd, but fixed."),
        ("mine:number", "eig3 run mine:number: it must be an eig3.Problem or a function that returns one, not int."),
        ("mine:nothing", "eig3 run: nothing must return an eig3.Problem, not int."),
        ("mine:rhs", "it must be an eig3.Problem or a function that returns one, not a jitted function."),
        ("mine:scene", "a function that returns one, not scene: take what its method problem returns."),
        ("mine:broken", "eig3 run mine:broken: RuntimeError: the table is missing (mine.py, line 17)."),
        (":x", "eig3 run :x: the module  cannot be imported (ValueError: Empty module name)."),
        ("mine.py", "eig3 run: mine.py is a file: name the problem in it too, as mine.py:NAME."),
        ("yours.py:fixed", "eig3 run yours.py:fixed: there is no file yours.py."),
        ("mime.py:fixed", "eig3 run mime.py:fixed: there is no file mime.py, but mine.py."),
        ("yours:fixed", "eig3 run yours:fixed: there is no module yours here or among the installed ones."),
        ("mime:fixed", "there is no module mime here or among the installed ones, but mine."),
        ("keplr", "eig3 run: there is no problem keplr: take kepler, or your own as MODULE:NAME or FILE.py:NAME."),
    ],
)
def test_own_problems_that_are_not_there_get_the_nearest_names(name, message, tmp_path, monkeypatch):
    (tmp_path / "mine.py").write_text(OWN_PROBLEMS)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "mine", raising=False)
    with pytest.raises(SystemExit, match=re.escape(message)):
        main(["run", name])


def test_a_reader_that_has_read_enough_ends_the_command():
    read, write = os.pipe()
    os.close(read)  # as `head` does after its lines
    command = [sys.executable, "-m", "eig3", "cache", "--path"]
    result = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, text=True, check=True)
    os.close(write)
    assert result.stderr == ""


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_full_disk_has_the_status_of_an_error():
    """Python flushed the output again at exit, and the status was 120."""
    command = [sys.executable, "-m", "eig3", "cache", "--path"]
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    with Path("/dev/full").open("w") as full:
        result = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, env=buffered, check=False)
    assert (result.returncode, result.stderr) == (1, "eig3 cache: [Errno 28] No space left on device\n")


def test_run_with_a_tolerance(tmp_path, capsys):
    """The ball is followed through its impacts, with states at equal distances in time."""
    assert main(["run", "bouncing_ball", "--rtol", "1e-6", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "Solution by RKN12(): completed" in printed
    assert "steps of mean h = " in printed
    with np.load(tmp_path / "bouncing_ball.npz") as history:
        t, u = history["t"], history["u"]
    exact = problems.bouncing_ball().exact(t)[0]
    np.testing.assert_allclose(u, exact, rtol=0, atol=1e-9)  # RKN12 is exact between the impacts
    np.testing.assert_allclose(np.diff(t), t[1], rtol=1e-9)


def test_run_takes_a_step_or_a_tolerance(capsys):
    with pytest.raises(SystemExit):
        main(["run", "duffing", "--rtol", "1e-6", "--h", "0.1"])
    assert "not allowed with argument" in capsys.readouterr().err
    with pytest.raises(ValueError, match="h, rtol and accuracy exclude each other"):
        run(problems.duffing, h=0.1, rtol=1e-6)
    with pytest.raises(
        SystemExit, match="eig3 run: method must be one of 'eig3', 'rk5', 'rk8', 'rkn12' with tolerances"
    ):
        main(["run", "duffing", "--rtol", "1e-6", "--method", "rk4"])
