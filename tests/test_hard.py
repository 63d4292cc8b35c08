"""The hard cases: every finding of `eig3 bench hard` is as expected, and it fails where one is not."""

import pytest

from eig3 import cli
from eig3.bench import hard
from eig3.bench.hard import CASES, Finding, at_most, near, within


@pytest.mark.parametrize(
    ("number", "method"), [(number, method) for number, case in CASES.items() for method in case.methods]
)
def test_case(number, method):
    """Expectations, tolerances and their reasons are in bench/hard.py."""
    findings = CASES[number].findings(method)
    assert findings
    for finding in findings:
        assert finding.passed, finding


def test_every_row_is_there():
    assert list(CASES) == list(range(1, 17))


def test_the_command_prints_and_succeeds(capsys):
    assert cli.main(["bench", "hard", "--case", "2"]) == 0
    printed = capsys.readouterr().out
    assert printed.count("as expected |") == sum(len(CASES[2].findings(method)) for method in CASES[2].methods)
    assert "Everything is as expected." in printed


def test_a_finding_that_is_not_as_expected_fails_the_command(capsys, monkeypatch):
    wrong = hard.Case("made to fail", ("eig3",), lambda method: iter([near("one", 2.0, 1.0, rel=0.1)]))
    monkeypatch.setitem(CASES, 2, wrong)
    assert cli.main(["bench", "hard", "--case", "2"]) == 1
    printed = capsys.readouterr().out
    assert "NOT AS EXPECTED" in printed
    assert "1 findings are not as expected." in printed


def test_unknown_case_is_told():
    with pytest.raises(SystemExit, match="--case must be 1 to 16, not 99"):
        cli.main(["bench", "hard", "--case", "99"])


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), 1.3])
def test_what_is_not_near_is_not_passed(bad):
    for finding in (near("x", 1.0, bad, rel=0.2), within("x", 1.0, bad, 1.2), at_most("x", 1.0, bad)):
        assert isinstance(finding, Finding)
        assert not finding.passed
