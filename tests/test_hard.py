"""The hard cases: every finding of `eig3 bench hard` is as expected, and the command fails if one is not."""

import pytest

from eig3.bench.hard_cases import HARD_CASES, Finding, HardCase, at_most, near, within
from eig3.cli import main

pytestmark = pytest.mark.system

#: Left out: their kernels take seconds to compile. One text makes all grades, and test_family.py tests the coefficients
#: of every grade exactly.
ELSEWHERE = {(k, f"eig{grade}") for k in HARD_CASES for grade in (4, 6, 7, 8, 10, 11, 12)}
ELSEWHERE |= {(21, "eig5"), (21, "eig9")}


@pytest.mark.parametrize(
    ("number", "method"),
    [(k, method) for k, case in HARD_CASES.items() for method in case.methods if (k, method) not in ELSEWHERE],
)
def test_case(number, method):
    """Expectations, tolerances and their reasons are in bench/hard_cases.py."""
    findings = HARD_CASES[number].findings(method)
    assert findings
    for finding in findings:
        assert finding.passed, finding


def test_every_case_is_there():
    assert list(HARD_CASES) == list(range(1, 27))


def test_the_command_prints_and_succeeds(capsys):
    assert main(["bench", "hard", "--case", "2"]) == 0
    printed = capsys.readouterr().out
    assert printed.count("as expected |") == sum(
        len(HARD_CASES[2].findings(method)) for method in HARD_CASES[2].methods
    )
    assert "Everything is as expected." in printed


def test_a_finding_that_is_not_as_expected_fails_the_command(capsys, monkeypatch):
    wrong = HardCase("made to fail", ("eig3",), lambda method: iter([near("one", 2.0, 1.0, rel=0.1)]))
    monkeypatch.setitem(HARD_CASES, 2, wrong)
    assert main(["bench", "hard", "--case", "2"]) == 1
    printed = capsys.readouterr().out
    assert "NOT AS EXPECTED" in printed
    assert "1 findings are not as expected." in printed


def test_unknown_case_is_refused():
    with pytest.raises(SystemExit, match="--case must be 1 to 26, not 99"):
        main(["bench", "hard", "--case", "99"])


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), 1.3])
def test_what_is_not_near_is_not_passed(bad):
    for finding in (near("x", 1.0, bad, rel=0.2), within("x", 1.0, bad, 1.2), at_most("x", 1.0, bad)):
        assert isinstance(finding, Finding)
        assert not finding.passed
