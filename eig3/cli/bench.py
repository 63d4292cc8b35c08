"""Run a benchmark. `eig3 bench` without a name runs `eig3 bench paper --quick`."""

from __future__ import annotations

import argparse
from importlib import import_module

from ..bench import BENCHMARKS

SUMMARY = "run a benchmark"


def add_options(parser: argparse.ArgumentParser) -> None:
    modules = {name: import_module(f"eig3.bench.{name}") for name in BENCHMARKS}
    modules["paper"].add_options(parser, quick=True)
    parser.set_defaults(run=modules["paper"].run)
    benchmarks = parser.add_subparsers(metavar="benchmark")
    for name, module in modules.items():
        benchmark = benchmarks.add_parser(name, help=module.SUMMARY, description=module.__doc__)
        module.add_options(benchmark)
        benchmark.set_defaults(run=module.run)
