"""All that this library uses of Numba beyond what Numba documents, and all that it uses of llvmlite.

A new version of Numba may change any of it. So no other file imports `numba.core`, `numba.np` or llvmlite, or names an
inner part of Numba's objects. `tests/test_numba_internals.py` calls each function of this file by itself, and says what
has changed in Numba. Other files use the top level of Numba, `numba.types`, `numba.extending`, and the documented
methods of jitted functions, such as `recompile`.
"""

from __future__ import annotations

import functools
import gc
import importlib.util
import itertools
import operator
import os
import pickle
import re
import sys
from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite
import llvmlite.binding as llvm
import numba
import numpy as np
from llvmlite import ir
from numba import cloudpickle
from numba.core import cgutils, event
from numba.core import ir as numba_ir
from numba.core.base import BaseContext
from numba.core.bytecode import FunctionIdentity
from numba.core.caching import FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.compiler_lock import global_compiler_lock
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.dispatcher import Dispatcher as Jitted  # the class of jitted functions
from numba.core.errors import ConstantInferenceError
from numba.core.ir_utils import build_definitions
from numba.core.postproc import PostProcessor, VariableLifetime
from numba.core.registry import CPUDispatcher, cpu_target
from numba.core.targetconfig import ConfigStack, TargetConfig
from numba.core.transforms import canonicalize_cfg
from numba.core.types.functions import BaseFunction
from numba.core.typing import signature as signature_of
from numba.core.typing.templates import AttributeTemplate
from numba.core.untyped_passes import InlineInlinables
from numba.extending import (
    infer_getattr,
    intrinsic,
    lower_builtin,
    lower_cast,
    lower_getattr_generic,
    models,
    register_model,
    type_callable,
)
from numba.np import arrayobj

#: The versions on which compiled code depends.
VERSIONS = numba.__version__, llvmlite.__version__

#: The changes to Numba's code and stack in use. Each saves time only: the environment variable leaves some out, or all.
PATCHES = frozenset(
    os.environ.get("EIG3_NUMBA_PATCHES", "frames loading operators flags lifetimes linked vectors").split()
)

# Jitted functions, and Numba's compile result for each tuple of types of their arguments

#: ``compile_results(function)``: a jitted function's dict of compile results by the types of the arguments. It is not a
#: Python function because each run calls it. Its `values` method hashes every type; `dict.values` does not.
compile_results = operator.attrgetter("overloads")


def compile_for(function: Jitted, arguments: tuple) -> None:
    """Compile a jitted function for types of arguments, or load it from its cache."""
    with (
        _without_collections(),
        _replaced("operators", BaseFunction, "get_call_type", _with_memory),
        _replaced("flags", TargetConfig, "values", lambda usual: _values_of),
        _replaced("lifetimes", PostProcessor, "run", _without_entry_variables),
    ):
        _load_numbas_functions()
        _in_one_block(function.compile, arguments)


def _in_one_block(call: Callable, *arguments: Any) -> None:
    """Call a function, such that all calls within it have their frames in one block of memory.

    From version 3.11 on, Python's frames are in blocks of 16 KiB. Where a loop is at the end of a block, each call in
    it asks the system for a further block, and returns it. The calls of a compiler reach the ends of many blocks: it
    would take 5 to 15 % longer, depending on the depth of the call. Here, a frame of 1 MiB of which nothing is used
    gets a block of 2 MiB.
    """
    call(*arguments)


if "frames" in PATCHES and sys.version_info >= (3, 11):
    _in_one_block.__code__ = _in_one_block.__code__.replace(co_stacksize=2**17)


@functools.cache
def _load_numbas_functions() -> None:
    """Let Numba load its functions in half the usual time. A first run from compiled code does little else."""
    linalg = importlib.import_module("numba.np.linalg")
    with (
        _replaced("loading", linalg, "ensure_blas", lambda usual: _find_scipy),
        _replaced("loading", BaseContext, "refresh", _not_within_itself),
    ):
        cpu_target.target_context.refresh()


def _find_scipy() -> None:
    """Let Numba know whether it can compile products of matrices; it imports SciPy where it compiles one."""
    if importlib.util.find_spec("scipy") is None:
        raise ImportError("there is no SciPy")


def _not_within_itself(usual: Callable) -> Callable:
    """Let Numba not look for new functions while it does: it would for each of some 250 functions."""
    within: set[Any] = set()

    def refresh(context: Any) -> None:
        if context not in within:
            within.add(context)
            usual(context)
            within.discard(context)

    return refresh


@contextmanager
def _without_collections() -> Iterator[None]:
    """A block in which Python does not look for cycles of objects to free.

    The compiler makes so many objects, most of which stay, that this search takes an eighth of its time.
    """
    with global_compiler_lock:
        was_enabled = gc.isenabled()
        gc.disable()
        try:
            yield
        finally:
            if was_enabled:
                gc.enable()


