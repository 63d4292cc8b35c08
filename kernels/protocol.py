"""The interface of kernels, marches and callbacks: their signatures, and functions for the rows of a state."""

from dataclasses import dataclass
from typing import Any, NamedTuple

from numba import types
from numba.extending import intrinsic
from numba.types import Array, float64, int64, none

from .compile.numba_internals import array_over, entries_of, floats_on_stack, function_over, parts_of

#: The entries of a kernel's `tally`: two counts, and the residual and the degree of freedom of a failed solve.
EVALUATIONS, ITERATIONS, RESIDUAL, DEGREE = range(4)

#: Further entries for a run with events or tolerances: the time, the next step and the step before, the logarithm of
#: the last error, the number of rejected steps, the largest |u| and |v| so far, the next of `Watch.times`, the number
#: of occurrences in the log, the index of the step at which a multistep method started anew, the time between the last
#: two resets, the event that ended the run, and 1 if a call ended within a fixed step because the log was full.
TIME, STEP, STEP_BEFORE, ERROR, REJECTED, U_SIZE, V_SIZE = range(4, 11)
NEXT, LOGGED, ANEW, GAP, ENDED_BY, WITHIN = range(11, 17)

#: Further entries for a run with tolerances: 1 if the length of the span decided about a step before its last one; the
#: longest step in which nothing acted, and the time of its end.
BY_SPAN, SILENT_STEP, SILENT_END = range(17, 20)

#: Four values follow for each event: the sign of g, where 0 means that it is looked at just after the start of the
#: next step; the time of its last reset; the sign of g before this reset, if it left g at zero, or else 0; and g after
#: it.
EVENTS, EVENT_VALUES = 20, 4


class Run(NamedTuple):
    """The steps to take: `count` steps from step index `first`. Every `every`-th state is written to the rows."""

    h: Any
    t0: Any
    p: Any
    first: Any
    count: Any
    every: Any
    u_rows: Any
    v_rows: Any


class Span(NamedTuple):
    """The steps of variable length to take: at most `count` from step index `first`, to `t_end` at most.

    The run began at `t0`.

    Every `every`-th state is written to the rows, and `atol` has a row for u and one for v. If `is_relative` is 1,
    `rtol` is relative to the largest value so far of each degree of freedom whose `atol` is finite. If `may_shorten` is
    0, a step that reaches the end is not taken. If `reads_time` is 1, the force may change though nothing moves. If
    `dense` has rows, the dense output of each step is written to the row of its end; `every` is 1 then.
    """

    t0: Any
    t_end: Any
    p: Any
    first: Any
    count: Any
    every: Any
    h_max: Any
    rtol: Any
    atol: Any
    is_relative: Any
    may_shorten: Any
    reads_time: Any
    t_rows: Any
    h_rows: Any
    u_rows: Any
    v_rows: Any
    dense: Any


class Watch(NamedTuple):
    """What a run looks for within its steps: events, and times at which the state is written.

    A row of `events` contains the address of g, the address of apply or 0, the direction, and 1 for a terminal event.
    A row of `log` is for an occurrence: the event, the time, and u and v before and after apply. Resets that follow
    each other within `zeno` end the run. `times` are the times at which to write u, v and the step. `work` has rows of
    n values, which callbacks may get, and `search` has four rows with a value for each event.
    """

    events: Any
    log: Any
    zeno: Any
    times: Any
    h_rows: Any
    u_rows: Any
    v_rows: Any
    work: Any
    search: Any


class At(NamedTuple):
    """The start of a step: its index i, the time t = t0 + i h, the step length h and the parameters p."""

    i: Any
    t: Any
    h: Any
    p: Any


class Work(NamedTuple):
    """Arguments of a method that solves equations: the tally, for n degrees of freedom an n x n matrix, and the
    jacobian or None. (If the jacobian were first, Numba would warn that tuples of functions are experimental.)"""

    tally: Any
    matrix: Any
    jacobian: Any


vector_type, matrix_type = Array(float64, 1, "C"), Array(float64, 2, "C")
_given = Array(float64, 1, "C", readonly=True)  # a callback that writes to such an array does not compile


_integers = Array(int64, 2, "C")

#: The types of `Watch` and `Span`. Both hold matrices in each form; for one degree of freedom, these have one column.
WATCH = types.NamedTuple((_integers, matrix_type, float64, *(vector_type,) * 2, *(matrix_type,) * 4), Watch)
SPAN = types.NamedTuple(
    (
        *(float64, float64, vector_type, int64, int64, int64, float64, float64, matrix_type, int64, int64, int64),
        *(vector_type, vector_type, matrix_type, matrix_type, Array(float64, 3, "C")),
    ),
    Span,
)


