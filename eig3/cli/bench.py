"""Run a benchmark. `eig3 bench` without a name runs `eig3 bench paper --quick`."""

from __future__ import annotations

import argparse
from importlib import import_module
from typing import Any

from ..bench import BENCHMARKS

SUMMARY = "run a benchmark"


def add_options(parser: argparse.ArgumentParser) -> None:
    modules = {name: import_module(f"eig3.bench.{name}") for name in BENCHMARKS}
    _add(parser, modules["paper"], quick=True)
    benchmarks = parser.add_subparsers(metavar="benchmark")
    for name, module in modules.items():
        _add(benchmarks.add_parser(name, help=module.SUMMARY, description=module.__doc__), module)


def _add(parser: argparse.ArgumentParser, module: Any, **defaults: Any) -> None:
    module.add_options(parser, **defaults)
    names = list(vars(parser.parse_args([])))

    def run(options: argparse.Namespace) -> None:
        module.benchmark(**{name: getattr(options, name) for name in names})

    parser.set_defaults(run=getattr(module, "run", run))
