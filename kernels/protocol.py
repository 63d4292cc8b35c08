"""The interface of kernels, marches and callbacks: their signatures, and functions for the rows of a state."""

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import intrinsic
from numba.types import Array, float64, int64, none

from .compile.jit import compile_kernel, element, function_at
from .compile.numba_internals import (
    FloatPointer,
    Located,
    Row,
    array_over,
    copy_on_stack,
    entries_of,
    floats_on_stack,
    parts_of,
    parts_of_row,
    row_over,
)

#: The entries of a kernel's `counters`. All runs count evaluations and iterations of a solve.
EVALUATIONS = 0
ITERATIONS = 1
RESIDUAL = 2  # of a failed solve
DEGREE = 3  # the degree of freedom of this residual
# Most of these are for runs with events or tolerances:
TIME = 4
STEP = 5  # the next one
STEP_BEFORE = 6
ERROR = 7  # the logarithm of the last error
REJECTED = 8  # the number of rejected steps
U_SIZE = 9  # the largest |u| so far
V_SIZE = 10  # the largest |v| so far
NEXT = 11  # the next of `Watch.times`
LOGGED = 12  # the number of occurrences in the log
ANEW = 13  # the index of the step at which a multistep method started anew
GAP = 14  # the time between the last two resets
ENDED_BY = 15  # the event that ended the run
WITHIN = 16  # 1 if a call ended within a fixed step because the log was full
# With tolerances:
BY_SPAN = 17  # 1 if the length of the span decided about a step before its last one
SILENT_STEP = 18  # the longest step in which nothing acted
SILENT_END = 19  # the time of its end
# With quantities:
PART = 20  # the number of the current part of the run
PART_END = 21  # the step index at its end
DUE = 22  # the step index at which the invariants are due next
SPACING = 23  # the largest distance between two such indices
# With wanted times:
FIRST_ROW = 24  # the row of the first of them; runs in lanes share the rows

#: Four values follow for each event: the sign of g, where 0 means that it is looked at just after the start of the
#: next step; the time of its last reset; the sign of g before this reset, if it left g at zero, or else 0; and g after
#: it.
EVENTS, EVENT_VALUES = 25, 4

#: What became of a step with events. A later one of these outcomes takes precedence. A step that is RESTING or
#: NOT_A_NUMBER is not taken: the state stays at its start.
PASSED, RESET, TERMINAL, ZENO, RESTING, NOT_A_NUMBER, NOT_FINITE = range(7)

#: How a kernel ended, besides these outcomes: the steps are taken, the end is reached, the next step would reach it and
#: be shortened, the step is below the resolution of t, or there is no room for rows or occurrences.
GOING, AT_END, BEFORE_END, TOO_SMALL, FULL = range(10, 15)

#: What a kernel does besides its steps, if not 0: it follows quantities; or it also looks for events and wanted times;
#: or for events in lanes.
FOLLOWS, SEARCHES, SEARCHES_LANES = 1, 2, 3

#: The solve of a step failed.
FAILED = 20

#: The columns of `Watch.events`, which has a row for each event.
G = 0  # the address of g
APPLY_ADDRESS = 1  # the address of apply, or 0
DIRECTION = 2
IS_TERMINAL = 3
TOGETHER = 4  # the number of events from here on that are looked at together, or 1
QUIET = 5  # the address of the function that looks at them: see `zeros.quiet_together`
NUMBER = 6  # the number of the first of them in its family
FOLLOWS_RESETS = 7  # 1 if a reset of another event causes this event too, as an impact may turn a link
EVENT_COLUMNS = 8

#: The columns of `Follow.table`.
ADDRESS, WIDTH, COLUMN, OUT, ROWS, WORK = range(6)

#: The rows of `Follow.extremes`, with a column for each value: the extremes, and the times at which they occurred.
LOW, HIGH, T_LOW, T_HIGH = range(4)

#: Number of the last parts of a run for which `Follow` has the extremes.
PARTS = 17


class Steps(NamedTuple):
    """The steps of a fixed length to take: `count` steps from step index `first`.

    Every `every`-th state is written to the rows, from the row `row` on.
    """

    h: Any
    t0: Any
    p: Any
    first: Any
    count: Any
    every: Any
    row: Any
    u_rows: Any
    v_rows: Any