@dataclass(frozen=True, eq=False)  # each of the two forms is equal only to itself
class Form:
    """The types for one form of right-hand side: the scalar form, or the vector form for n degrees of freedom.

    An `invariant` returns its only value, as an output with one value does; an `output` writes its values.
    """

    name: str
    rhs: Any
    jacobian: Any
    invariant: Any
    apply: Any
    output: Any
    state: Any

    @property
    def event(self) -> Any:
        """The signature of the function g of an event."""
        return self.invariant

    def __reduce__(self) -> str:
        return self.name.upper()  # pickle then takes the form of this module that has this name

    @property
    def run(self) -> Any:
        """The type of `Run`."""
        return types.NamedTuple((float64, float64, vector_type, int64, int64, int64, self.state, self.state), Run)


SCALAR = Form(
    name="scalar",
    rhs=float64(float64, float64, float64, _given),
    jacobian=float64(float64, float64, float64, _given),
    invariant=float64(float64, float64, float64, _given),
    apply=types.UniTuple(float64, 2)(float64, float64, float64, _given),
    output=none(float64, float64, float64, _given, vector_type),
    state=vector_type,
)
VECTOR = Form(
    name="vector",
    rhs=none(float64, _given, _given, _given, vector_type),
    jacobian=none(float64, _given, _given, _given, matrix_type),
    invariant=float64(float64, _given, _given, _given),
    apply=none(float64, vector_type, vector_type, _given),
    output=none(float64, _given, _given, _given, vector_type),
    state=matrix_type,
)


def function_at(signature: Any) -> Any:
    """Return a compiled ``function(address)`` that converts the address of a compiled callback to the callback.

    An address is a plain integer. If a callback were passed as an object, each call of a kernel would take some ten
    microseconds more, because Numba would look up its address.
    """
    kind = types.FunctionType(signature)

    @intrinsic
    def function(typingctx, address):
        def codegen(context, builder, signature, args):
            return function_over(context, builder, kind, args[0])

        return kind(int64), codegen

    return function


@intrinsic(prefer_literal=True)
def floats(typingctx, state, count):
    """``floats(state, count)`` returns the first `count` numbers of a 1-D array as a tuple; `count` is a literal."""
    kind = types.UniTuple(float64, count.literal_value)

    def codegen(context, builder, signature, args):
        source = parts_of(context, builder, signature.args[0], args[0])
        indices = [context.get_constant(types.intp, k) for k in range(count.literal_value)]
        values = [builder.load(builder.gep(source.data, [index])) for index in indices]
        return context.make_tuple(builder, kind, values)

    return kind(state, count), codegen


@intrinsic(prefer_literal=True)
def rows(typingctx, state, count):
    """``rows(state, count)`` returns the first `count` rows of a 2-D array as a tuple; `count` is a literal."""
    kind = types.UniTuple(vector_type, count.literal_value)

    def codegen(context, builder, signature, args):
        source = parts_of(context, builder, signature.args[0], args[0])
        n = source.shape[1]
        begins = (builder.mul(n, context.get_constant(types.intp, k)) for k in range(count.literal_value))
        values = [_array(context, builder, builder.gep(source.data, [begin]), n) for begin in begins]
        return context.make_tuple(builder, kind, values)

    return kind(state, count), codegen


@intrinsic(prefer_literal=True)
def stack_rows(typingctx, n, count):
    """``stack_rows(n, count)`` returns a tuple of `count` arrays of n values on the stack; both are literals.

    After LLVM has unrolled the loops over n, it keeps these arrays in registers.
    """
    kind = types.UniTuple(vector_type, count.literal_value)

    def codegen(context, builder, signature, args):
        size = context.get_constant(types.intp, n.literal_value)
        values = []
        for _ in range(count.literal_value):
            values.append(_array(context, builder, floats_on_stack(builder, n.literal_value), size))
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
            data = [parts_of(context, builder, vector_type, array).data for array in arrays]
            return [builder.gep(d, [context.get_constant(types.intp, j)]) for d in data for j in range(n.literal_value)]

        values = [builder.load(place) for place in places(args[1])]
        for value, place in zip(values, places(args[0]), strict=True):
            builder.store(value, place)
        return context.get_dummy_value()

    return none(target, source, n), codegen


@intrinsic
def row_index(typingctx, row, state):
    """``row_index(row, state)`` returns the number of the row of a 2-D array that is the 1-D array `row`."""

    def codegen(context, builder, signature, args):
        arrays = [parts_of(context, builder, kind, x) for kind, x in zip(signature.args, args, strict=True)]
        begin, origin = (builder.ptrtoint(array.data, context.get_value_type(types.intp)) for array in arrays)
        return builder.sdiv(builder.sub(begin, origin), arrays[1].strides[0])

    return int64(row, state), codegen


def _array(context: Any, builder: Any, data: Any, n: Any) -> Any:
    """Return a contiguous 1-D array over memory without reference counting."""
    return array_over(context, builder, vector_type, data, n, context.get_constant(types.intp, 8))
