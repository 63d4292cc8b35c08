"""Command-line options that several commands and benchmarks share."""

from __future__ import annotations

import argparse
from pathlib import Path


def count(text: str) -> int:
    """Convert the text of an option to a whole number of at least 1."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number of at least 1, not {text!r}")
    return int(text)


def folder(text: str) -> Path:
    """Convert the text of an option to a folder, and create it: an error is then raised before the command runs."""
    path = Path(text)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise argparse.ArgumentTypeError(f"cannot create the folder {text!r}: {error.strerror}") from None
    return path


def add_out(parser: argparse.ArgumentParser, text: str, *, required: bool = False) -> None:
    """Add the option `--out DIR`, the folder for results; `text` is its help."""
    parser.add_argument("--out", type=folder, metavar="DIR", required=required, help=text)


def add_methods(parser: argparse.ArgumentParser) -> None:
    """Add the option `--method NAME`. It may be repeated; `options.methods` is then the list of names, or None."""
    parser.add_argument(
        "--method", dest="methods", action="append", metavar="NAME", help="only this method; may be repeated"
    )
