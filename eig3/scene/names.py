"""Make Python identifiers of names that users choose. Only these identifiers enter the source of a scene."""

from __future__ import annotations

import keyword
import re
import unicodedata
from collections.abc import Container

_REFUSED = {*keyword.kwlist, "__debug__"}  # Python allows no assignment to __debug__, which is not a keyword


def words(title: str) -> str:
    """Return the words of the name of a class, such as "rigid stop" for RigidStop."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", title).lower()


def identifier(wanted: str, taken: Container[str] = ()) -> str:
    """Return an identifier similar to `wanted` that is neither a keyword of Python nor in `taken`.

    An identifier that is not taken is returned unchanged, if it is in the normal form NFKC. Python reads every
    identifier in this form, so two names of one form would be one variable.
    """
    normal = unicodedata.normalize("NFKC", wanted)
    name = "".join(c if f"_{c}".isidentifier() else "_" for c in normal)
    if not name.isidentifier():  # empty, or its first character is allowed only after another
        name = f"_{name}"
    number, unique = 1, name
    while unique in _REFUSED or unique in taken:
        number += 1
        unique = f"{name}_{number}"
    return unique
