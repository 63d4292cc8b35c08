"""`eig3 bench c`: the C code computes what the kernels compute, and the table is complete."""

import tempfile

import numpy as np
import pytest

from eig3.bench import c, loops
from eig3.bench.timing import Storage
from eig3.cli import main

pytestmark = pytest.mark.system

needs_compiler = pytest.mark.skipif(not c.has_compiler(), reason="no C compiler here: the table says so")


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    return c.build(c.FLAGS["-O3"], tmp_path_factory.mktemp("c"))


@needs_compiler
@pytest.mark.parametrize("inline", [False, True])
@pytest.mark.parametrize("method", c.METHODS_IN_C)
@pytest.mark.parametrize(("make", "h"), loops.ARTICLE_PROBLEMS)
def test_c_computes_what_the_kernels_do(library, make, h, method, inline, monkeypatch):
    monkeypatch.setattr(loops, "N_STEPS", 2000)
    problem = make()
    storage = Storage.for_steps(problem, 2000)
    loops.kernel_loop(problem, h, method, storage, inline=False)()
    ours = storage.u.copy()
    assert library.loop(problem, h, method, storage, inline=inline)() > 0
    difference = np.abs(storage.u - ours).max()
    # the same formulas in another order of operations; AB3 in C starts with a constant past: an error of h^2 a
    assert difference < (0.05 if method == "ab3" else 1e-8)


def test_a_method_that_is_not_in_c_is_refused():
    with pytest.raises(SystemExit, match="--method must be one of eig3, cd, rk2, rk3, ab2, ab3, not rk4"):
        main(["bench", "c", "--method", "rk4"])


@needs_compiler
def test_table_has_every_ratio(capsys, monkeypatch):
    monkeypatch.setattr(loops, "N_STEPS", 1000)
    monkeypatch.setattr(loops, "ARTICLE_PROBLEMS", loops.ARTICLE_PROBLEMS[::3])  # one number, and a pair of numbers
    assert main(["bench", "c", "--method", "eig3", "--repeats", "1"]) == 0
    rows = [line for line in capsys.readouterr().out.splitlines() if "EIG-3" in line]
    assert len(rows) == 2
    assert all(" - " not in row for row in rows)


def test_without_a_compiler_the_table_says_so(capsys, monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler -O1")
    monkeypatch.setattr(loops, "N_STEPS", 1000)
    monkeypatch.setattr(loops, "ARTICLE_PROBLEMS", loops.ARTICLE_PROBLEMS[:1])
    assert main(["bench", "c", "--method", "eig3", "--repeats", "1"]) == 0
    printed = capsys.readouterr().out
    assert "no compiler (no-such-compiler) here" in printed
    assert "name one with CC=..." in printed
    assert printed.count(" - ") == 6


def program(path, text):
    """An executable file with this text; return its path."""
    path.write_text(text)
    path.chmod(0o755)
    return str(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("#!/bin/sh\necho 'baseline.c:1: no space' >&2\nexit 1\n", "baseline.c:1: no space"),
        ("#!/bin/sh\nexit 1\n", "It printed no message."),
        ("\x7fELF, but not a program", "Exec format error"),
    ],
)
def test_a_compiler_that_fails_is_shown_with_its_command_and_message(text, message, tmp_path, monkeypatch):
    monkeypatch.setenv("CC", program(tmp_path / "broken_cc", text))
    with pytest.raises(SystemExit, match=r"^eig3 bench c: the C compiler failed\. .* CC=\.\.\. .* TMPDIR=") as caught:
        main(["bench", "c"])
    _, command, *printed = caught.value.code.splitlines()
    assert command.startswith(f"{tmp_path}/broken_cc -std=c99 -O3 ")
    assert message in "\n".join(printed)


def test_a_temporary_folder_that_cannot_hold_the_c_code_is_named(monkeypatch):
    monkeypatch.setenv("CC", "true")
    monkeypatch.setattr(tempfile, "tempdir", "/dev/null")
    with pytest.raises(SystemExit, match=r"^eig3 bench c: the temporary folder .*/dev/null.* TMPDIR=\.\.\.$"):
        main(["bench", "c"])


def test_compiled_code_that_cannot_be_loaded_is_named_with_the_systems_reason(monkeypatch):
    monkeypatch.setenv("CC", "true")  # succeeds without a file, so that the system refuses to load it
    with pytest.raises(SystemExit, match=r"^eig3 bench c: the temporary folder .*baseline0\.so.* TMPDIR=\.\.\.$"):
        main(["bench", "c"])


def test_a_report_does_not_begin_with_a_compiler_that_fails(tmp_path, monkeypatch):
    monkeypatch.setenv("CC", "false")
    with pytest.raises(SystemExit, match="the C compiler failed"):
        main(["bench", "report", "--out", str(tmp_path)])
    assert not list(tmp_path.iterdir())
