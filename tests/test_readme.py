"""The README's blocks run: Python as written with the output it shows, and the first two commands as CI runs them."""

import contextlib
import io

import numpy as np
import pytest

import eig3
from eig3.cli import main
from eig3.stability import limit

from .conftest import BLOCKS, PYTHON, ROOT

COMMANDS = [code for language, code in BLOCKS if language == "sh"]
OUTPUT = [text for language, text in BLOCKS if language == "text"]


def test_examples_print_what_they_show():
    examples, method = PYTHON[:-1], PYTHON[-1]
    assert len(examples) == len(OUTPUT) == 11
    assert "SymplecticEuler" in method
    namespace = {}
    for code, expected in zip(examples, OUTPUT, strict=True):
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(code, "README.md", "exec"), namespace)
        assert printed.getvalue() == expected


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


@pytest.mark.parametrize("command", COMMANDS[2].splitlines())
def test_the_scenes_of_the_readme_run(command, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    program, *arguments = command.split()
    assert program == ".venv/bin/eig3"
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    name = arguments[1]
    for expected in (f"{name}: ", "steps of h = ", "ns a step", "energy: ", "work done: ", f"{name}.png"):
        assert expected in printed
    history = np.load(tmp_path / "out" / f"{name}.npz")
    assert history["u"].shape == history["v"].shape
    assert len(history["t"]) == len(history["u"])
    assert (tmp_path / "out" / f"{name}.csv").exists() == (name != "curtain")
    assert (tmp_path / "out" / f"{name}.png").read_bytes().startswith(b"\x89PNG")


def test_commands_are_those_ci_runs():
    assert len(COMMANDS) == 4
    assert COMMANDS[0].endswith("eig3 bench\n")
    assert COMMANDS[1].endswith("pytest -q\n")
    assert all(line.startswith(".venv/bin/pytest bench --benchmark-only ") for line in COMMANDS[3].splitlines())
    assert {language for language, _ in BLOCKS} == {"sh", "python", "text"}
    runner = (ROOT / ".ci" / "run").read_text()
    assert "readme_command 1" in runner
    assert "readme_command 2" in runner
