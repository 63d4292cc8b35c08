"""Find a problem of the library by its name, or a problem of the user by MODULE:NAME or FILE.py:NAME."""

from __future__ import annotations

import importlib
import importlib.util
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Any

from .kernels.compile.numba_internals import Jitted
from .problem import Problem

OWN = "your own as MODULE:NAME or FILE.py:NAME"


def is_own(name: str) -> bool:
    """Whether a name is of a user's own problem."""
    return ":" in name


def find(name: str, command: str) -> Any:
    """Return the function of `eig3.problems`, or the user's own object, that has a name.

    `command` is the command, and perhaps the option, that an error names.

    Raises
    ------
    SystemExit
        If there is none. The message has similar names.
    """
    if is_own(name):
        return _own(name, command)
    from . import problems

    if name.endswith(".py"):
        raise SystemExit(f"{command}: {name} is a file: name the problem in it too, as {name}:NAME.")
    if name not in problems.__all__:
        near = get_close_matches(name, problems.__all__)
        known = " or ".join(near) if near else ", ".join(problems.__all__)
        raise SystemExit(f"{command}: there is no problem {name}: take {known}, or {OWN}.")
    return getattr(problems, name)


def builder(name: str, command: str) -> Callable[..., Problem]:
    """Return the function that builds a problem, with its parameters and the argument `t_end`.

    A `Problem` itself is copied with other values of its named parameters that are real numbers.
    """
    found = find(name, command)
    if isinstance(found, Problem):
        names = [x for x, kind in _kinds(found).items() if kind.text == "real"]

        def make(**given: float) -> Problem:
            return found.with_(params=given) if given else found

        of_numbers = [Parameter(x, Parameter.KEYWORD_ONLY, annotation=float) for x in names]
        return _with_end(make, found.name, of_numbers)
    if not is_own(name):
        return found if "t_end" in signature(found).parameters else _with_end(found, name, _parameters(found))
    if not callable(found) or isinstance(found, Jitted):
        what = "a jitted function" if isinstance(found, Jitted) else type(found).__name__
        hint = ": take what its method problem returns" if hasattr(found, "problem") else ""
        raise refused(name, command, f"it must be an eig3.Problem or a function that returns one, not {what}{hint}")

    def own(**given: Any) -> Any:
        try:
            return found(**given)
        except (TypeError, ValueError):  # of values that a problem does not take; each command reports them
            raise
        except Exception as error:
            raise refused(name, command, _in_words_with_line(error)) from None

    return _with_end(own, found.__name__, _parameters(found))


def _parameters(function: Callable[..., Any]) -> list[Parameter]:
    """Return the parameters of a function. A default that is a number makes an unannotated parameter a number."""
    try:
        found = signature(function, eval_str=True).parameters.values()
    except NameError:  # an annotation that is not defined while the module runs
        found = signature(function).parameters.values()

    def kind(parameter: Parameter) -> Any:
        is_number = isinstance(parameter.default, int | float) and not isinstance(parameter.default, bool)
        return float if is_number and parameter.annotation is Parameter.empty else parameter.annotation

    return [parameter.replace(annotation=kind(parameter)) for parameter in found]


def _kinds(problem: Problem) -> dict[str, Any]:
    """Return the kind of each named parameter."""
    layout = getattr(problem.params, "layout", None)
    return dict(zip(layout.names, layout.kinds, strict=True)) if layout else {}


def _with_end(make: Callable[..., Any], name: str, parameters: list[Parameter]) -> Callable[..., Problem]:
    """Return a function that builds a problem and changes its end to `t_end`, if it has no such parameter itself."""
    has_end = any(parameter.name == "t_end" for parameter in parameters)

    def build(*, t_end: float | None = None, **given: Any) -> Problem:
        if has_end and t_end is not None:
            given["t_end"] = t_end
        problem = make(**given)
        if not isinstance(problem, Problem):
            raise TypeError(f"{name} must return an eig3.Problem, not {type(problem).__name__}.")
        return problem if t_end is None or has_end else problem.with_(t_span=(problem.t_span[0], t_end))

    build.__name__ = name
    end = [] if has_end else [Parameter("t_end", Parameter.KEYWORD_ONLY, default=None)]
    build.__signature__ = Signature([*parameters, *end])  # type: ignore[attr-defined]
    build.__annotations__ = {x.name: x.annotation for x in parameters}
    return build


def refused(name: str, command: str, why: str) -> SystemExit:
    """Return the error of a problem of the user."""
    return SystemExit(f"{command} {name}: {why}.")


def in_words(error: BaseException) -> str:
    """Return the kind and the message of an error."""
    return f"{type(error).__name__}: {error}"


@contextmanager
def reported(command: str) -> Iterator[None]:
    """Turn errors of bad arguments, and all errors that compiled functions raise, into the error of a command."""
    try:
        yield
    except Exception as error:
        *_, (frame, _) = traceback.walk_tb(error.__traceback__)
        if "__name__" not in frame.f_globals:  # Numba's frame of a compiled function
            words = f"{_in_words_with_line(error)}."
        elif isinstance(error, ImportError | OSError | RuntimeError | TypeError | ValueError):
            words = str(error)
        else:
            raise
        raise SystemExit(f"{command}: {words}") from None


def _in_words_with_line(error: BaseException) -> str:
    """Return the kind and the message of an error, and the line that raised it, if it is not the importer's."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    place = "" if last.filename.startswith("<frozen") else f" ({Path(last.filename).name}, line {last.lineno})"
    return f"{in_words(error).rstrip('.')}{place}"


def _own(name: str, command: str) -> Any:
    module, _, attribute = name.rpartition(":")
    with _current_folder():
        try:
            loaded = _of_file(Path(module)) if module.endswith(".py") else importlib.import_module(module)
        except FileNotFoundError:
            raise refused(name, command, f"there is no file {module}{_near_files(module)}") from None
        except Exception as error:
            is_missing = isinstance(error, ModuleNotFoundError)
            if is_missing and error.name and module.startswith(error.name):  # type: ignore[attr-defined]
                why = f"there is no module {module} here or among the installed ones{_near_files(module)}"
            else:
                why = f"the module {module} cannot be imported ({error if is_missing else _in_words_with_line(error)})"
            raise refused(name, command, why) from None
    if not hasattr(loaded, attribute):
        near = get_close_matches(attribute, vars(loaded))
        hint = f", but {' or '.join(near)}" if near else ""
        raise refused(name, command, f"the module {module} has no {attribute or 'empty name'}{hint}")
    return getattr(loaded, attribute)


def _near_files(module: str) -> str:
    """Return the end of a sentence with similar names of files in the same folder, and perhaps nothing."""
    folder, suffix = Path(module).parent, ".py" if module.endswith(".py") else ""
    known = {str(folder / f"{each.stem}{suffix}") for each in folder.glob("*.py")}
    near = get_close_matches(module, known)
    return f", but {' or '.join(near)}" if near else ""


def _of_file(path: Path) -> Any:
    """Import a file, under its own name, which pickles of its functions then have."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        sys.modules.pop(path.stem, None)
        raise
    return module


@contextmanager
def _current_folder() -> Iterator[None]:
    """Let modules of the current folder be imported."""
    folder = str(Path.cwd())
    sys.path.insert(0, folder)
    try:
        yield
    finally:
        sys.path.remove(folder)
