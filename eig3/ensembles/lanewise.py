"""Decide how the members of an ensemble run, in lanes or one at a time, and compile the code for lanes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from ..functions.callbacks import Callback, with_present_globals
from ..functions.companions import constraints_of, mark, remembered
from ..functions.layout import bound_layout
from ..functions.quantities import Quantity
from ..functions.records import left_out_of
from ..kernels.adaptive_lanes import adaptive_kernel, compile_event
from ..kernels.compile.numba_internals import gist, options_of
from ..kernels.constraint_lanes import UnrolledConstraints, compile_constrained, compile_keeping
from ..kernels.lanes import BlockLayout, Lanes, compile_quantity, compile_rhs
from ..kernels.loops.fixed import wide_kernel
from ..kernels.protocol import FOLLOWS, SEARCHES_LANES
from ..methods import Method
from ..run.prepare import Prepared
from ..stepping.run_options import RunOptions
from .histories import Histories
from .members import Members
from .named_lanes import NamedLanes
from .single_members import Singles

FEWEST_MEMBERS = 16  # with tolerances; lanes do not pay for fewer members
MOST_DEGREES = 24  # with more degrees of freedom, a member alone is as fast as in lanes
_MOST_ADAPTIVE = 8  # the same with tolerances: with more, the stages of a block leave the first-level cache
_MOST_PARAMS = 64  # of a member with tolerances, for the same reason
ADAPTIVE_LANES = 64
_CACHE = 2**15  # bytes of the first-level cache for the rows of a block
_ROWS_FOLLOWED = 5  # rows for each output: its value, its extremes and their times
_MOST_LANES, _LEAST_LANES = 512, 32
_FEW_LANES = 64  # enough for fast loops: more threads do not make blocks smaller than this
_FEWEST_LANES = 16  # the compiler cannot vectorise fewer lanes
_BLOCKS = 2  # least number of blocks for a thread
_CHUNK_SECONDS = 0.02  # duration of a chunk of steps, after which the members are checked
_CHUNK_GROWTH = 16  # largest factor from the steps of one chunk to the steps of the next
FIRST_CHUNK = 64  # steps
_MOST_STEPS = 2**40  # a chunk may end early

_AT_TIMES = "lanes with fixed steps have no t_eval; save_every is possible."
_MANY_CONSTRAINTS = (
    "lanes are for scenes with at most 8 constraints and 24 degrees of freedom, with forces on at most 8 points of "
    "bodies, and without pair forces, and without constraints that depend on the time or define phi."
)
_OTHER_CONSTRAINTS = (
    "params come from scenes whose constraints join different points than in this problem; make a problem of each "
    "scene."
)
_SPARSE = (
    "params have a sparse matrix and differ between members; lanes read a sparse matrix only from params that all "
    "members share; if they are the same, give only the parameters that change, by name."
)


class Pace:
    """The number of steps of a chunk, from the time of the last chunk of any block."""

    def __init__(self) -> None:
        self.steps = FIRST_CHUNK
        self.seconds: float | None = None  # for each step; None before the first chunk

    def note(self, steps: int, seconds: float) -> None:
        """Choose the number of steps of the next chunk."""
        self.seconds = seconds / steps
        self.steps = max(1, min(int(steps * min(_CHUNK_GROWTH, _CHUNK_SECONDS / (seconds + 1e-9))), _MOST_STEPS))


@dataclass(frozen=True, eq=False)
class Setup:
    """The values that the blocks of an ensemble share.

    Attributes
    ----------
    method : Method
        The method of the steps.
    layout : BlockLayout
    named : NamedLanes or None
        The parameters, if the functions are written line by line.
    prepared : Prepared
        The single run of a member.
    histories : Histories
    single : Singles
    kernel : callable
    rhs : Lanes
    constrained_step, project : Lanes or None
        The function that enforces the constraints, if any: a step of EIG-3, or the projection after each step.
    quantities : dict of str to (Quantity, Lanes)
        With fixed steps, the invariants and the outputs.
    events : list of (Lanes, int)
        The functions g of the events, and their numbers of values.
    places : list of (int, int)
        For each event the function, and the number of its value there.
    observes : bool
        Whether steps with tolerances are observed.
    pace : Pace
    """

    method: Method
    layout: BlockLayout
    named: NamedLanes | None
    prepared: Prepared
    histories: Histories
    single: Singles
    kernel: Callable
    rhs: Lanes
    constrained_step: Lanes | None
    project: Lanes | None
    quantities: dict[str, tuple[Quantity, Lanes]]
    events: list[tuple[Lanes, int]]
    places: list[tuple[int, int]]
    observes: bool
    pace: Pace = field(default_factory=Pace)


def in_lanes(rhs: Any, callback: Callback, histories: Histories, single: Singles, threads: int) -> tuple[Any, str]:
    """Compile the functions for lanes, and return a `Setup` and a note for the user, which may be empty.

    The setup is None if the members run one at a time.
    """
    members, options, method = histories.members, histories.options, histories.options.method
    of_params = bound_layout(rhs)
    named = NamedLanes.of(rhs, of_params, members) if of_params and not options.tolerances else None
    unrolled, obstacle = _unrolled_of(rhs, of_params, members) if named is None else (None, "")
    invariants, outputs = options.functions.quantities(members.form)
    followed = {**invariants, **outputs}
    if options.tolerances:
        layout = _layout(members, ADAPTIVE_LANES, has_own_times=True) if _pays(members, unrolled) else None
    else:
        method = method.for_force(callback.reads_velocity, members.n)
        method = method.with_constraints() if unrolled else method
        rows = 3 * len(options.events) + 2 * members.n if options.events else 0
        rows += sum(_ROWS_FOLLOWED * quantity.width for quantity in followed.values())
        more = unrolled.room + members.n if unrolled else 0
        layout = layout_of(members, method, rows + more, threads, named)
        obstacle = _AT_TIMES if options.t_eval is not None else obstacle
    if obstacle and (layout or not options.tolerances):
        return None, f"The members run one at a time, because {obstacle}"
    if layout is None:
        return None, ""
    prepared = single.prepared(0)
    try:
        functions = _compiled(rhs, callback, layout, method, options, unrolled, followed, named)
    except Exception as error:
        return None, (
            f"The members run one at a time, because a function does not compile for lanes: {gist(error)}; write "
            "loops over single values, without array expressions and functions of whole arrays; for a table, call "
            "eig3.math.interp."
        )
    note = functions["rhs"].obstacle and _on_obstacle(rhs, functions["rhs"].obstacle)
    return Setup(method, layout, named, prepared, histories, single, **functions), note


def _on_obstacle(rhs: Any, obstacle: str) -> str:
    """Describe what keeps LLVM from vectorising a function, whose code may be from a scene or a structure."""
    if left_out_of(rhs) is None and mark(rhs, "is_linear") is None:
        return f"rhs is not vectorised: {obstacle}."
    reason = obstacle.replace("; ", "; in functions that you wrote, ")
    return f"The force of the problem is not vectorised: {reason}."


def _compiled(
    rhs: Any,
    callback: Callback,
    layout: BlockLayout,
    method: Method,
    options: RunOptions,
    unrolled: UnrolledConstraints | None,
    followed: dict[str, Quantity],
    named: NamedLanes | None,
) -> dict[str, Any]:
    """Compile the functions of a `Setup`."""
    is_adaptive = layout.has_own_times
    has_constrained_step = bool(method.second) and not is_adaptive
    given, keeping = (rhs, callback, layout), None
    of = named and named.function
    if unrolled:
        in_blocks = _lanes_of(*given, compile_constrained, of=unrolled)
        keeping = _lanes_of(*given, compile_keeping, has_constrained_step, of=unrolled)
    else:
        in_blocks = _lanes_of(*given, compile_rhs, of=of and of(rhs))
    quantities = {}
    for name, quantity in ({} if is_adaptive else followed).items():
        mine = quantity.function, quantity.callback, layout
        quantities[name] = (
            quantity,
            _lanes_of(*mine, compile_quantity, quantity.shape, False, of=of and of(quantity.function)),
        )
    looks, places = _events_of(layout, options, named)
    constrained_step, project = (keeping, None) if has_constrained_step else (None, keeping)
    observes = bool(looks or followed) or options.t_eval is not None or options.save_every is not None
    if is_adaptive:
        kernel = adaptive_kernel(method.variable, layout.form, layout.n, layout.lanes, observes)
    elif looks:
        kernel = wide_kernel(method.formulas, SEARCHES_LANES, method.second, options.method.order, layout.form)
    else:
        kernel = wide_kernel(method.formulas, FOLLOWS if quantities or project else 0, method.second)
    functions = {"kernel": kernel, "rhs": in_blocks, "constrained_step": constrained_step, "project": project}
    return {**functions, "quantities": quantities, "events": looks, "places": places, "observes": observes}


def _events_of(
    layout: BlockLayout, options: RunOptions, named: NamedLanes | None
) -> tuple[list[tuple[Lanes, int]], list[tuple[int, int]]]:
    """Compile the functions of the events, and return them with their numbers of values, and the place of each event.

    The events of the links of a structure are values of one function.
    """
    compiled: dict[Any, tuple[Lanes, int]] = {}
    places = []
    for name, event in options.events.items():
        g = Quantity(f"events[{name!r}].g", event.g, form=layout.form)
        function, count, number = g.function, 0, 0
        if named and hasattr(g.function.py_func, "family"):
            function, count, number = g.function.py_func.family
        if function not in compiled:
            of_values = compile_quantity, (count,) if count else (), True
            how: tuple = (compile_event,) if layout.has_own_times else of_values
            in_lanes = _lanes_of(function, g.callback, layout, *how, of=named and named.function(function))
            compiled[function] = in_lanes, max(1, count)
        places.append((list(compiled).index(function), number))
    return list(compiled.values()), places


def _unrolled_of(rhs: Any, layout: Any, members: Members) -> tuple[UnrolledConstraints | None, str]:
    """Return the constraints of a scene for lanes, if any, or the reason why the members run one at a time."""
    if layout and members.has_own_params and members.n <= MOST_DEGREES and any(kind.ndim < 0 for kind in layout.kinds):
        return None, _SPARSE
    constraints = constraints_of(rhs)
    if constraints is None:
        return None, ""
    if constraints.unrolled is None:
        return None, _MANY_CONSTRAINTS
    if not constraints.unrolled.are_those_of(members.params):
        return None, _OTHER_CONSTRAINTS
    return constraints.unrolled, ""


def _pays(members: Members, unrolled: UnrolledConstraints | None) -> bool:
    """Whether lanes pay for members with tolerances. They do not read most of the parameters of constraints."""
    has_many = members.has_own_params and members.params.shape[1] > _MOST_PARAMS and unrolled is None
    return members.n <= _MOST_ADAPTIVE and not has_many and len(members) >= FEWEST_MEMBERS


def layout_of(
    members: Members, method: Method, more_rows: int, threads: int, named: NamedLanes | None = None
) -> BlockLayout | None:
    """Return the arrays of a block with fixed steps; None if the members should run one at a time.

    The functions of each step read or write `more_rows` rows.

    More lanes make each loop longer and faster, as long as the rows fit in the cache and each thread has blocks to run.
    The results of a member do not depend on the number of lanes.
    """
    if method.is_implicit or members.n > MOST_DEGREES or (method.is_stochastic and members.has_own_step):
        return None  # the noise of a step depends on its length
    lanes, rows = _MOST_LANES, members.n * method.formulas.own_rows + more_rows
    while lanes > _LEAST_LANES and 8 * rows * lanes > _CACHE:
        lanes //= 2
    while lanes > _FEW_LANES and _BLOCKS * threads * lanes > len(members):
        lanes //= 2
    while lanes > _FEWEST_LANES and lanes >= 2 * len(members):  # a lane without a member takes the same time
        lanes //= 2
    return _layout(members, lanes, named)


def _layout(
    members: Members, lanes: int, named: NamedLanes | None = None, *, has_own_times: bool = False
) -> BlockLayout:
    k = members.params.shape[-1]
    shared, own = (0, k) if members.has_own_params else (k, 0)
    if named and own:
        shared, own = k, named.columns.size
    return BlockLayout(members.form, members.n, lanes, shared, own, members.has_own_step, has_own_times)


def _lanes_of(
    function: Any, callback: Callback, layout: BlockLayout, compile_it: Callable[..., Lanes], *how: Any, of: Any = None
) -> Lanes:
    """Call ``compile_it(of, layout, *how)``, at the first call only.

    By default, `of` is the plain Python function of a checked function.
    """
    known, key = remembered(function, "lanes"), (compile_it, layout, how, of if callable(of) else None)
    if key not in known or known[key][0] is not callback.compiled:  # the user may have recompiled the function
        own = getattr(getattr(function, "py_func", None), "in_lanes", None)  # the reactions of a scene
        python = of or (own.py_func if own else callback.function)
        if hasattr(python, "inner"):
            python = with_present_globals(python)
        is_checked = bool(options_of(function).get("boundscheck"))
        known[key] = callback.compiled, compile_it(python, layout, *how, is_checked)
    return known[key][1]
