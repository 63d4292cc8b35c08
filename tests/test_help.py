"""`help()` of each public name, and of each of its methods, is short enough to be read: at most 60 lines."""

import inspect
import pydoc
import re

import pytest

import eig3
from eig3 import animation, effects, math, problems, scene, structures

MOST = 60
MODULES = eig3, scene, effects, structures, animation, problems, math
KINDS = "Methods|Class methods|Static methods|Readonly properties|Data"
SECTION = re.compile(rf"\n \|  (?:-{{70}}|Method resolution order:|(?:{KINDS}).* here:)\n")


def names_of(module):
    return getattr(module, "__all__", [name for name in vars(module) if not name.startswith("_")])


def help_of(found):
    """Return the text of help(), with the signature in one line: from Python 3.13 on, each argument has its own."""
    text = pydoc.plain(pydoc.render_doc(found))
    return re.sub(rf"({found.__name__})\(\n.*?\n[ |]*\)", r"\1(...)", text, count=1, flags=re.DOTALL)


def helps():
    """Yield the names and the texts of help(): of a class what is before its methods, and then each of them."""
    for module in MODULES:
        for name in names_of(module):
            found = getattr(module, name)
            if inspect.ismodule(found) or not callable(found):
                continue
            whole = help_of(found)
            yield f"{module.__name__}.{name}", SECTION.split(whole)[0] if inspect.isclass(found) else whole
            for member, method in vars(found).items() if inspect.isclass(found) else ():
                if not member.startswith("_") and inspect.isfunction(method):
                    yield f"{module.__name__}.{name}.{member}", help_of(method)


def test_help_is_short():
    lines = {name: len(text.splitlines()) for name, text in helps()}
    assert len(lines) > 250
    assert {name: count for name, count in lines.items() if count > MOST} == {}


@pytest.mark.parametrize("name", ["integrate", "ensemble", "Problem", "Solution", "Stepper"])
def test_help_says_what_there_is(name):
    """The names of all arguments, or of all fields: nothing was left out to make it short."""
    found = getattr(eig3, name)
    text = inspect.getdoc(found)
    given = [name for name, x in inspect.signature(found).parameters.items() if x.kind is not x.VAR_KEYWORD]
    documented = {word for line in re.findall(r"^([\w, ]+)(?: :.*)?$", text, re.MULTILINE) for word in line.split(", ")}
    assert [x for x in given if not x.startswith("_") and x not in documented] == []