class Span(NamedTuple):
    """The steps of variable length to take: at most `count` from step index `first`, to `t_end` at most.

    The run began at `t0`.

    Every `every`-th state is written to the rows, from the row `row` on; no state is written if there are no rows. With
    `every` 1, so is the state before a reset. `atol` has a row for u and one for v. If `is_relative` is 1, `rtol` is
    relative to the largest value so far of each degree of freedom whose `atol` is finite. If `may_shorten` is 0, a step
    that reaches the end is not taken. If `reads_time` is 1, the force may change though nothing moves. The first
    `points` degrees of freedom change by at most `reach` in a step.
    """

    t0: Any
    t_end: Any
    p: Any
    first: Any
    count: Any
    every: Any
    row: Any
    h_max: Any
    rtol: Any
    atol: Any
    is_relative: Any
    may_shorten: Any
    reads_time: Any
    points: Any
    reach: Any
    t_rows: Any
    h_rows: Any
    u_rows: Any
    v_rows: Any


class Watch(NamedTuple):
    """What a run looks for within its steps: events, and times at which the state is written.

    For the columns of `events`, see `G`.
    A row of `log` is for an occurrence: the event, the time, and u and v before and after apply. `times` are the times
    at which to write u, v and the step. `work` has rows of n values, which callbacks may get, and `search` has four
    rows with a value for each event.
    """

    events: Any
    log: Any
    times: Any
    h_rows: Any
    u_rows: Any
    v_rows: Any
    work: Any
    search: Any


class Follow(NamedTuple):
    """The quantities, invariants and outputs, that a run evaluates in every state.

    A row of `table` belongs to a quantity. It contains the address of its function; its number of values, or 0 if the
    function returns its only value; its first column in `extremes`, `steps` and `parts`; its first index in `out`; the
    address of an array with a row of its values for each state that is saved, or 0; and a degree of freedom whose
    largest |v| is kept in `most`, or -1.

    `out` has the values in the latest state in which a quantity was evaluated. `extremes` are those over all states so
    far, see `LOW`, and `steps` the lowest and highest values at the ends of steps and at events only. `parts` has such
    two rows for each of the last parts of the run, and `forward` has 1.0 for each degree of freedom with v > 0 at the
    end of the part, else 0.0: a part has the row part % PARTS. A part ends with a step index, and is longer by a
    fifth than those before together.

    The first `invariants` quantities are not evaluated after each step, see `follow.next_due`.

    `advance` is the address of the function that advances the history in p after each step, or 0. `project` is the
    address of the function that moves the state to the nearest state that satisfies the constraints, before all else,
    or 0.
    """

    table: Any
    out: Any
    extremes: Any
    steps: Any
    parts: Any
    forward: Any
    most: Any
    invariants: int = 0
    advance: int = 0
    project: int = 0


class Within(NamedTuple):
    """Where the quantities of a run with tolerances are evaluated within a step, and room for their values there.

    `points` are fractions of the step, from 0 to 1, with 1/2 in the middle. The matrix `fit` gives the coefficients of
    the polynomial in 2 s - 1 from the values there. Changes within a step of at most the part `floors[k]` of a value of
    the quantity k are not looked at. `before` has the values at the start of the next step. `samples` and `times` have
    a row for each point and one more; `c`, `state` and `coefficients` are for the coefficients of the polynomial, for u
    and v, and for the dense output.
    """

    points: Any
    fit: Any
    floors: Any
    before: Any
    samples: Any
    times: Any
    c: Any
    state: Any
    coefficients: Any


class Look(NamedTuple):
    """What a run looks for and follows; with tolerances, also within its steps."""

    watch: Any
    follow: Any
    within: Any = None


class At(NamedTuple):
    """The start of a step: its index i, the time t = t0 + i h, the step length h and the parameters p."""

    i: Any
    t: Any
    h: Any
    p: Any


class Work(NamedTuple):
    """Arguments of a method that solves equations: the counters, for n degrees of freedom an n x n matrix, and its
    second callback, such as a jacobian, or None."""

    counters: Any
    matrix: Any
    callback: Any


vector_type, matrix_type = Array(float64, 1, "C"), Array(float64, 2, "C")
row_type = Row()
_given = Array(float64, 1, "C", readonly=True)  # a callback that writes to such an array does not compile


_integers, _parts_type = Array(int64, 2, "C"), Array(float64, 3, "C")
_vector, _matrix = vector_type, matrix_type

