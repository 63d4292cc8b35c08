"""Options that several benchmarks share, and the check of the names given to them."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from eig3.command_line import count

#: The methods that the article compares.
ARTICLE_METHODS = ("eig3", "cd", "rk2", "rk3", "rk4", "ab2", "ab3")


def add_problems(parser: argparse.ArgumentParser) -> None:
    """Add `--problem NAME`, which may be repeated, as `only`."""
    parser.add_argument(
        "--problem", dest="only", action="append", metavar="NAME", help="only this one; may be repeated"
    )


def add_repeats(parser: argparse.ArgumentParser, default: int) -> None:
    """Add `--repeats N`, the number of runs from which a median is taken."""
    parser.add_argument("--repeats", type=count, default=default, help=f"runs for each median ({default})")


def add_longest(parser: argparse.ArgumentParser, default: float, of: str = "") -> None:
    """Add `--longest S`, the time of a run after which steps are halved no more."""
    text = f"halve the steps{of} until a run takes this time ({default})"
    parser.add_argument("--longest", type=float, default=default, metavar="S", help=text)


def add_accuracies(parser: argparse.ArgumentParser, default: str) -> None:
    """Add `--accuracies A ...`, the errors to reach; `default` describes those that are used without it."""
    parser.add_argument(
        "--accuracies", nargs="+", type=accuracy, metavar="A", help=f"the errors to reach (default: {default})"
    )


def accuracy(text: str) -> float:
    """Convert the text of an option to a relative error."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < 1:
        raise argparse.ArgumentTypeError(f"must be a number between 0 and 1, such as 1e-4, not {text!r}")
    return value


def choose(names: Sequence[str] | None, known: Sequence[str], option: str = "--method") -> Sequence[str]:
    """The names given on the command line, or all known names if None.

    Raises
    ------
    SystemExit
        If a name is not known.
    """
    unknown = [name for name in names or () if name not in known]
    if unknown:
        raise SystemExit(f"eig3 bench: {option} must be one of {', '.join(known)}, not {unknown[0]}.")
    return names or known
