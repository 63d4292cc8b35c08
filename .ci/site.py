"""What `mkdocs build` adds to the pages: the reference of all public names, and the gallery of the problems."""

import importlib
import inspect
import os
import re
import types
from pathlib import Path

import griffe
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from mkdocs.structure.files import File

from eig3 import problems, run_report
from eig3.animation import Film

MODULES = ("eig3", "scene", "effects", "structures", "problems", "animation", "stability", "math")
#: Arguments of problems that take long, or of whose motion a long run keeps too few states for a picture.
SMALLER = {"hopper": {"n": 2000}, "sand_column": {"n": 2000}, "two_frequency_oscillator": {"t_end": 5.0}}
#: The problems that are drawn. CI draws two, which stand for all: the runs and the compilation of all take 80 s.
DRAWN = os.environ.get("EIG3_GALLERY", " ".join(problems.__all__)).split()
SHOWN = 0.6  # the part of a film before the frame that is the picture

GALLERY = """---
hide: [navigation, toc]
---

# Gallery

Each picture is a moment of a run with the step that the problem suggests. `eig3 run NAME --animate` draws the whole
motion. `hopper` and `sand_column` have fewer bodies here than by default.

<div class="grid cards" markdown>

{cards}

</div>
"""
CARD = "-   ![{name}](gallery/{name}.webp)\n\n    [`{name}`](reference/problems.md#{path})\n\n    {what}"


#: Where each public name is documented, by its name with and without its module.
HOMES = {}


def on_files(files, config):
    """Add the pages and the pictures. A picture that is there from an earlier build is not drawn again."""
    folder = Path(config.site_dir).parent / "gallery"
    folder.mkdir(parents=True, exist_ok=True)
    places = (config.docs_dir, config.site_dir, config.use_directory_urls)
    files.append(File("CITATION.cff", *places))  # the plugin same-dir leaves it out
    cards = []
    for name in problems.__all__:
        drawn, build = name if name in DRAWN else DRAWN[0], getattr(problems, name)
        picture = folder / f"{drawn}.webp"
        if not picture.exists():
            draw(getattr(problems, drawn)(**SMALLER.get(drawn, {})), picture)
        files.append(File.generated(config, f"gallery/{name}.webp", abs_src_path=str(picture)))
        cards.append(CARD.format(name=name, path=path_of(build), what=inspect.getdoc(build).split("\n\n")[0]))
    files.append(File.generated(config, "gallery.md", content=GALLERY.format(cards="\n\n".join(cards))))
    for name in MODULES:
        files.append(File.generated(config, f"reference/{name}.md", content=reference(name)))
    return files


def on_page_markdown(markdown, page, **_):
    """Link each name of a class, and each name that begins with eig3, to its documentation."""
    parts = markdown.split("```")
    parts[::2] = [re.sub(r"(?<!\[)`([\w.]+)`", linked, part) for part in parts[::2]]  # the others are blocks of code
    return "```".join(parts)


def linked(code):
    name = code[1]
    is_name = name in HOMES and (name[0].isupper() or name.startswith("eig3."))
    return f"[{code[0]}][{HOMES[name]}]" if is_name else code[0]


def draw(problem, path):
    """Draw a frame of the film of a run, without the words that say how fast the film is."""
    film = Film.of(run_report.run(lambda: problem, write=lambda text: None))
    figure = Figure(figsize=(4.8, 3.6), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    problem.view(figure, film)(int(SHOWN * len(film.t)))
    figure.savefig(path)


def reference(name):
    """Return the page of a module, on which mkdocstrings documents its public names that have no page yet."""
    module = importlib.import_module(name if name == "eig3" else f"eig3.{name}")
    entries = [f"# {module.__name__}\n\n{inspect.getdoc(module)}\n"]
    for key, value in public(module).items():
        path = path_of(value) or f"{module.__name__}.{key}"
        if path in HOMES.values():
            entries.append(f"## {key}\n\nSee `eig3.{key}`.\n")
        else:
            entries.append(f"::: {path}\n    options: {{heading: {module.__name__}.{key}, toc_label: {key}}}\n")
        HOMES[key] = HOMES[f"{module.__name__}.{key}"] = path
    return "\n".join(entries)


def public(module):
    """Return the public objects of a module by name, without those that are modules."""
    own = [name for name, value in vars(module).items() if name[0] != "_" and inspect.getmodule(value) is module]
    names = getattr(module, "__all__", own)
    found = {name: getattr(module, name) for name in names if name != "__version__"}
    return {name: value for name, value in found.items() if not isinstance(value, types.ModuleType)}


def path_of(value):
    """Return where a class or a function is defined, or None for another object."""
    return f"{value.__module__}.{value.__qualname__}" if hasattr(value, "__qualname__") else None


class Shown(griffe.Extension):
    """What the reference shows of a docstring and of a class."""

    def on_object(self, *, obj, **_):
        if obj.docstring:  # griffe would show the types 'ndarray, shape (m,)' and '{"gif", "mp4"}' as tuples
            text = obj.docstring.value.replace(", shape (", " of shape (")
            obj.docstring.value = re.sub(r"(?m)^(\w.*) : \{(.*)\}", r"\1 : one of \2", text)

    def on_class_members(self, *, cls, **_):
        for name in [name for name in cls.attributes if name.startswith("_")]:  # or it is in the signature
            cls.del_member(name)