#: The types of the records. They hold matrices in each form; for one degree of freedom, these have one column.
WATCH = types.NamedTuple((_integers, _matrix, _vector, _vector, *[_matrix] * 4), Watch)
FOLLOW = types.NamedTuple((_integers, _vector, _matrix, _matrix, _parts_type, _matrix, _vector, *[int64] * 3), Follow)
WITHIN_STEP = types.NamedTuple(
    (_vector, _matrix, _vector, _vector, _matrix, _vector, _vector, _matrix, _matrix), Within
)
LOOK = types.NamedTuple((WATCH, FOLLOW, none), Look)
LOOK_WITHIN = types.NamedTuple((WATCH, FOLLOW, WITHIN_STEP), Look)
STEPS = types.NamedTuple((float64, float64, _vector, *[int64] * 4, _matrix, _matrix), Steps)
SPAN = types.NamedTuple(
    (
        *(float64, float64, _vector, int64, int64, int64, int64, float64, float64, _matrix, int64, int64, int64),
        *(int64, float64, _vector, _vector, _matrix, _matrix),
    ),
    Span,
)


@dataclass(frozen=True, eq=False)  # each of the two forms is equal only to itself
class Form:
    """The types for one form of right-hand side: the scalar form, or the vector form for n degrees of freedom.

    An `invariant` returns its only value, as an output with one value does; an `output` writes its values. `quiet`
    looks at the events of a family: see `zeros.quiet_together`. A `constrained_step` changes u, v and the drift: it is
    a step of EIG-3 with constraints, for which there is no scalar form. A kernel has rows of n values also for one
    degree of freedom: `calls` has an element that calls a function of each kind of the scalar form with rows.
    """

    name: str
    rhs: Any
    jacobian: Any
    invariant: Any
    quiet: Any
    apply: Any
    output: Any
    constrained_step: Any
    state: Any
    calls: Mapping[str, Any]

    @property
    def event(self) -> Any:
        """The signature of the function g of an event."""
        return self.invariant

    def __reduce__(self) -> str:
        return self.name.upper()  # pickle then takes the form of this module that has this name

    @functools.cache  # noqa: B019  there are two forms
    def at(self, kind: str) -> Any:
        """Return a compiled ``function(address)``, where the function of some kind, such as "rhs", takes rows."""
        return function_at(getattr(self, kind), self.calls.get(kind))

    @functools.cache  # noqa: B019  there are two forms
    def caller(self, kind: str) -> Any:
        """Compile ``call(address, t, u, v, p)``, which calls a function of some kind from Python, or load it."""
        signature = getattr(self, kind)
        template = value_at if len(signature.args) == 4 else values_at
        with_address = signature.return_type(int64, *signature.args)
        return compile_kernel(template, {"AT": function_at(signature)}, with_address, f"{kind}_{self.name}")

    def with_rows(self, kind: str, function: Any) -> Any:
        """Return an element that calls a jitted function with rows."""
        returns = kind in ("invariant", "apply")
        call = self.calls.get(kind, value_of_arrays if returns else values_of_arrays)
        if returns:
            return element(lambda t, u, v, p: call(t, u, v, p, function))
        return element(lambda t, u, v, p, out: call(t, u, v, p, out, function))


def value_at(address, t, u, v, p):
    return AT(address)(t, u, v, p)  # noqa: F821


def values_at(address, t, u, v, p, out):
    return AT(address)(t, u, v, p, out)  # noqa: F821


@intrinsic
def array_of(typingctx, row):
    """``array_of(row)`` returns a row as an array; an array is returned as it is."""

    def codegen(context, builder, signature, args):
        return context.cast(builder, args[0], row, signature.return_type)

    return (vector_type if isinstance(row, Row) else row)(row), codegen


@element
def value_of_arrays(t, u, v, p, function):
    return function(t, array_of(u), array_of(v), p)


@element
def values_of_arrays(t, u, v, p, out, function):
    function(t, array_of(u), array_of(v), p, array_of(out))


@element
def value_of_one(t, u, v, p, function):
    return function(t, u[0], v[0], p)


@element
def acceleration_of_one(t, u, v, p, a, function):
    a[0] = function(t, u[0], v[0], p)


@element
def slope_of_one(t, u, v, p, matrix, function):
    matrix[0, 0] = function(t, u[0], v[0], p)


@element
def values_of_one(t, u, v, p, values, function):
    function(t, u[0], v[0], p, values)


@element
def state_of_one(t, u, v, p, function):
    u[0], v[0] = function(t, u[0], v[0], p)


