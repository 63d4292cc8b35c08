"""Check the names of an effect's fields when its class is defined, before the dataclass decorator fails on them."""

from __future__ import annotations

import dataclasses
import inspect
import sys
from typing import Any

from .names import identifier


def check_fields(cls: type, kind: type) -> None:
    """Check that Python keeps the names of the fields unchanged, and that no field replaces an attribute of `kind`.

    Raises
    ------
    TypeError
        If a field fails a check. The error names the class and the field.
    """
    for name in _declared(cls):
        plain = identifier(name)
        if name != plain:
            raise TypeError(
                f"{cls.__name__} must rename its field {name!r}, because Python cannot read it or reads it as another "
                f"name: take a name such as {plain!r}."
            )
        if name in dir(kind):
            variable = any(name in annotations_of(base) for base in kind.__mro__)
            remedy = " or remove its annotation" * variable  # as in vectors: tuple = ("direction",)
            raise TypeError(
                f"{cls.__name__} must rename its field {name}{remedy}: {kind.__name__} has an attribute of this name."
            )


def annotations_of(cls: type) -> dict[str, Any]:
    """Return the annotations in the body of a class."""
    if sys.version_info >= (3, 14):  # annotations are evaluated on access, and may use names that are not yet defined
        import annotationlib

        return annotationlib.get_annotations(cls, format=annotationlib.Format.FORWARDREF)
    return inspect.get_annotations(cls)


def _declared(cls: type) -> list[str]:
    """Return the names of the fields that a class will have when it is decorated."""
    records = [base for base in cls.__mro__[1:] if dataclasses.is_dataclass(base)]
    inherited = [field.name for base in records for field in dataclasses.fields(base)]
    own = [name for name, annotation in annotations_of(cls).items() if "ClassVar" not in str(annotation)]
    return [*inherited, *own]
