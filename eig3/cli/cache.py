"""Show or clear the folder in which eig3 keeps compiled code for later processes."""

from __future__ import annotations

import argparse

SUMMARY = "show or clear the folder of compiled code"


def add_options(parser: argparse.ArgumentParser) -> None:
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--path", action="store_true", help="print the folder")
    what.add_argument("--clear", action="store_true", help="delete the compiled code in this folder")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    from ..kernels.compile.cache import clear, folder

    try:
        path = folder()
        print(f"{path}: {clear(path)} files deleted" if options.clear else path)
    except (RuntimeError, OSError) as error:
        raise SystemExit(f"eig3 cache: {error}") from error