@contextmanager
def _replaced(patch: str, owner: Any, name: str, replace: Callable) -> Iterator[None]:
    """A block in which a function of Numba is `replace` of itself, if this patch is in use."""
    if patch not in PATCHES:
        yield
        return
    with global_compiler_lock:
        usual = getattr(owner, name)
        setattr(owner, name, replace(usual))
        try:
            yield
        finally:
            setattr(owner, name, usual)


def _with_memory(usual: Callable) -> Callable:
    """Let Numba remember the type of an operation, such as the product of two floats.

    Otherwise it looks for the type among all its overloads of the operator, several times for each operation in the
    source. With this search, a kernel takes an eighth to a third longer to compile. A module that adds overloads makes
    new operators, which remember nothing.
    """

    def get_call_type(operator: Any, context: Any, args: tuple, options: Any) -> Any:
        if options or operator.typing_key not in _OPERATORS or not all(isinstance(x, _PLAIN) for x in args):
            return usual(operator, context, args, options)
        known = vars(operator).setdefault("known_to_eig3", {})
        if args not in known:
            known[args] = usual(operator, context, args, options)
        return known[args]

    return get_call_type


def _values_of(flags: Any) -> dict[str, Any]:
    """Return the values of all flags of the compiler: the defaults, with what was set in their places.

    Numba compares them each time it looks for the type of a call. Its own `values` asks for each flag by name, which
    takes 3 % of the time of the compiler.
    """
    return {**_defaults_of(flags.__class__), **flags._values}


@functools.cache
def _defaults_of(kind: Any) -> dict[str, Any]:
    return {name: option.default for name, option in kind.options.items()}


def _without_entry_variables(usual: Callable) -> Callable:
    """Do not let Numba find the variables that live at the entry of each block, which only Python objects need.

    Numba finds them after each change of a function, which takes some six per cent of the time of the compiler.
    """

    def run(processor: Any, emit_dels: bool = False, extend_lifetimes: bool = False) -> None:
        flags, function = ConfigStack.top_or_none(), processor.func_ir
        if flags is None or flags.enable_pyobject or flags.force_pyobject or function.is_generator:
            usual(processor, emit_dels, extend_lifetimes)
            return
        function.blocks = canonicalize_cfg(function.blocks)
        function.variable_lifetime, function.generator_info = VariableLifetime(function.blocks), None
        if emit_dels:
            processor._insert_var_dels(extend_lifetimes=extend_lifetimes)

    return run


_OPERATORS = frozenset(x for x in vars(operator).values() if callable(x))


def jitted_of(kind: Any) -> Jitted:
    """Return the jitted function whose type in compiled code is `kind`."""
    return kind.dispatcher


def options_of(function: Jitted) -> Mapping[str, Any]:
    """Return the options of `numba.njit` with which a function was jitted."""
    return function.targetoptions


def return_type(result: Any) -> Any:
    """Return the type that the function of a compile result returns."""
    return result.signature.return_type


def call_without_checks(result: Any) -> Callable:
    """Return a function that calls machine code from Python, and does not check the types of the arguments."""
    return result.entry_point


def address_of(result: Any) -> int:
    """Return the address of the machine code that compiled functions call. The compile result keeps it alive."""
    address = result.library.get_pointer_to_function(result.fndesc.llvm_func_name)
    if not address:
        raise TypeError(f"{result.fndesc.qualname} has no machine code: give a jitted function that calls it.")
    return address


def optimised_code(result: Any) -> str:
    """Return LLVM's code of a compile result, after its optimisation."""
    return result.library.get_llvm_str()


# How a function is compiled

#: Option of `numba.njit`: code without Numba's runtime, which counts references to arrays.
WITHOUT_RUNTIME = {"_nrt": False}


#: Options of `numba.njit`: code without the functions that make calls from C, or from Python too. Each is compiled.
WITHOUT_C_WRAPPER: dict[str, Any] = {"no_cfunc_wrapper": True}
WITHOUT_WRAPPERS: dict[str, Any] = {"no_cpython_wrapper": True, **WITHOUT_C_WRAPPER}


class _Linked(JITCodeLibrary):
    """The code of a function that is only linked into the code of others.

    LLVM optimises it there, and translates it to machine code there. Without this class Numba does both for each of the
    functions, and again for each function that calls it: a kernel would take 1.5 to 2 times as long to compile.
    """

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        return 0

    @property
    def codegen(self) -> Any:
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """Do nothing: what Python objects a function needs is for the code that calls it from Python."""


_HALF_POWERS = {sign * (k + 0.5) for sign in (1, -1) for k in range(4)}


