"""Links between the degrees of freedom of a structure: the links of scenes, along one line or about one axis.

All links of one kind are a loop in the right-hand side, and their parameters are arrays. Their states are first-order
unknowns: the rate of a state that only events change is 0.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..functions.callbacks import without_runtime
from ..functions.checks import shown
from ..functions.events import Event
from ..functions.families import Family
from ..functions.layout import Layout, unknown_name
from ..kernels.compile.source import Writer, define
from ..kernels.protocol import index
from ..scene.effect import RATE, Link, arguments
from ..scene.names import words
from .text import Loops

_PULLS = "tension", "force_density"


class Kind(NamedTuple):
    """Links with the same functions.

    Attributes
    ----------
    title : str
        The name of their state, and the beginning of the names of their events.
    functions : tuple of (str, jitted function)
    crossing : int
        The changes of sign at which their events occur: see `eig3.effects.Link`.
    size : int
        The number of values of a state.
    """

    title: str
    functions: tuple[tuple[str, Any], ...]
    crossing: int
    size: int

    @property
    def names(self) -> dict[str, Any]:
        return dict(self.functions)

    @property
    def has_state(self) -> bool:
        return any("state" in arguments(function) for _, function in self.functions)

    def fields(self) -> list[str]:
        """Return the parameters that the functions read."""
        read = dict.fromkeys(x for _, function in self.functions for x in arguments(function))
        return [name for name in read if name not in ("t", "r", "rate", "state")]


def check_links(links: Any, names: Sequence[str], n: int) -> tuple[tuple[Kind, ...], dict[str, Any]]:
    """Return the kinds of links, and their parameters by name.

    Parameters
    ----------
    links : sequence of (Link, first, second)
        The ends are numbers or names of degrees of freedom, sequences of these, or None for the ground.
    names : sequence of str
        The names of the degrees of freedom.
    n : int

    Raises
    ------
    TypeError, ValueError
    """
    parts: dict[Kind, list[tuple[np.ndarray, dict[str, np.ndarray]]]] = {}
    for number, each in enumerate(links):
        said = f"links[{number}]"
        if not (isinstance(each, tuple) and len(each) == 3 and isinstance(each[0], Link)):
            raise TypeError(f"{said} must be (link, first, second) with a link of eig3.effects, not {shown(each)}.")
        law: Any = each[0]
        law.check(1)
        if law.arrays or law.vectors:
            raise ValueError(f"{said} has a field that is not a number for each link, which a structure does not take.")
        ends = np.stack(np.broadcast_arrays(*(_end(end, names, n, said) for end in each[1:])))
        if (ends[0] == ends[1]).any():
            raise ValueError(f"{said} must join two different degrees of freedom, or one and None for the ground.")
        acting = {name: f for name, f in law.functions().items() if name in (*_PULLS, RATE, "event", "state_after")}
        kind = Kind(words(law.title), tuple(acting.items()), law.crossing, law.state_size)
        if "rate_after" in law.functions():
            raise ValueError(f"{said} changes velocities at events, which a structure does not take: use a scene.")
        parts.setdefault(kind, []).append((ends, law.columns(ends[0].shape, 1)))
    if not parts:
        return (), {}
    values: dict[str, Any] = {"states": 0}
    titles = [kind.title for kind in parts]
    kinds = sorted(parts, key=lambda kind: titles.index(kind.title))  # the states of a title are together
    for k, kind in enumerate(kinds):
        given = parts[kind]
        ends = np.concatenate([ends for ends, _ in given], axis=1)
        values |= {f"link_{k}_first": ends[0], f"link_{k}_second": ends[1]}
        for name in kind.fields():
            values[f"link_{k}_{name}"] = np.concatenate([columns[name] for _, columns in given])
        values["states"] += ends.shape[1] * kind.size * kind.has_state
    return tuple(kinds), values


def write(kinds: Sequence[Kind], text: Any, out: Writer, names: dict[str, Any], has_power: bool) -> None:
    """Write the forces and the rates of the states, and add the functions of the links to `names`.

    With `has_power`, write the power that the links absorb.
    """
    out.line(*["absorbed = 0.0"] * has_power)
    for k, kind, s, ends in _each(kinds, text, out, names):
        for end, sign in zip(ends, ("+=", "-="), strict=True):
            if end:
                with out.only_if(text.is_free(end)):
                    out.line(f"{text.force(end)} {sign} pull")
        out.line(*["absorbed += pull * rate"] * has_power)
        if kind.has_state:
            zeros = "0.0" if kind.size == 1 else f"({'0.0, ' * kind.size})"
            out.line(f"{_state('a', kind, s)} = {_call(k, kind, RATE, s) if RATE in kind.names else zeros}")


def write_output(kinds: Sequence[Kind], text: Any, out: Writer, names: dict[str, Any], what: str) -> None:
    """Write a value of each link to `out`."""
    for _ in _each(kinds, text, out, names):
        out.line(f"out[at] = {what}", "at += 1")


def write_events(kinds: Sequence[Kind], text: Any, out: Writer, names: dict[str, Any], k: int) -> None:
    """Write the values of the events of a kind of links to `out`."""
    out.line(
        "place = n",
        *(f"place += {kind.size} * p.link_{q}_first.size" for q, kind in enumerate(kinds[:k]) if kind.has_state),
    )
    for s, i, j in text.links(out, k):
        _write_one(k, kinds[k], text, out, names, s, (i, j))
        out.line(f"out[at] = {_call(k, kinds[k], 'event', s)}", "at += 1")


def write_shear(kinds: Sequence[Kind], text: Any, out: Writer, names: dict[str, Any]) -> None:
    """Add the forces of all links in the direction of the ground motion to `total`."""
    for _, _, _, ends in _each(kinds, text, out, names):
        for end, sign in zip(ends, ("-=", "+="), strict=True):
            if end:
                with out.only_if(text.is_free(end)):
                    out.line(f"total {sign} p.influence[{end}] * pull")


def _each(
    kinds: Sequence[Kind], text: Any, out: Writer, names: dict[str, Any]
) -> Iterator[tuple[int, Kind, str, tuple[str, str]]]:
    """Write what follows for each link, with its pull, and give its kind, its number and its ends."""
    out.line(*["place = n"] * bool(kinds))
    for k, kind in enumerate(kinds):
        for s, i, j in text.links(out, k):
            _write_one(k, kind, text, out, names, s, (i, j))
            pulls = [
                _call(k, kind, name, s) + " * r" * (name == "force_density") for name in _PULLS if name in kind.names
            ]
            out.line(f"pull = {' + '.join(pulls)}")
            yield k, kind, s, (i, j)
        out.line(*[f"place += {kind.size} * p.link_{k}_first.size"] * kind.has_state)


def events_of(
    kinds: Sequence[Kind], values: dict[str, Any], layout: Layout, together: Callable[[int], Any]
) -> dict[str, Event]:
    """Return the events of the links, by names such as "elastic plastic 0".

    ``together(k)`` returns a function that writes the values of all events of the kind k.
    """
    found: dict[str, Event] = {}
    before, counts = "", Counter[str]()
    for k, kind in enumerate(kinds):
        count = len(values[f"link_{k}_first"])
        if "event" in kind.names:
            event, change = (layout.bind(function, 4) for function in _of_events(k, kind, before))
            g, apply = Family(event, count, together(k)).members, Family(change, count).members
            changes = "state_after" in kind.names
            for s in range(count):
                name = f"{kind.title} {counts[kind.title] + s}"
                found[name] = Event(g[s], kind.crossing, apply=apply[s] if changes else None)
            counts[kind.title] += count
        before += f" + {kind.size} * p.link_{k}_first.size" * kind.has_state
    return found


def states_of(kinds: Sequence[Kind], values: dict[str, Any]) -> dict[str, Any]:
    """Return the states at the start, by name."""
    counts = Counter[str]()
    for k, kind in enumerate(kinds):
        if kind.has_state:
            counts[kind.title] += kind.size * len(values[f"link_{k}_first"])
    return {title: 0.0 if count == 1 else np.zeros(count) for title, count in counts.items()}


def _of_events(k: int, kind: Kind, before: str) -> list[Any]:
    """Return the functions of the events of a kind of links, and of the change of the state there."""
    names: dict[str, Any] = {"__name__": __name__, "index": index}
    out = Writer()
    for head, result in (("event", "return float({})"), ("state_after", f"{_state('v', kind, 's')} = {{}}")):
        with out.block(f"def {head}_of(member, t, u, v, p)"):
            out.line("s = index(member)", f"place = p.size{before}")
            if head in kind.names:
                out.line(f"i, j = p.link_{k}_first[s], p.link_{k}_second[s]")
                _write_one(k, kind, Loops(1), out, names, "s", ("i", "j"))
                out.line(result.format(_call(k, kind, head, "s")))
    defined = define(str(out), "links", names)
    return [without_runtime(defined[f"{head}_of"]) for head in ("event", "state_after")]


def _write_one(
    k: int, kind: Kind, text: Any, out: Writer, names: dict[str, Any], s: str, ends: tuple[str, str]
) -> None:
    """Write the stretch, the rate and the state of the link s."""
    names |= {f"{name}_{k}": function for name, function in kind.functions}
    out.line("r, rate = 0.0, 0.0")
    for end, sign in zip(ends, ("-=", "+="), strict=True):
        if end:
            with out.only_if(text.is_free(end)):
                out.line(f"r {sign} u[{end}]", f"rate {sign} v[{end}]")
    out.line(*[f"state = {_state('v', kind, s)}"] * kind.has_state)


def _state(array: str, kind: Kind, s: str) -> str:
    """Return the source of the state of a link in an array, a tuple if it has several numbers."""
    if kind.size == 1:
        return f"{array}[place + {s}]"
    return f"({', '.join(f'{array}[place + {kind.size} * {s} + {k}]' for k in range(kind.size))})"


def _call(k: int, kind: Kind, name: str, s: str) -> str:
    given = (x if x in ("t", "r", "rate", "state") else f"p.link_{k}_{x}[{s}]" for x in arguments(kind.names[name]))
    return f"{name}_{k}({', '.join(given)})"


def _end(end: Any, names: Sequence[str], n: int, said: str) -> np.ndarray:
    """Return the numbers of degrees of freedom, and -1 for the ground."""
    if isinstance(end, str) or end is None or np.ndim(end) == 0:
        end = [end]
    found = []
    for each in end:
        if isinstance(each, str):
            if each not in names:
                raise unknown_name(f"{said}: the structure has", each, list(names), ValueError)
            found.append(list(names).index(each))
        elif each is None:
            found.append(-1)
        elif isinstance(each, int | np.integer) and not isinstance(each, bool) and 0 <= each < n:
            found.append(int(each))
        else:
            raise ValueError(f"{said} must have numbers from 0 to {n - 1}, names or None for its ends, not {each!r}.")
    return np.array(found, dtype=np.int64)