@element
def quiet_of_one(first, count, side, counters, t, u, v, p, function):
    return function(first, count, side, counters, t, u[0], v[0], p)


_together = int64, int64, int64, vector_type  # the first arguments of `zeros.quiet_together`
SCALAR = Form(
    name="scalar",
    rhs=float64(float64, float64, float64, _given),
    jacobian=float64(float64, float64, float64, _given),
    invariant=float64(float64, float64, float64, _given),
    quiet=int64(*_together, float64, float64, float64, _given),
    apply=types.UniTuple(float64, 2)(float64, float64, float64, _given),
    output=none(float64, float64, float64, _given, vector_type),
    constrained_step=None,
    state=vector_type,
    calls={
        "rhs": acceleration_of_one,
        "jacobian": slope_of_one,
        "invariant": value_of_one,
        "output": values_of_one,
        "apply": state_of_one,
        "quiet": quiet_of_one,
    },
)
VECTOR = Form(
    name="vector",
    rhs=none(float64, _given, _given, _given, vector_type),
    jacobian=none(float64, _given, _given, _given, matrix_type),
    invariant=float64(float64, _given, _given, _given),
    quiet=int64(*_together, float64, _given, _given, _given),
    apply=none(float64, vector_type, vector_type, _given),
    output=none(float64, _given, _given, _given, vector_type),
    constrained_step=none(float64, float64, vector_type, vector_type, vector_type, _given),
    state=matrix_type,
    calls={},
)


@element
def index(x):
    """Convert a number to an index. It is unsigned, so that the compiler omits the test for negative indices."""
    return np.int64(np.uint32(x))


@intrinsic
def pointer_to(typingctx, record):
    """``pointer_to(record)`` returns the address of a copy of a record, which is valid until the kernel returns.

    A function that is not inlined gets a record by its address: it would be passed as some hundred numbers otherwise.
    """

    def codegen(context, builder, signature, args):
        return builder.ptrtoint(copy_on_stack(builder, args[0]), context.get_value_type(int64))

    return int64(record), codegen


def record_at(kind: Any) -> Any:
    """Return a compiled ``record(address)`` for a record of some type, whose fields are read when they are named."""
    located = Located(kind)

    def record(typingctx, address):
        def codegen(context, builder, signature, args):
            return builder.inttoptr(args[0], context.get_value_type(located))

        return located(int64), codegen

    record.content = str(located)  # type: ignore[attr-defined]
    return intrinsic(record)


#: Number of float64 values of an array that can hold a record.
RECORD_SIZE = 512


@intrinsic
def store_record(typingctx, memory, record):
    """``store_record(memory, record)`` copies a record to an array of `RECORD_SIZE` values, and returns its address."""

    def codegen(context, builder, signature, args):
        assert context.get_abi_sizeof(args[1].type) <= 8 * RECORD_SIZE, "RECORD_SIZE is too small for this record."
        data = parts_of(context, builder, signature.args[0], args[0]).data
        builder.store(args[1], builder.bitcast(data, args[1].type.as_pointer()))
        return builder.ptrtoint(data, context.get_value_type(int64))

    return int64(memory, record), codegen


@intrinsic
def store_at(typingctx, address, index, value):
    """``store_at(address, index, value)`` writes a float to an index of the array at an address."""

    def codegen(context, builder, signature, args):
        begin = builder.inttoptr(args[0], context.get_value_type(float64).as_pointer())
        builder.store(args[2], builder.gep(begin, [args[1]]))
        return context.get_dummy_value()

    return none(int64, int64, float64), codegen


@intrinsic(prefer_literal=True)
def rows(typingctx, state, count):
    """``rows(state, count)`` returns the first `count` rows of a 2-D array as a tuple; `count` is a literal."""
    kind = types.UniTuple(row_type, count.literal_value)

    def codegen(context, builder, signature, args):
        source = parts_of(context, builder, signature.args[0], args[0])
        n = source.shape[1]
        begins = (builder.mul(n, context.get_constant(types.intp, k)) for k in range(count.literal_value))
        values = [row_over(context, builder, builder.gep(source.data, [begin]), n) for begin in begins]
        return context.make_tuple(builder, kind, values)

    return kind(state, count), codegen