@register_pass(mutates_CFG=False, analysis_only=False)
class _HalfPowers(FunctionPass):
    """Write powers such as ``x ** 1.5`` and ``x ** -0.5`` as products with a square root.

    LLVM leaves them to `pow`, which takes some 18 ns: as long as a step of Kepler's orbit. The root, each product and
    the quotient are rounded once: an error of half an ulp, which may be one ulp of the result. Zero, infinity and NaN
    give what `pow` gives. But minus infinity gives NaN, minus zero may give minus infinity, and with a negative
    exponent a result below the smallest normal number may be zero, because the product overflows before.
    """

    _name = "half_powers"

    def __init__(self) -> None:
        FunctionPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        found = False
        for block in state.func_ir.blocks.values():
            body = []
            for statement in block.body:
                exponent = self._exponent(state.func_ir, statement)
                body += [statement] if exponent is None else _root(block.scope, statement, exponent)
                found = found or exponent is not None
            block.body = body
        if found:
            state.func_ir._definitions = build_definitions(state.func_ir.blocks)
        return found

    @staticmethod
    def _exponent(func_ir: Any, statement: Any) -> float | None:
        """Return the exponent of a statement that is such a power."""
        if not isinstance(statement, numba_ir.Assign) or not isinstance(statement.value, numba_ir.Expr):
            return None
        power = statement.value
        if power.op not in ("binop", "inplace_binop") or power.fn not in (operator.pow, operator.ipow):
            return None
        try:
            exponent = func_ir.infer_constant(power.rhs)
        except ConstantInferenceError:
            return None
        return exponent if type(exponent) is float and exponent in _HALF_POWERS else None


def _root(scope: Any, statement: Any, exponent: float) -> list[Any]:
    """Return the statements of a power whose exponent is half an odd number."""
    x, loc, statements = statement.value.lhs, statement.loc, []

    def assign(value: Any, target: Any = None) -> Any:
        target = target or scope.redefine("$root", loc)
        statements.append(numba_ir.Assign(value, target, loc))
        return target

    def product(a: Any, b: Any) -> Any:
        return numba_ir.Expr.binop(operator.mul, a, b, loc)

    root = numba_ir.Expr.call(assign(numba_ir.Global("sqrt", np.sqrt, loc)), (x,), (), loc)
    for _ in range(int(abs(exponent))):
        root = product(x, assign(root))
    if exponent < 0:
        one = assign(numba_ir.Const(1.0, loc))
        root = numba_ir.Expr.binop(operator.truediv, one, assign(root), loc)
    assign(root, statement.target)
    return statements


class _RootCompiler(Compiler):
    """Numba's compiler with `_HalfPowers`."""

    def define_pipelines(self) -> list[Any]:
        pipelines = super().define_pipelines()
        for pipeline in pipelines:
            pipeline.add_pass_after(_HalfPowers, InlineInlinables)
            pipeline.finalize()
        return pipelines


#: The options of `numba.njit` with which half-integer powers become roots.
WITH_ROOTS: dict[str, Any] = {"pipeline_class": _RootCompiler}


class _LinkedCompiler(_RootCompiler):
    kind: type[JITCodeLibrary] = _Linked

    def __init__(self, typing: Any, target: Any, library: Any, *others: Any) -> None:
        library = self.kind(target.codegen(), self.kind.__name__)
        library.enable_object_caching()
        super().__init__(typing, target, library, *others)


class _NamedFunction(CPUDispatcher):
    """A jitted function of a module, which is pickled by its name, as Python's functions are.

    Numba would pickle its code without its options and its cache. Then functions that call it would round differently
    in another process.
    """

    def __reduce__(self) -> Any:
        module, name = self.py_func.__module__, self.py_func.__qualname__
        is_found = getattr(sys.modules.get(module), name, None) is self
        return (_named, (module, name)) if is_found else super().__reduce__()


def _named(module: str, name: str) -> Any:
    return getattr(importlib.import_module(module), name)


def _unkept(function: Jitted) -> Jitted:
    """Return a function that is compiled in each process: it gets no cache."""
    return function


