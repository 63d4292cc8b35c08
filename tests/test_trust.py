"""`eig3 bench trust`: its runs, its table, its picture, and what it says about estimates."""

import numpy as np
import pytest

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


def test_the_command_writes_a_page_and_a_picture(tmp_path, capsys):
    assert main(["bench", "trust", "--problem", "softening_spring", "--repeats", "1", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert (tmp_path / trust.PICTURE).read_text().count("true error") >= 2
    assert (tmp_path / "trust.md").read_text().splitlines()[0] == "# Can the error be trusted?"
    assert "| softening_spring |" in printed


def test_estimates_of_a_smooth_problem_are_true():
    """Within a factor of 2 in 99 of 100 runs without a note."""
    found = trust.benchmark(only=["softening_spring"], repeats=1, write=lambda _: None)
    plain = [x.ratio for x in found if not x.is_noted]
    assert len(plain) > 30
    assert sum(1 / trust.TWICE <= ratio <= trust.TWICE for ratio in plain) >= 0.99 * len(plain)


def test_chaos_says_from_when_on_no_digit_is_right():
    """The double pendulum of 60 s: an estimate far below the true error has a note."""
    found = trust.benchmark(only=["double pendulum, 60 s"], write=lambda _: None)
    low = [x for x in found if x.ratio < trust.TENTH and not x.is_noted]
    assert not low
    assert np.median([x.ratio for x in found]) == pytest.approx(1.0, abs=0.2)
