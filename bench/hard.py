"""Run the hard cases, such as stability limits, chaos, impacts and round-off, and fail if one is not as expected."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence

from eig3.command_line import count

from . import text
from .hard_cases import HARD_CASES

SUMMARY = "hard cases, each compared with its expected result"
HEADER = ["method", "what", "expected", "measured", "verdict"]


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--case", dest="cases", action="append", type=count, metavar="N", help="only this one; may be repeated"
    )


def run(options: argparse.Namespace) -> int:
    """Exit status 1 means that a finding is not as expected."""
    unknown = set(options.cases or ()) - set(HARD_CASES)
    if unknown:
        raise SystemExit(f"eig3 bench hard: --case must be 1 to {len(HARD_CASES)}, not {min(unknown)}.")
    return min(1, benchmark(only=options.cases))


def benchmark(*, only: Sequence[int] | None = None, write: Callable[[str], None] = print) -> int:
    """Print every finding; return how many are not as expected."""
    failures = 0
    for number in only or HARD_CASES:
        case, rows = HARD_CASES[number], []
        for method in case.methods:
            text.status(f"{number}. {case.title}, {method}")
            for finding in case.findings(method):
                failures += not finding.passed
                verdict = "as expected" if finding.passed else "NOT AS EXPECTED"
                rows.append([method, finding.what, finding.expected, finding.measured, verdict])
        text.status("")
        write(f"{number}. {case.title}\n\n{text.table(HEADER, rows)}\n")
    write(f"{failures} findings are not as expected." if failures else "Everything is as expected.")
    return failures