class _BareFunction(CPUDispatcher):
    """A jitted function whose code only compiled functions can call. For calls from Python, it is compiled once more.

    The code that converts arguments of Python takes a tenth to a quarter of the time to compile a function.
    """

    keep: Callable = staticmethod(_unkept)
    origin: tuple | None = None  # what pickles the function in place of its code

    def __reduce__(self) -> Any:
        return self.origin or super().__reduce__()

    def _reduce_states(self) -> dict[str, Any]:
        """Return what Numba pickles, with what it leaves out: the compiler, and how the function gets its cache."""
        own = {"keep": self.keep, "is_kept": isinstance(self._cache, DiskCache)}
        return {**super()._reduce_states(), **own, "pipeline_class": self._compiler.pipeline_class}

    @classmethod
    def _rebuild(cls, keep: Callable, is_kept: bool, pipeline_class: Any, **states: Any) -> Any:
        if states["uuid"] in cls._memo:
            return super()._rebuild(**states)
        self = super()._rebuild(**states)
        self.keep, self._compiler.pipeline_class = keep, pipeline_class
        return keep(self) if is_kept else self

    @functools.cached_property
    def for_python(self) -> Jitted:
        left_out = "nopython", *WITHOUT_WRAPPERS
        options = {k: value for k, value in self.targetoptions.items() if k not in left_out}
        return self.keep(numba.njit(**options, **WITH_ROOTS)(self.py_func))

    def __call__(self, *args: Any, **options: Any) -> Any:
        """Call the function; named parameters become what it gets in a run."""
        args = tuple(x._as_argument_of(self) if hasattr(x, "_as_argument_of") else x for x in args)
        return self.for_python(*args, **options)

    def get_compile_result(self, sig: Any) -> Any:
        """Return the code for calls by a pointer, such as an argument of Numba's type `FunctionType`."""
        return self.for_python.get_compile_result(sig)

    def recompile(self) -> None:
        """Compile the function again, with the present values of global variables; calls from Python get these too."""
        self.__dict__.pop("for_python", None)
        super().recompile()


class _LinkedFunction(_NamedFunction, _BareFunction):
    """A jitted function that has machine code only in the functions that call it."""


def bare_jit(function: Callable, keep: Callable = _unkept, **options: Any) -> Jitted:
    """Return a jitted function that is compiled without the code for calls from Python, and goes through `keep`."""
    jitted = numba.njit(**{**WITHOUT_WRAPPERS, **options})(function)
    jitted.__class__, jitted.keep = _BareFunction, keep
    return keep(jitted)


def code_of(function: Jitted) -> Jitted:
    """Return the jitted function that has the machine code of a jitted function, for types of arguments."""
    return function.for_python if isinstance(function, _LinkedFunction) else function


def linked_jit(function: Callable, keep: Callable = _unkept, **options: Any) -> Jitted:
    """Return a jitted function for compiled functions: it has machine code only in those that call it.

    What is compiled for calls from Python goes through `keep`.
    """
    if "linked" not in PATCHES:
        jitted = numba.njit(**options)(function)
        jitted.__class__ = _NamedFunction
        return jitted
    jitted = numba.njit(**{**WITHOUT_WRAPPERS, **options, "pipeline_class": _LinkedCompiler})(function)
    jitted.__class__, jitted.keep = _LinkedFunction, keep
    return jitted


def is_linked(function: Jitted) -> bool:
    """Return whether a jitted function comes from `linked_jit`."""
    return isinstance(function, _NamedFunction)


def assume_no_overlap(function: Jitted) -> Jitted:
    """Let the compiler assume that no two arrays of the arguments overlap, and return the function."""

    def customize(flags: Any) -> Any:
        flags.noalias = True
        return flags

    function._compiler._customize_flags = customize  # njit has no option for this
    return function


def has_wide_vectors() -> bool:
    """Return whether code is compiled for vectors of 512 bits."""
    return "vectors" in PATCHES and "+avx512f" in _codegen()._tm_features.split(",")


@contextmanager
def wide_vectors() -> Iterator[None]:
    """A block in which Numba compiles for the widest vectors that the processor has.

    For many processors with AVX-512, LLVM prefers vectors of 256 bits, because the first of them lowered their
    frequency for wider ones. Loops over the lanes of a block do little else than compute vectors: they gain a quarter.
    """
    if not has_wide_vectors():
        yield
        return
    codegen = _codegen()
    with global_compiler_lock:
        options: dict[str, Any] = {"opt": 3}
        codegen._customize_tm_options(options)
        options["features"] = f"{options['features']},-prefer-256-bit"
        usual = codegen._tm
        codegen._tm = llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine(**options)
        try:
            yield
        finally:
            codegen._tm = usual


def _codegen() -> Any:
    return cpu_target.target_context.codegen()


@contextmanager
def compilations() -> Iterator[list[Jitted]]:
    """A block after which a list has the jitted functions that Numba compiled in it, without those from a cache."""
    functions: list[Jitted] = []
    with event.install_recorder("numba:compile") as recorder:
        yield functions
    functions += [each.data["dispatcher"] for _, each in recorder.buffer if each.is_start]


# Values in the code of an intrinsic


class ArrayParts(NamedTuple):
    """The address of an array's first entry, its sizes, and its strides in bytes."""

    data: Any
    shape: Sequence[Any]
    strides: Sequence[Any]


def parts_of(context: Any, builder: Any, kind: Any, array: Any) -> ArrayParts:
    """Return the parts of an array of the type `kind`."""
    parts = arrayobj.make_array(kind)(context, builder, array)
    shape, strides = (entries_of(builder, values, kind.ndim) for values in (parts.shape, parts.strides))
    return ArrayParts(parts.data, shape, strides)


