"""The page of a view: one HTML file with its data and scripts, which needs no network."""

from __future__ import annotations

import base64
import hashlib
import html
import json
import sys
import tempfile
import webbrowser
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from string import Template
from typing import Any

from ..animation import geometry
from ..animation.animate import captions
from ..animation.film import Film
from ..animation.look import Look
from ..drawing import before_growth
from ..files.table import text_file
from ..result.solution import Solution
from .frames import content, frames_of

_HERE = Path(__file__).parent
_HEIGHT = 560  # pixels, in a notebook


@dataclass(frozen=True, eq=False)
class Page:
    """A page with a view of a run. A notebook shows it below the cell.

    Attributes
    ----------
    html : str
        The content of the page.
    path : Path or None
        The file of the page, if there is one.
    """

    html: str
    path: Path | None = None

    def __repr__(self) -> str:
        return f"Page(path={str(self.path)!r})" if self.path else f"Page of {len(self.html) / 1e6:.1f} MB"

    def _repr_html_(self) -> str:
        style = f"width: 100%; height: {_HEIGHT}px; border: 0; border-radius: 8px"
        allowed = 'sandbox="allow-scripts allow-downloads" allow="fullscreen"'
        return f'<iframe srcdoc="{html.escape(self.html)}" {allowed} style="{style}" title="view of a run"></iframe>'


def show(
    view: Any,
    solution: Solution,
    path: str | PathLike[str] | None = None,
    *,
    name: str,
    look: Mapping[str, Any] | None = None,
    has_seconds: bool = True,
    t_end: float | None = None,
) -> Page:
    """Write a page with a view of a run, as `Problem.show` describes it, with `name` as its title.

    `look` has the limits, the camera and the color at the start; None for what is not chosen. The time is in seconds,
    or without `has_seconds` has no unit. `t_end` is the end of the run, if `solution` is only its beginning.
    """
    target = check_page(path)
    mechanism = geometry(view, name)
    chosen = Look.of(mechanism, solution, **(look or {}))
    film = Film.of(before_growth(solution), has_seconds=has_seconds)
    frames = frames_of(mechanism, film)
    lines = captions(film, solution, solution.t[-1] if t_end is None else t_end)
    page = _filled(name, *content(frames, chosen.colors(frames), lines, chosen))
    if target is None and _in_notebook():
        return Page(page)
    if target is None:
        target = Path(tempfile.mkdtemp(prefix="eig3-")) / "view.html"
    with text_file(target) as file:
        file.write(page)
    if path is None and not webbrowser.open(target.resolve().as_uri()):
        raise RuntimeError("path must be given, such as 'view.html', because no browser could be opened here.")
    return Page(page, target)


def check_page(path: str | PathLike[str] | None) -> Path | None:
    """Return the path of a page, or raise an error that says what is wrong with it."""
    if path is None:
        return None
    path = Path(path)
    if path.suffix.lower() not in (".html", ".htm"):
        raise ValueError(f"path must end with .html, not {path.name!r}.")
    if not path.parent.is_dir():
        raise FileNotFoundError(f"path must be in an existing folder: create {str(path.parent)!r} first.")
    return path


def _in_notebook() -> bool:
    """Return whether a notebook runs this code, which then shows the returned page."""
    return "ipykernel" in sys.modules


def _filled(name: str, data: Mapping[str, Any], blocks: Mapping[str, str]) -> str:
    """Return the page with its title, data and scripts."""
    scripts = [_in_script((_HERE / file).read_text("utf-8")) for file in ("three.min.js", "page.js")]
    return Template((_HERE / "page.html").read_text("utf-8")).substitute(
        title=html.escape(name),
        policy=_policy(scripts),
        css=(_HERE / "page.css").read_text("utf-8"),
        library=scripts[0],
        script=scripts[1],
        data=json.dumps({"name": name, **data}, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c"),
        blocks="\n".join(f'<script type="text/plain" id="{key}">{text}</script>' for key, text in blocks.items()),
    )


def _in_script(code: str) -> str:
    """Return code that does not end its element."""
    return code.replace("</script", "<\\/script").replace("<!--", "<\\!--")


def _policy(scripts: Sequence[str]) -> str:
    """Return the Content-Security-Policy of the page: its own scripts run and no others, and it loads nothing."""
    digests = (hashlib.sha256(script.encode()).digest() for script in scripts)
    own = " ".join(f"'sha256-{base64.b64encode(digest).decode()}'" for digest in digests)
    return f"default-src 'none'; script-src {own}; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"
