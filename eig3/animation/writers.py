"""Write the frames of a film into a file: GIF, MP4 or a page of HTML.

The files of matplotlib's writers are larger, a GIF seven times, and their errors omit the message of ffmpeg.
"""

from __future__ import annotations

import base64
import html
import io
import json
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

#: A function that returns frame i as a Pillow image.
Frame = Callable[[int], Any]

COLORS, MANY_COLORS = 31, 127  # in a palette, without and with many coloured parts; one more marks unchanged pixels
_PAPER = 248  # a palette colour with all components above this is white
_NO_FFMPEG = "mp4 needs ffmpeg, which was not found: pip install imageio-ffmpeg, or choose gif or html."


def write_film(path: Path, frame: Frame, count: int, rate: float, colors: int = COLORS) -> None:
    """Write a film in the format of its suffix, with so many colours if it has a palette.

    An existing film is replaced when the new film is complete.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    kind = kind_of(path)
    images = map(frame, range(count)) if kind == "mp4" else palette_frames(frame, count, colors)
    with tempfile.TemporaryDirectory(dir=path.parent, prefix="unfinished-") as folder:
        unfinished = Path(folder, path.name)
        WRITERS[kind](unfinished, images, rate)
        unfinished.replace(path)


def kind_of(path: Path) -> str:
    """Return the format of the suffix of a file."""
    return path.suffix[1:].lower()


def write_gif(path: Path, images: Iterator[Any], rate: float) -> None:
    """Write a GIF with one palette for all frames; each frame stores only the changed pixels."""
    first, *others = images
    whole = io.BytesIO()
    options = {"duration": round(1000 / rate), "loop": 0, "optimize": True, "disposal": 1}
    first.save(whole, "GIF", save_all=True, append_images=others, **options)
    path.write_bytes(whole.getvalue())


def write_mp4(path: Path, images: Iterator[Any], rate: float) -> None:
    """Send the frames to ffmpeg, one by one.

    Raises
    ------
    ImportError
        If there is no ffmpeg.
    OSError
        If ffmpeg cannot write the file.
    """
    program = ffmpeg()
    first = next(images)
    width, height = first.size
    source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{rate}", "-i", "-"]
    target = ["-an", "-pix_fmt", "yuv420p", "-movflags", "+faststart", f"file:{path}"]  # a name may contain a colon
    command = [program, "-y", "-loglevel", "error", *source, *target]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        try:
            assert process.stdin is not None
            for image in chain([first], images):
                process.stdin.write(image.tobytes())
        except BrokenPipeError:  # the message of ffmpeg is raised below
            pass
        except BaseException:
            process.kill()
            raise
        finally:
            message = process.communicate()[1]
    if process.returncode:
        raise OSError(f"ffmpeg could not write {path.name}: {message.decode(errors='replace').strip()}")


def ffmpeg() -> str:
    """Return the path of ffmpeg, either installed or from the package imageio-ffmpeg."""
    found = shutil.which("ffmpeg")
    if found:
        return found
    try:
        import imageio_ffmpeg
    except ImportError:
        raise ImportError(_NO_FFMPEG) from None
    return imageio_ffmpeg.get_ffmpeg_exe()


def write_html(path: Path, images: Iterator[Any], rate: float) -> None:
    """Write a self-contained HTML page with the frames, a button and a slider."""
    texts = []
    for image in images:
        png = io.BytesIO()
        image.save(png, "PNG", optimize=True)
        texts.append(base64.b64encode(png.getvalue()).decode())
    title = html.escape(path.stem)
    page = _PAGE.substitute(title=title, rate=f"{rate:g}", last=len(texts) - 1, frames=json.dumps(texts))
    path.write_text(page, encoding="utf-8")


def palette_frames(frame: Frame, count: int, colors: int) -> Iterator[Any]:
    """Yield the frames, all with a palette of so many colours from a few of them."""
    from PIL import Image

    some = [frame(i) for i in sorted({0, count // 3, 2 * count // 3, count - 1})]
    width, height = some[0].size
    strip = Image.new("RGB", (width, height * len(some)))
    for k, image in enumerate(some):
        strip.paste(image, (0, k * height))
    palette = strip.quantize(colors, method=Image.Quantize.MEDIANCUT, kmeans=1)
    found = np.reshape(palette.getpalette(), (-1, 3))
    found[(found >= _PAPER).all(axis=1)] = 255
    palette.putpalette(found.ravel().tolist())
    for i in range(count):
        yield frame(i).quantize(palette=palette, dither=Image.Dither.NONE)


def check_writer(kind: str) -> None:
    """Raise an ImportError if a film in the format `kind` needs a package or program that is not installed."""
    if not all(find_spec(name) for name in ("matplotlib", "PIL")):
        raise ImportError("an animation needs matplotlib: pip install 'eig3[plot]'.")
    if kind == "mp4":
        ffmpeg()


WRITERS = {"gif": write_gif, "mp4": write_mp4, "html": write_html}

_PAGE = Template("""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>$title</title>
<style>
body { font: 1rem sans-serif; margin: 1rem auto; max-width: 45rem; padding: 0 .5rem }
img { display: block; width: 100%; image-rendering: auto }
div { display: flex; gap: .5rem } button { min-width: 4.5rem } input { flex: 1 }
</style></head><body>
<img alt="$title"><div><button>Pause</button><input type="range" min="0" max="$last" value="0" aria-label="frame"></div>
<script>
const frames = $frames;
const [image, button, slider] = ["img", "button", "input"].map(name => document.querySelector(name));
let playing = true;
function show(i) { slider.value = i; image.src = "data:image/png;base64," + frames[i]; }
function play(yes) { playing = yes; button.textContent = yes ? "Pause" : "Play"; }
button.onclick = () => play(!playing);
slider.oninput = () => { play(false); show(slider.valueAsNumber); };
setInterval(() => { if (playing) show((slider.valueAsNumber + 1) % frames.length); }, 1000 / $rate);
show(0);
</script></body></html>
""")