def array_over(context: Any, builder: Any, kind: Any, data: Any, n: Any, stride: Any = None) -> Any:
    """Return a 1-D array of n numbers over memory, without reference counting.

    Without a stride in bytes, the numbers are neighbours.
    """
    array = arrayobj.make_array(kind)(context, builder)
    itemsize = context.get_constant(numba.types.intp, kind.dtype.bitwidth // 8)
    strides = [itemsize if stride is None else stride]
    arrayobj.populate_array(array, data=data, shape=[n], strides=strides, itemsize=itemsize, meminfo=None)
    return array._getvalue()


def part_of_array(name: str) -> Any:
    """Return a compiled ``part(array, begin, sizes)``: numbers in a 1-D array of floats, from an index on.

    They are read as numbers of the type of this name. References are not counted: with views of Numba, the counting
    takes longer than most right-hand sides.
    """
    dtype, size_type = getattr(numba.types, name), numba.types.intp

    def part(typingctx, array, begin, sizes):  # type: ignore[no-untyped-def]
        if dtype.bitwidth < 64 and array.layout != "C":
            raise numba.TypingError("lanes read a sparse matrix only from parameters that all members share")
        kind = numba.types.Array(dtype, len(sizes), array.layout, readonly=not array.mutable)

        def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
            source, itemsize = (
                parts_of(context, builder, signature.args[0], args[0]),
                context.get_constant(size_type, dtype.bitwidth // 8),
            )
            shape = entries_of(builder, args[2], len(sizes))
            strides = [itemsize if dtype.bitwidth < 64 else source.strides[0]]
            for size in reversed(shape[1:]):
                strides.insert(0, builder.mul(strides[0], size))
            begins = builder.add(
                builder.ptrtoint(source.data, strides[0].type), builder.mul(args[1], source.strides[0])
            )
            array_of = arrayobj.make_array(kind)(context, builder)
            data = builder.inttoptr(begins, array_of.data.type)
            arrayobj.populate_array(array_of, data, shape, strides, itemsize, meminfo=None)
            return array_of._getvalue()

        return kind(array, size_type, numba.types.UniTuple(size_type, len(sizes))), codegen

    part.content = f"part {name}"  # type: ignore[attr-defined]
    return intrinsic(part)


@intrinsic
def flat(typingctx, array):  # type: ignore[no-untyped-def]
    """``flat(array)``: the numbers of a contiguous array in one row, without the call of `reshape`."""
    kind = numba.types.Array(array.dtype, 1, "C", readonly=not array.mutable)

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        source = parts_of(context, builder, signature.args[0], args[0])
        return array_over(context, builder, kind, source.data, functools.reduce(builder.mul, source.shape))

    return kind(array), codegen


def floats_on_stack(builder: Any, n: int) -> Any:
    """Return the address of n floats on the stack of the function."""
    with builder.goto_entry_block():
        memory = builder.alloca(ir.ArrayType(ir.DoubleType(), n))
    return builder.bitcast(memory, ir.DoubleType().as_pointer())


class FloatPointer(numba.types.Type):
    """The type of the address of a float, which is used as an array of one value, with any index.

    The code of an array has its size and stride, and what an index below zero means: pointers compile in less time.
    """

    dtype = numba.types.float64

    def __init__(self) -> None:
        super().__init__("FloatPointer")


class Strip(numba.types.Type):
    """The type of the address of `count` neighbouring numbers, which is used as an array, with an index from zero on.

    It compiles in less time, as a `FloatPointer` does. A function that takes an array of floats gets one if the
    count is known.
    """

    def __init__(self, count: int | None, dtype: Any = numba.types.float64) -> None:
        self.count, self.dtype = count, dtype
        super().__init__(f"Strip({count}, {dtype})")


class Row(numba.types.Type):
    """The type of the address of a row's first float, and of their number n, which is used as an array with an index.

    It compiles in less time, as a `FloatPointer` does. A function that takes an array gets one.
    """

    dtype = numba.types.float64

    def __init__(self) -> None:
        super().__init__("Row")


class Located(numba.types.Type):
    """The type of the address of a record, a NamedTuple, of which a field is read when it is named.

    A record as a value is some hundred numbers, which the compiler moves about. A field that is a record is located.
    """

    def __init__(self, record: Any) -> None:
        self.record = record
        super().__init__(f"Located({record})")

    def field(self, name: str) -> tuple[int, Any]:
        """Return the place of a field, and its type in the record."""
        index = self.record.fields.index(name)
        return index, self.record.types[index]


_INDEXED = FloatPointer, Strip, Row
_PLAIN = numba.types.Number, numba.types.Boolean, numba.types.Array, numba.types.BaseTuple, *_INDEXED


@register_model(FloatPointer)
@register_model(Strip)
class _PointerModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: FloatPointer | Strip) -> None:
        super().__init__(manager, kind, manager[kind.dtype].get_data_type().as_pointer())


@register_model(Row)
class _RowModel(models.StructModel):
    def __init__(self, manager: Any, kind: Row) -> None:
        super().__init__(manager, kind, [("data", FloatPointer()), ("n", numba.types.intp)])


@register_model(Located)
class _LocatedModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Located) -> None:
        super().__init__(manager, kind, manager[kind.record].get_value_type().as_pointer())


