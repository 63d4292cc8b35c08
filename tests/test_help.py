"""What `help` prints of each public name fits a screen."""

import importlib
import inspect

import eig3

FOLDERS = ("", ".animation", ".effects", ".math", ".problems", ".scene", ".stability")
SCREEN = 60  # lines
SHORT = 200  # characters of a signature that a reader takes in at once
PARAMETER = 40  # characters for each parameter of a longer signature: its name, its type and its default
EXPANDED = ("Union[", "Optional[", "Callable[[", "ForwardRef", "numpy.", "typing.")


def public_names():
    """Return the public functions, classes and methods of the library by name."""
    found = {}
    for module in (importlib.import_module(f"eig3{folder}") for folder in FOLDERS):
        defined = [name for name, value in inspect.getmembers(module) if inspect.getmodule(value) is module]
        for name in getattr(module, "__all__", [name for name in defined if name[0] != "_"]):
            value = getattr(module, name)
            if callable(value):
                found[f"{module.__name__}.{name}"] = value
            if inspect.isclass(value):
                methods = [key for key in dir(value) if key[0] != "_" and callable(getattr(value, key))]
                found |= {f"{module.__name__}.{name}.{key}": getattr(value, key) for key in methods}
    return found


def signature_of(value):
    try:
        return inspect.signature(value)
    except ValueError:  # an exception, or a function that is written in C
        return inspect.Signature()


def test_signatures_name_their_types():
    signatures = {name: signature_of(value) for name, value in public_names().items()}
    assert [name for name, each in signatures.items() if any(expanded in str(each) for expanded in EXPANDED)] == []
    most = {name: max(SHORT, PARAMETER * len(each.parameters)) for name, each in signatures.items()}
    assert [name for name, each in signatures.items() if len(str(each)) > most[name]] == []


def test_documentation_fits_a_screen():
    texts = {name: inspect.getdoc(value) or "" for name, value in public_names().items()}
    assert [name for name, text in texts.items() if len(text.splitlines()) > SCREEN] == []


def test_public_names_of_every_kind_are_found():
    of_eig3 = {"eig3.integrate", "eig3.ensemble", "eig3.report", "eig3.Solution.at"}
    of_folders = {"eig3.math.sin", "eig3.problems.kepler", "eig3.stability.limit", "eig3.scene.Scene.add"}
    assert of_eig3 | of_folders | {"eig3.effects.HertzContact", "eig3.animation.Mechanism"} <= public_names().keys()


def test_the_names_that_are_offered_are_the_public_ones():
    assert dir(eig3) == sorted(eig3.__all__)
