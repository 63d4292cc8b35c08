"""Options of the command line that several commands and benchmarks share."""

from __future__ import annotations

import argparse
from pathlib import Path


def count(text: str) -> int:
    """Read a whole number of at least 1."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number of at least 1, not {text!r}")
    return int(text)


def folder(text: str) -> Path:
    """Create the folder now, so that a path that cannot be written fails before minutes of measuring."""
    path = Path(text)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise argparse.ArgumentTypeError(f"cannot be made: {error.strerror}: {text!r}") from None
    return path


def add_out(parser: argparse.ArgumentParser, text: str, *, required: bool = False) -> None:
    """Add `--out DIR`, the folder for results."""
    parser.add_argument("--out", type=folder, metavar="DIR", required=required, help=text)


def add_methods(parser: argparse.ArgumentParser) -> None:
    """Add `--method NAME`, which may be repeated, as `options.methods`."""
    parser.add_argument(
        "--method", dest="methods", action="append", metavar="NAME", help="only this method; may be repeated"
    )