@infer_getattr
class _FieldOfLocated(AttributeTemplate):
    key = Located

    def generic_resolve(self, kind: Located, name: str) -> Any:
        field = kind.field(name)[1]
        return Located(field) if isinstance(field, numba.types.NamedTuple) else field


@lower_getattr_generic(Located)
def _field_of_located(context: Any, builder: Any, kind: Located, value: Any, name: str) -> Any:
    index, field = kind.field(name)
    place = cgutils.gep_inbounds(builder, value, 0, index)
    return place if isinstance(field, numba.types.NamedTuple) else builder.load(place)


@type_callable(operator.getitem)
def _type_of_entry(context: Any) -> Callable:
    def typer(values: Any, index: Any) -> Any:
        return values.dtype if isinstance(values, _INDEXED) else None

    return typer


@type_callable(operator.setitem)
def _type_of_change(context: Any) -> Callable:
    def typer(values: Any, index: Any, value: Any) -> Any:
        return signature_of(numba.types.none, values, index, values.dtype) if isinstance(values, _INDEXED) else None

    return typer


@lower_builtin(operator.getitem, FloatPointer, numba.types.Integer)
def _entry(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    return builder.load(args[0])


@lower_builtin(operator.setitem, FloatPointer, numba.types.Integer, numba.types.float64)
def _change(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    builder.store(args[2], args[0])
    return context.get_dummy_value()


@lower_builtin(operator.getitem, Strip, numba.types.Integer)
def _entry_of_strip(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    return builder.load(builder.gep(args[0], [args[1]]))


@lower_builtin(operator.setitem, Strip, numba.types.Integer, numba.types.Number)
def _change_of_strip(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    builder.store(args[2], builder.gep(args[0], [args[1]]))
    return context.get_dummy_value()


@lower_builtin(operator.getitem, Row, numba.types.Integer)
def _entry_of_row(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    return builder.load(_place_in_row(context, builder, *args))


@lower_builtin(operator.setitem, Row, numba.types.Integer, numba.types.float64)
def _change_of_row(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    row, index, value = args
    builder.store(value, _place_in_row(context, builder, row, index))
    return context.get_dummy_value()


def _place_in_row(context: Any, builder: Any, row: Any, index: Any) -> Any:
    data, n = parts_of_row(builder, row)
    if context.enable_boundscheck:
        cgutils.do_boundscheck(context, builder, index, n)
    return builder.gep(data, [index])


@lower_cast(Row, numba.types.Array)
def _array_over_row(context: Any, builder: Any, kind: Row, array: Any, value: Any) -> Any:
    return array_over(context, builder, array, *parts_of_row(builder, value))


def parts_of_row(builder: Any, row: Any) -> tuple[Any, Any]:
    """Return the address of the first value of a `Row`, and the number of its values."""
    return builder.extract_value(row, 0), builder.extract_value(row, 1)


def row_over(context: Any, builder: Any, data: Any, n: Any) -> Any:
    """Return a `Row` of n values from an address on."""
    row = cgutils.create_struct_proxy(Row())(context, builder)
    row.data, row.n = data, n
    return row._getvalue()


@lower_cast(Strip, numba.types.Array)
def _array_over_strip(context: Any, builder: Any, kind: Strip, array: Any, value: Any) -> Any:
    return array_over(context, builder, array, value, context.get_constant(numba.types.intp, kind.count))


def copy_on_stack(builder: Any, value: Any) -> Any:
    """Return the pointer to a copy of a value, which is valid until the function returns."""
    return cgutils.alloca_once_value(builder, value)


def entries_of(builder: Any, values: Any, count: int) -> list[Any]:
    """Return the `count` entries of a tuple of values of one type."""
    return cgutils.unpack_tuple(builder, values, count)


def define_symbol(symbol: str, address: int) -> None:
    """Let a symbol stand for an address in all code that is compiled or loaded from here on."""
    llvm.add_symbol(symbol, address)


def address_of_symbol(context: Any, builder: Any, symbol: str) -> Any:
    """Return the address for which a symbol stands, as an integer."""
    function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(ir.VoidType(), []), symbol)
    return builder.ptrtoint(function, context.get_value_type(numba.types.int64))


class CompiledFunction(numba.types.Callable):
    """The type of the address of a compiled function, which is called there.

    A call of a `numba.types.FunctionType` also has code for a function without an address, which asks Python for one:
    kernels would take longer to compile, and a step of them longer to run.

    If there is a jitted function `call`, it is called instead, as ``call(..., function)``. Types with a `call` of one
    name are the same.
    """

    def __init__(self, signature: Any, call: Jitted | None = None) -> None:
        self.signature, self.call = signature, call
        super().__init__(f"CompiledFunction({signature}, {call and call.__name__})")

    def get_call_type(self, context: Any, args: Sequence[Any], kws: Mapping[str, Any]) -> Any:
        found = self.signature
        if self.call:
            inner = *args, CompiledFunction(self.signature)
            call = context.resolve_value_type(self.call).get_call_type(context, inner, kws)
            found = signature_of(call.return_type, *call.args[:-1])
        return signature_of(found.return_type, *found.args, recvr=self)

    def get_call_signatures(self) -> tuple[Any, bool]:
        return (), True

    def get_impl_key(self, sig: Any) -> Any:
        return CompiledFunction


@register_model(CompiledFunction)
class _Address(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: CompiledFunction) -> None:
        super().__init__(manager, kind, ir.IntType(64))


@lower_builtin(CompiledFunction, CompiledFunction, numba.types.VarArg(numba.types.Any))
def _call_at(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    kind, *types = signature.args
    address, *given = args
    if kind.call:
        call = context.typing_context.resolve_value_type(kind.call)
        inner = signature_of(signature.return_type, *types, CompiledFunction(kind.signature))
        return context.get_function(call, inner)(builder, [*given, address])
    code = context.call_conv.get_function_type(signature.return_type, types)
    function = builder.inttoptr(address, code.as_pointer())
    status, value = context.call_conv.call_function(builder, function, signature.return_type, types, given)
    with cgutils.if_unlikely(builder, status.is_error):
        context.call_conv.return_status_propagate(builder, status)
    return value


# The members of a family of functions: one function that takes the number of the member first, compiled once

_families = itertools.count()  # for names that occur once in a process


@global_compiler_lock
def addresses_of_members(result: Any, count: int) -> tuple[list[int], Any]:
    """Return the addresses of functions that call a compiled function with 0 to count - 1 as its first argument.

    A kernel calls a function at an address, with fixed arguments. Each member thus needs a separate address: there, a
    function of a few instructions adds the number and jumps to the function of the family. These are written as code of
    LLVM, because Numba would take some tenths of a second for each. The number is a float, for which there is a free
    register on most processors: an integer would displace the other arguments, and each of them would have to be moved.

    Also return Numba's code library, which keeps the machine code alive; `result`, of the family, must be kept too.
    """
    name, context = result.fndesc.llvm_func_name, result.target_context
    family = context.call_conv.get_function_type(result.fndesc.restype, result.fndesc.argtypes)
    results, number, others = family.args[:2], family.args[2], family.args[3:]  # where to write a value and an error
    address = ir.Constant(ir.IntType(64), address_of(result))
    library = context.codegen().create_library(f"members of {name}")
    module = library.create_ir_module("members")
    family_name = f"{name}.{next(_families)}"
    names = [f"{family_name}.{k}" for k in range(count)]
    for k, member in enumerate(names):
        function = ir.Function(module, ir.FunctionType(family.return_type, [*results, *others]), member)
        builder = ir.IRBuilder(function.append_basic_block())
        given, target = list(function.args), builder.inttoptr(address, family.as_pointer())
        builder.ret(builder.call(target, [*given[:2], ir.Constant(number, float(k)), *given[2:]], tail=True))
    library.add_ir_module(module)
    library.finalize()
    return [library.get_pointer_to_function(member) for member in names], library


# Compiled code on the disk, and functions on their way to another process


class NoFolderError(OSError):
    """There is no folder in which compiled code could be kept."""

    def __str__(self) -> str:
        return "neither the library's folder nor the user's folder for caches can be written"


class DiskCache(FunctionCache):
    """The cache of one function on the disk. A subclass says in which files, under which key, and what an error means.

    The files are in the folder that Numba has for the function `beside`. The text of `describe` about a compile result
    is kept with the code, of which LLVM's text is lost: `description` is the text of what was compiled or loaded last.

    Raises
    ------
    NoFolderError
        If no folder can be written.
    """

    def __init__(self, beside: Callable, describe: Callable[[Any], str]) -> None:
        try:
            super().__init__(beside)
        except RuntimeError as error:
            if "no locator available" not in str(error):
                raise
            raise NoFolderError from error
        self.files, self._cache_file = self.open_files(Path(self.cache_path)), self
        self._key, self._describe, self.description = "", describe, ""

    @abstractmethod
    def open_files(self, folder: Path) -> Any:
        """Return an object with the methods load(key), which may return None, and save(key, data)."""

    @abstractmethod
    def find_key(self) -> str:
        """Return what compiled code depends on besides the types of its arguments and the processor.

        It is empty if this is unknown: the function is then compiled in each process.
        """

    @abstractmethod
    def failed(self, what: str, error: Exception) -> None:
        """Handle an error of "load" or "keep". The function is then compiled in this process."""

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        return sig, codegen.magic_tuple(), self._key

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            self._key = self.find_key()
            return super().load_overload(sig, target_context) if self._key else None
        except Exception as error:
            self.failed("load", error)
            return None

    def load(self, key: Any) -> Any:
        data, self.description = self.files.load(key) or (None, "")
        return data

    def save(self, key: Any, data: Any) -> None:
        self.files.save(key, (data, self.description))

    def flush(self) -> None:
        """Do nothing: what was compiled with other values from outside stays right. `recompile` calls this."""

    def save_overload(self, sig: Any, data: Any) -> None:
        self.description = self._describe(data)
        if not self._key or data.library.has_dynamic_globals:  # code with addresses of this process
            return
        try:
            super().save_overload(sig, data)
        except pickle.PicklingError:  # of an argument whose class is in no module, such as named parameters
            return
        except Exception as error:
            self.failed("keep", error)


def _number_functions() -> None:
    """Let the numbers of functions, which are in the symbols of their machine code, begin at a random one.

    Code from the disk has the symbols of the process that compiled it. If both began at 1, two different functions of
    one name could have the same symbol, and one of them would be called in place of the other.
    """
    FunctionIdentity._unique_ids = itertools.count(int.from_bytes(os.urandom(6), "little"))


_number_functions()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_number_functions)


class _SelfContained(JITCodeLibrary):
    """The code of a function, in which it calls its own copies of the functions that were linked into it.

    Numba lets all copies of a function in a process be one: the first that was loaded. Copies are optimised in
    different places, and may round differently. Then the process that compiles a function, and those that load it from
    the disk, would not return the same bits.
    """

    def _finalize_final_module(self) -> None:
        self._shared_module = self._final_module.clone()  # for functions that link this one
        for function in self._shared_module.functions:
            if function.linkage == llvm.Linkage.external and not function.is_declaration:
                function.linkage = "linkonce_odr"
        for function in self._final_module.functions:
            if function.linkage == llvm.Linkage.linkonce_odr:
                function.linkage = "internal"
        super()._finalize_final_module()


class _SelfContainedCompiler(_LinkedCompiler):
    kind = _SelfContained


def set_cache(function: Jitted, cache: DiskCache) -> None:
    """Give a jitted function, which is not compiled yet, a cache, and code that rounds alike if it comes from there."""
    function._cache = cache
    function._compiler.pipeline_class = _SelfContainedCompiler


def cache_of(function: Jitted) -> Any:
    """Return the cache of a jitted function: a `DiskCache`, or Numba's own."""
    return function._cache


def has_numbas_cache(function: Jitted) -> bool:
    """Return whether a jitted function has Numba's own cache on the disk."""
    return type(function._cache) is FunctionCache


#: Like the functions of the module pickle, for functions of the main module and of other functions too. They come with
#: Numba, while only the extra dask brings the package cloudpickle, which executors of processes would need too.
pickled, unpickled = cloudpickle.dumps, cloudpickle.loads


# What Numba's errors say


def is_write_to_readonly(error: Exception) -> bool:
    """Return whether a function did not compile because it writes to an array that it may only read."""
    return any(text in str(error) for text in ("Cannot modify readonly array", "output that is read-only"))


def gist(error: Exception) -> str:
    """Return Numba's reason in one line. The chained exception has the details, which can fill pages."""
    text = str(error)
    if text == "compilation disabled":
        return "its decorator must not list signatures"
    if text == "'NoneType' object has no attribute 'args'":  # Numba finds no form of such an operator, and then fails
        return "it has an operator such as += on an array that it may only read, or on an array of other numbers"
    plain = re.search(r"Untyped global name '(\w+)':.*<class 'function'>", text)
    missing = re.search(r">>> (.*)", text)
    keyed = re.search(r"getitem\(Parameters\(.*Literal\[str\]\((\w+)\)", text)
    lines = [line.strip() for line in text.splitlines() if line.strip() and not line.startswith("Failed in")]
    where = re.search(r'File "[^"]*", line \d+', text)
    reason = f"Numba cannot do {missing[1]}" if missing else (lines or [type(error).__name__])[0].rstrip(".")
    reason = f"it calls {plain[1]}, which must be decorated with @eig3.jit too" if plain else reason
    reason = f"parameters with names are p.{keyed[1]}, not p[{keyed[1]!r}]" if keyed else reason
    return f"{reason} ({where[0]})" if where else reason
