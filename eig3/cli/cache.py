"""Show or clear the folders in which eig3 keeps compiled kernels and problems for later processes."""

from __future__ import annotations

import argparse

SUMMARY = "show or clear the folders of compiled code"


def add_options(parser: argparse.ArgumentParser) -> None:
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--path", action="store_true", help="print the folders")
    what.add_argument("--clear", action="store_true", help="delete the compiled code in these folders")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    from .. import critical_step, problems, scene, stability
    from ..kernels.compile.cache import clear, folder_of
    from ..kernels.loops.fixed import fixed

    failures = []
    for function in (fixed, problems.duffing, stability.limit, scene.Scene.add, critical_step):  # one in each folder
        try:
            folder = folder_of(function)
            done = f": {clear(folder)} files deleted" if options.clear else ""
        except (RuntimeError, OSError) as error:
            failures.append(str(error))
        else:
            print(f"{folder}{done}")
    if failures:
        raise SystemExit(f"eig3 cache: {'; '.join(failures)}")
