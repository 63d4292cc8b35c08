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
from ..functions.events import EffectEvent, Event
from ..functions.families import Family
from ..functions.layout import Layout, unknown_name
from ..kernels.compile.numba_internals import Jitted
from ..kernels.compile.source import Writer, define
from ..kernels.protocol import index
from ..scene.effect import RATE, Link, arguments
from ..scene.names import words
from .text import Ends, Loops, axes_of, number_of_links

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
    rule, turns : str, bool
        What must hold at the start of a run: see `eig3.functions.events.EffectEvent`.
    size : int
        The number of values of a state.
    directions : int
        The number of directions across which a link acts.
    vectors : tuple of (str, int)
        The parameters that are tuples, and their numbers of values.
    """

    title: str
    functions: tuple[tuple[str, Any], ...]
    crossing: int
    rule: str
    turns: bool
    size: int
    directions: int
    vectors: tuple[tuple[str, int], ...]

    @property
    def names(self) -> dict[str, Any]:
        return dict(self.functions)

    @property
    def has_state(self) -> bool:
        return any("state" in arguments(function) for _, function in self.functions)

    @property
    def axes(self) -> Sequence[str]:
        return axes_of(self.directions)

    def fields(self) -> list[str]:
        """Return the parameters that the functions read."""
        read = dict.fromkeys(x for _, function in self.functions for x in arguments(function))
        return [name for name in read if name not in ("t", "r", "rate", "state")]


def check_links(links: Any, names: Sequence[str], n: int, u0: np.ndarray) -> tuple[tuple[Kind, ...], dict[str, Any]]:
    """Return the kinds of links, and their parameters by name.

    Parameters
    ----------
    links : sequence of (Link, first, second)
        The ends are numbers or names of degrees of freedom, sequences of these, or None for the ground. The ends of a
        link across two directions are pairs of these.
    names : sequence of str
        The names of the degrees of freedom.
    n : int
    u0 : ndarray, shape (n,)
        For links that break.

    Raises
    ------
    TypeError, ValueError
    """
    parts: dict[Kind, list[tuple[np.ndarray, dict[str, np.ndarray]]]] = {}
    if not isinstance(links, list | tuple):
        raise TypeError(f"links must be a list of (link, first, second), not {shown(links)}.")
    for number, each in enumerate(links):
        said = f"links[{number}]"
        if not (isinstance(each, tuple) and len(each) == 3 and isinstance(each[0], Link)):
            raise TypeError(f"{said} must be (link, first, second) with a link of eig3.effects, not {shown(each)}.")
        law: Any = each[0]
        law.check(1)
        if law.directions > 1 and "force_density" in law.functions():
            raise ValueError(f"{said} acts across {law.directions} directions: give it a tension, not a force_density.")
        if law.arrays:
            raise ValueError(f"{said} has a field that is an array for all links, which a structure does not take.")
        first, second = (_end(end, names, n, said, law.directions) for end in each[1:])
        if 0 in (len(first), len(second)) or len({len(first), len(second)} - {1}) > 1:
            raise ValueError(f"{said} must have as many first ends as second ends, not {len(first)} and {len(second)}.")
        ends = np.stack(np.broadcast_arrays(first, second))
        same = (ends[0] == ends[1]).reshape(-1, law.directions)
        if same.all(axis=1).any() or (same & (ends[0] >= 0).reshape(same.shape)).any():
            raise ValueError(f"{said} must join two different degrees of freedom, or one and None for the ground.")
        acting = {name: f for name, f in law.functions().items() if name in (*_PULLS, RATE, "event", "state_after")}
        if law.ductility:
            acting["ductility"] = _ductility(law, ends[0].shape[:1])
        vectors = tuple((name, law.components(name, 1)) for name in law.vectors)
        of_law = law.crossing, law.rule, law.turns, law.state_size, law.directions
        kind = Kind(words(law.title), tuple(acting.items()), *of_law, vectors)
        if "rate_after" in law.functions():
            raise ValueError(f"{said} changes velocities at events, which a structure does not take: use a scene.")
        columns = law.columns(ends[0].shape[:1], 1)
        if hasattr(law, "check_whole"):
            law.check_whole(columns, np.diff(np.append(u0, 0.0)[ends], axis=0)[0])  # the ground is the last
        parts.setdefault(kind, []).append((ends, columns))
    if not parts:
        return (), {}
    values: dict[str, Any] = {"states": 0, "links": 0}
    titles = [kind.title for kind in parts]
    kinds = sorted(parts, key=lambda kind: titles.index(kind.title))  # the states of a title are together
    for k, kind in enumerate(kinds):
        given = parts[kind]
        ends = np.concatenate([ends for ends, _ in given], axis=1)
        values |= {f"link_{k}_first": ends[0], f"link_{k}_second": ends[1]}
        for name in kind.fields():
            values[f"link_{k}_{name}"] = np.concatenate([columns[name] for _, columns in given])
        values["links"] += ends.shape[1]
        values["states"] += ends.shape[1] * kind.size * kind.has_state
    return tuple(kinds), values


def write(kinds: Sequence[Kind], text: Any, out: Writer, names: dict[str, Any], has_power: bool) -> None:
    """Write the forces and the rates of the states, and add the functions of the links to `names`.

    With `has_power`, write the power that the links absorb.
    """
    out.line(*["absorbed = 0.0"] * has_power)
    for k, kind, s, ends in _each(kinds, text, out, names):
        for axis, end, sign in _signed(kind, ends, "+=", "-="):
            with out.only_if(text.is_free(end)):
                out.line(f"{text.force(end)} {sign} pull{axis}")
        powers = " + ".join(f"pull{axis} * rate{axis}" for axis in kind.axes)
        out.line(*[f"absorbed += {powers}"] * has_power)
        if kind.has_state:
            zeros = "0.0" if kind.size == 1 else f"({'0.0, ' * kind.size})"
            out.line(f"{_state('a', kind, s)} = {_call(k, kind, RATE, s) if RATE in kind.names else zeros}")


def write_output(kinds: Sequence[Kind], text: Any, out: Writer, names: dict[str, Any], what: str) -> None:
    """Write a value of each link in each of its directions to `out`, or the ductility of each link that yields."""
    for k, kind, s, _ in _each(kinds, text, out, names):
        values = [f"{what}{axis}" for axis in kind.axes]
        if what == "ductility":
            values = [_call(k, kind, what, s)] if what in kind.names else []
        for value in values:
            out.line(f"out[at] = {value}", "at += 1")


def write_events(kinds: Sequence[Kind], text: Any, out: Writer, names: dict[str, Any], k: int) -> None:
    """Write the values of the events of a kind of links to `out`."""
    earlier = ((kind.size, number_of_links(q, kind.directions)) for q, kind in enumerate(kinds[:k]) if kind.has_state)
    out.line("place = n" + "".join(f" + {size} * {count}" for size, count in earlier))
    for s, ends in text.links(out, k, kinds[k].directions):
        _write_one(k, kinds[k], text, out, names, s, ends)
        out.line(f"out[at] = {_call(k, kinds[k], 'event', s)}", "at += 1")


def write_shear(kinds: Sequence[Kind], text: Any, out: Writer, names: dict[str, Any]) -> None:
    """Add the forces of all links in the direction of the ground motion to `total`."""
    for _, kind, _, ends in _each(kinds, text, out, names):
        for axis, end, sign in _signed(kind, ends, "-=", "+="):
            with out.only_if(text.is_free(end)):
                out.line(f"total {sign} p.influence[{end}] * pull{axis}")


def _each(
    kinds: Sequence[Kind], text: Any, out: Writer, names: dict[str, Any]
) -> Iterator[tuple[int, Kind, str, Ends]]:
    """Write what follows for each link, with its pull, and give its kind, its number and its ends."""
    out.line(*["place = n"] * bool(kinds))
    for k, kind in enumerate(kinds):
        for s, ends in text.links(out, k, kind.directions):
            _write_one(k, kind, text, out, names, s, ends)
            pulls = [
                _call(k, kind, name, s) + " * r" * (name == "force_density") for name in _PULLS if name in kind.names
            ]
            out.line(f"{', '.join(f'pull{axis}' for axis in kind.axes)} = {' + '.join(pulls)}")
            yield k, kind, s, ends
        out.line(*[f"place += {kind.size} * {number_of_links(k, kind.directions)}"] * kind.has_state)


def _ductility(law: Any, shape: tuple[int, ...]) -> Any:
    """Return the function of the ductility of a link, which must read r and fields that other functions read."""
    function = getattr(law.ductility, "__func__", law.ductility)  # without staticmethod, it is bound to the link
    known = ["r", *law.columns(shape, 1)]
    if not isinstance(function, Jitted) or any(x not in known for x in arguments(function)):
        raise TypeError(f"ductility of {law.title} must be compiled with @eig3.jit, and read only {', '.join(known)}.")
    return function


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
                change = apply[s] if changes else None
                found[name] = EffectEvent(g[s], kind.crossing, False, change, kind.rule, kind.turns, changes)
            counts[kind.title] += count
        before += f" + {kind.size} * {number_of_links(k, kind.directions)}" * kind.has_state
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
                text = Loops(1)
                _write_one(k, kind, text, out, names, "s", text.ends(out, k, kind.directions))
                out.line(result.format(_call(k, kind, head, "s")))
    defined = define(str(out), "links", names)
    return [without_runtime(defined[f"{head}_of"]) for head in ("event", "state_after")]


def _write_one(k: int, kind: Kind, text: Any, out: Writer, names: dict[str, Any], s: str, ends: Ends) -> None:
    """Write the stretch, the rate and the state of the link s."""
    names |= {f"{name}_{k}": function for name, function in kind.functions}
    out.line(*(f"r{axis}, rate{axis} = 0.0, 0.0" for axis in kind.axes))
    for axis, end, sign in _signed(kind, ends, "-=", "+="):
        with out.only_if(text.is_free(end)):
            out.line(f"r{axis} {sign} u[{end}]", f"rate{axis} {sign} v[{end}]")
    if kind.directions > 1:
        out.line(*(f"{x} = {', '.join(f'{x}{axis}' for axis in kind.axes)}" for x in ("r", "rate")))
    out.line(*[f"state = {_state('v', kind, s)}"] * kind.has_state)


def _signed(kind: Kind, ends: Ends, of_first: str, of_second: str) -> Iterator[tuple[str, str, str]]:
    """Give the axis, the text and the sign of each end that is not always the ground."""
    for axis, pair in zip(kind.axes, ends, strict=True):
        yield from ((axis, end, sign) for end, sign in zip(pair, (of_first, of_second), strict=True) if end)


def _state(array: str, kind: Kind, s: str) -> str:
    """Return the source of the state of a link in an array, a tuple if it has several numbers."""
    if kind.size == 1:
        return f"{array}[place + {s}]"
    return f"({', '.join(f'{array}[place + {kind.size} * {s} + {k}]' for k in range(kind.size))})"


def _call(k: int, kind: Kind, name: str, s: str) -> str:
    sizes = dict(kind.vectors)

    def given(x: str) -> str:
        if x in ("t", "r", "rate", "state"):
            return x
        if x in sizes:
            return f"({', '.join(f'p.link_{k}_{x}[{s}, {i}]' for i in range(sizes[x]))})"
        return f"p.link_{k}_{x}[{s}]"

    return f"{name}_{k}({', '.join(map(given, arguments(kind.names[name])))})"


def _end(end: Any, names: Sequence[str], n: int, said: str, directions: int) -> np.ndarray:
    """Return the numbers of degrees of freedom, and -1 for the ground; a row for each link across directions."""
    one = end is None or isinstance(end, str) or np.ndim(end) == 0
    if directions == 1:
        return np.array([_number(x, names, n, said) for x in ([end] if one else end)], dtype=np.int64)
    is_row = one or all(isinstance(x, str) or x is None or np.ndim(x) == 0 for x in end)
    rows: list[Any] = [(None,) * directions if row is None else row for row in ([end] if is_row else end)]
    if any(isinstance(row, str) or np.ndim(row) == 0 or len(row) != directions for row in rows):
        raise ValueError(
            f"{said} acts across {directions} directions: give pairs of degrees of freedom for its ends, such as "
            '("base.ux", "base.uy"), ("base.ux", None) for one direction alone, or None for the ground.'
        )
    return np.array([[_number(x, names, n, said) for x in row] for row in rows], dtype=np.int64)


def _number(end: Any, names: Sequence[str], n: int, said: str) -> int:
    """Return the number of a degree of freedom, or -1 for the ground."""
    if isinstance(end, str):
        if end not in names:
            raise unknown_name(f"{said}: the structure has", end, list(names), ValueError)
        return list(names).index(end)
    if end is None:
        return -1
    if isinstance(end, int | np.integer) and not isinstance(end, bool) and 0 <= end < n:
        return int(end)
    raise ValueError(f"{said} must have numbers from 0 to {n - 1}, names or None for its ends, not {end!r}.")
