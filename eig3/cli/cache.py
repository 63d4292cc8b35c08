"""Show, fill or clear the folder in which eig3 keeps compiled code for later processes."""

from __future__ import annotations

import argparse
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from importlib.util import find_spec
from multiprocessing import get_context

SUMMARY = "show, fill or clear the folder of compiled code"


def add_options(parser: argparse.ArgumentParser) -> None:
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--path", action="store_true", help="print the folder")
    what.add_argument("--clear", action="store_true", help="delete the compiled code in this folder")
    what.add_argument(
        "--fill",
        nargs="*",
        metavar="USE",
        help="compile the code of the main uses, on all cores, such as eig3, rk8-tolerances, ensembles or grains",
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    from ..kernels.compile.cache import clear, folder

    try:
        path = folder()
        if options.fill is not None:
            _fill(options.fill)
        done = f": {clear(path)} files deleted" if options.clear else ""
    except OSError as error:
        raise SystemExit(f"eig3 cache: {error}") from error
    print(f"{path}{done}")


def _fill(wanted: list[str]) -> None:
    """Compile the code of some uses, or of all uses, each in a separate process."""
    from ..run.progress import Progress
    from ..stepping.threads import cores
    from .first_uses import USES, compile_use

    unknown = [name for name in wanted if name not in USES]
    if unknown:
        raise SystemExit(f"eig3 cache: there is no use {unknown[0]}; the uses are {', '.join(USES)}.")
    total, seconds, begin = 0, 0.0, time.perf_counter()
    is_shown = sys.stderr.isatty() and find_spec("tqdm") is not None
    with ProcessPoolExecutor(cores(), get_context("spawn")) as pool:
        names = {pool.submit(compile_use, name): name for name in wanted or USES}
        with Progress(len(names), "use", shown=is_shown) as bar:
            for k, done in enumerate(as_completed(names), 1):
                count, spent = done.result()
                total, seconds = total + count, seconds + spent
                bar.add(1)
                if not is_shown:
                    print(f"{k:2d} of {len(names)}: {names[done]}, {count} functions in {spent:.1f} s", flush=True)
    passed = time.perf_counter() - begin
    print(f"{total} functions compiled in {passed:.0f} s ({seconds:.1f} s of CPU time). They are in")
