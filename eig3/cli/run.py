"""Integrate a problem of eig3.problems. Print its energy balance and cost; write its history, a picture, a film."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..command_line import add_out, file, folder
from .problem import add_method_and_end, add_problem, add_steps, integrate

SUMMARY = "integrate a problem; report its energy balance, write its history and a picture"


def add_options(parser: argparse.ArgumentParser) -> None:
    add_problem(parser)
    add_steps(parser)
    add_method_and_end(parser, "eig3, or with --rtol rkn12, rk8 or rk5")
    parser.add_argument("--check", action="store_true", help="estimate the error of u from runs with other steps")
    text = "folder for NAME.npz, NAME.png and, if the history is short, NAME.csv; or a file for OVITO, VMD or ParaView,"
    add_out(parser, f"{text} .extxyz, .xyz, .dump, .dcd, .pvd or .vtkhdf", type=_folder_or_file)
    parser.add_argument("--animate", action="store_true", help="also write an animation, NAME.gif, to DIR or here")
    parser.add_argument("--format", choices=("gif", "mp4", "html"), help="the format of the animation (default: gif)")
    parser.add_argument(
        "--show",
        nargs="?",
        const="",
        type=file,
        metavar="PATH",
        help="show the motion in three dimensions, on a page that one can "
        "turn: in the browser, or written to PATH, such as view.html",
    )
    parser.set_defaults(run=run)


def _folder_or_file(text: str) -> Path:
    return Path(file(text)) if _is_file(Path(text)) else folder(text)


def _is_file(path: Path) -> bool:
    from ..files.export import FORMATS

    return path.suffix.lower() in (*FORMATS, ".xdmf") and not path.is_dir()


def run(options: argparse.Namespace) -> int:
    """Return the exit status: 1 if the run failed, for example if it diverged."""
    if options.format and not options.animate:
        raise SystemExit("eig3 run: --format is the format of an animation: give --animate too.")
    film = (options.format or "gif") if options.animate else None
    out = {} if options.out is None else {"export" if _is_file(options.out) else "out": options.out}
    return integrate(options, "eig3 run", animate=film, show=options.show, check=options.check, **out)