@intrinsic
def part_of_row(typingctx, state, row, first, count):
    """``part_of_row(state, row, first, count)`` returns `count` values of a row of a 2-D array, from index `first`."""

    def codegen(context, builder, signature, args):
        matrix, row, first, count = args
        source = parts_of(context, builder, signature.args[0], matrix)
        begin = builder.add(builder.mul(source.shape[1], row), first)
        return array_over(context, builder, vector_type, builder.gep(source.data, [begin]), count)

    return vector_type(state, int64, int64, int64), codegen


def array_on_stack(count: int) -> Any:
    """Return a compiled ``array()`` of `count` floats on the stack, which do not overlap with others.

    The array takes no literal number: a pickled intrinsic does not keep that it prefers literals.
    """

    def array(typingctx):
        def codegen(context, builder, signature, args):
            size = context.get_constant(types.intp, count)
            return array_over(context, builder, vector_type, floats_on_stack(builder, count), size)

        return vector_type(), codegen

    array.content = f"array of {count} floats on the stack"  # type: ignore[attr-defined]
    return intrinsic(array)


_pointer = FloatPointer()


@intrinsic(prefer_literal=True)
def pointers(typingctx, state, count):
    """``pointers(state, count)`` returns the first `count` rows of one value of a 2-D array as pointers to floats."""
    kind = types.UniTuple(_pointer, count.literal_value)

    def codegen(context, builder, signature, args):
        data = parts_of(context, builder, signature.args[0], args[0]).data
        values = [builder.gep(data, [context.get_constant(types.intp, k)]) for k in range(count.literal_value)]
        return context.make_tuple(builder, kind, values)

    return kind(state, count), codegen


@intrinsic(prefer_literal=True)
def stack_floats(typingctx, n, count):
    """``stack_floats(1, count)`` returns a tuple of `count` floats on the stack, which LLVM keeps in registers."""
    kind = types.UniTuple(_pointer, count.literal_value)

    def codegen(context, builder, signature, args):
        return context.make_tuple(builder, kind, [floats_on_stack(builder, 1) for _ in range(count.literal_value)])

    return kind(n, count), codegen


@intrinsic(prefer_literal=True)
def stack_rows(typingctx, n, count):
    """``stack_rows(n, count)`` returns a tuple of `count` rows of n values on the stack; both are literals.

    After LLVM has unrolled the loops over n, it keeps these rows in registers.
    """
    kind = types.UniTuple(row_type, count.literal_value)

    def codegen(context, builder, signature, args):
        size = context.get_constant(types.intp, n.literal_value)
        values = []
        for _ in range(count.literal_value):
            values.append(row_over(context, builder, floats_on_stack(builder, n.literal_value), size))
        return context.make_tuple(builder, kind, values)

    return kind(n, count), codegen


@intrinsic(prefer_literal=True)
def copy_rows(typingctx, target, source, n):
    """``copy_rows(target, source, n)`` copies n values of each row of `source` to the rows of `target`; n is a literal.

    All values are read before the first is written, so `source` may hold the rows of `target` in another order.
    """

    def codegen(context, builder, signature, args):
        def places(rows: Any) -> list[Any]:
            arrays = entries_of(builder, rows, len(target))
            is_pointer = target.dtype == _pointer
            data = arrays if is_pointer else [parts_of_row(builder, row)[0] for row in arrays]
            return [builder.gep(d, [context.get_constant(types.intp, j)]) for d in data for j in range(n.literal_value)]

        values = [builder.load(place) for place in places(args[1])]
        for value, place in zip(values, places(args[0]), strict=True):
            builder.store(value, place)
        return context.get_dummy_value()

    return none(target, source, n), codegen


@intrinsic
def row_index(typingctx, row, state):
    """``row_index(row, state)`` returns which row of a 2-D array a `Row` is."""

    def codegen(context, builder, signature, args):
        array = parts_of(context, builder, state, args[1])
        places = parts_of_row(builder, args[0])[0], array.data
        begin, origin = (builder.ptrtoint(place, context.get_value_type(types.intp)) for place in places)
        return builder.sdiv(builder.sub(begin, origin), array.strides[0])

    return int64(row, state), codegen


#: ``look_at(address)`` returns the `Look` at an address, without `within`, and ``look_within_at(address)`` with it.
look_at, look_within_at = record_at(LOOK), record_at(LOOK_WITHIN)

#: ``steps_at(address)`` and ``span_at(address)`` return the `Steps` and the `Span` at an address.
steps_at, span_at = record_at(STEPS), record_at(SPAN)
