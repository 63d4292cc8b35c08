"""Each use of what Numba does not document, by itself: where a new version breaks one, its probe says what has changed.

The probes load one file of the library, and need nothing else of it. So where the library cannot even be imported,
``pytest --noconftest tests/test_numba_internals.py`` says why.
"""

import ast
import ctypes
import gc
import operator
import pickle
import re
import sys
from contextlib import contextmanager
from importlib.metadata import version
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from typing import NamedTuple

import numba
import numpy as np
import pytest
from numba.core.compiler import Flags
from numba.core.registry import cpu_target
from numba.core.types.functions import BaseFunction
from numba.extending import intrinsic
from numba.types import Array, FunctionType, UniTuple, float64, int64, intp

ROOT = Path(__file__).parent.parent
FILE = ROOT / "kernels" / "compile" / "numba_internals.py"
VECTOR = Array(float64, 1, "C")
STRIDED = Array(float64, 1, "A")


def loaded(path):
    spec = spec_from_file_location(path.stem, path)
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


internals = loaded(FILE)
internals_flat = internals.flat


class ChangedError(AssertionError):
    """Numba has changed."""


@contextmanager
def probe(what_changed):
    """A block that fails with these words, whatever goes wrong in it. Of nested blocks, the inner one has the word."""
    try:
        yield
    except ChangedError:
        raise
    except (Exception, pytest.fail.Exception) as error:
        reason = next(iter(str(error).splitlines()), "")
        raise ChangedError(f"{what_changed} ({type(error).__name__}: {reason}): repair {FILE.name}.") from error


def result_of(jitted, *types):
    with probe("A jitted function has no method `compile` for a tuple of types that puts the result in `overloads`"):
        internals.compile_for(jitted, types)
        return internals.compile_results(jitted)[types]


def code_of(jitted, *types):
    result = result_of(jitted, *types)
    with probe("`library` of Numba's compile result does not give LLVM's code"):
        return internals.optimised_code(result)


def address_of(result):
    with probe("Numba's compile result has no `fndesc.llvm_func_name` of which `library` gives the address"):
        return internals.address_of(result)


def double(x):
    return 2 * x


def called_at(address, *arguments):
    """Call machine code as compiled functions call it: with the places of the value and of an error."""
    value, error = ctypes.c_double(), ctypes.c_void_p()
    places = ctypes.POINTER(ctypes.c_double), ctypes.POINTER(ctypes.c_void_p)
    kind = ctypes.CFUNCTYPE(ctypes.c_int32, *places, *[ctypes.c_double] * len(arguments))
    assert kind(address)(ctypes.byref(value), ctypes.byref(error), *arguments) == 0
    return value.value


# The rule


def test_no_other_file_uses_what_numba_does_not_document():
    modules = r"numba\.(?:core|np|misc)\b|\bllvmlite\b|\bcloudpickle\b|\bcgutils\b|\barrayobj\b|\bDispatcher\b"
    attributes = "overloads targetoptions entry_point fndesc library get_pointer_to_function _compiler _cache"
    options = "_nrt no_cpython_wrapper no_cfunc_wrapper"
    inner = re.compile(rf"{modules}|\.(?:{'|'.join(attributes.split())})\b|\b(?:{'|'.join(options.split())})\b")
    folders = "bench", "eig3", "kernels", "problems", "tests"
    texts = {path: path.read_text() for folder in folders for path in (ROOT / folder).rglob("*.py")}
    used = {path.relative_to(ROOT): inner.findall(text) for path, text in texts.items() if inner.search(text)}
    assert used.keys() == {path.relative_to(ROOT) for path in (FILE, Path(__file__))}, (
        f"Only {FILE.name} may use: {used}"
    )


def test_each_name_of_the_file_has_a_probe():
    names = set()
    for node in ast.parse(FILE.read_text()).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Assign):
            names |= {name.id for name in ast.walk(node.targets[0]) if isinstance(name, ast.Name)}
    used = set(re.findall(r"\binternals\.(\w+)", Path(__file__).read_text()))
    assert not {name for name in names if not name.startswith("_")} - used


# Jitted functions and compile results


def test_versions():
    with probe("The versions of Numba and llvmlite are elsewhere"):
        assert (version("numba"), version("llvmlite")) == internals.VERSIONS


def test_class_of_jitted_functions():
    with probe("What numba.njit returns is no numba.core.dispatcher.Dispatcher"):
        assert isinstance(numba.njit(double), internals.Jitted)
        assert not isinstance(double, internals.Jitted)


def test_compile_results_of_a_jitted_function():
    function = numba.njit(double)
    with probe("A jitted function has no dict `overloads` with the compile results by the types of the arguments"):
        results = internals.compile_results(function)
        assert isinstance(results, dict)
        assert not results
        function(3.0)
        assert list(results) == [(float64,)]
    with probe("The method `compile` of a jitted function does not take a tuple of types and keep the result"):
        internals.compile_for(function, (int64,))
        assert list(results) == [(float64,), (int64,)]
    with probe("`recompile` of a jitted function does not replace the compile results in the same dict"):
        before = list(dict.values(results))
        function.recompile()
        assert len(results) == 2
        assert not any(result in before for result in dict.values(results))


def test_options_of_a_jitted_function():
    with probe("A jitted function has no mapping `targetoptions` that numba.jit takes again"):
        options = internals.options_of(numba.njit(boundscheck=True, error_model="numpy")(double))
        assert options["boundscheck"] is True
        assert internals.options_of(numba.jit(**options)(double)) == options


def test_parts_of_a_compile_result():
    result = result_of(numba.njit(double), float64)
    with probe("Numba's compile result has no `signature` with the type that the function returns"):
        assert internals.return_type(result) == float64
    with probe("Numba's compile result has no `entry_point` that calls it from Python"):
        assert internals.call_without_checks(result)(3.0) == 6.0
    address = address_of(result)
    with probe("A compiled function is no longer called with the places of its value and of an error"):
        assert called_at(address, 3.0) == 6.0
    assert re.search(r"define .*double", code_of(numba.njit(double), float64))


# How a function is compiled


def test_code_without_the_runtime():
    def passes_on(function, x):
        return function(x)

    def allocates(n):
        return np.zeros(n)[0]

    types = FunctionType(float64(VECTOR)), VECTOR
    without = numba.njit(**internals.WITHOUT_RUNTIME)
    with probe("The option `_nrt` of numba.njit does not turn the counting of references off"):
        assert ["NRT_" in code_of(jit(passes_on), *types) for jit in (numba.njit, without)] == [True, False]
    not_refused = "The option `_nrt` of numba.njit does not refuse an allocation"
    with probe(not_refused), pytest.raises(Exception, match="zeros"):
        without(allocates)(3)


def test_types_of_operations_are_remembered():
    with probe("Numba finds the type of an operation elsewhere than in `BaseFunction.get_call_type`"):
        product = numba.njit(lambda x, y: x * y)
        usual = BaseFunction.get_call_type
        internals.compile_for(product, (float64, int64))
        assert product(2.5, 2) == 5.0
        assert BaseFunction.get_call_type is usual
        known = cpu_target.typing_context.resolve_value_type(operator.mul).known_to_eig3
        assert known[float64, int64].return_type == float64


def test_cycles_are_not_looked_for_while_functions_compile():
    found = []

    @intrinsic
    def note(typingctx):
        found.append(gc.isenabled())
        return int64(), lambda context, builder, signature, args: context.get_constant(int64, 1)

    assert gc.isenabled()
    internals.compile_for(numba.njit(lambda: note()), ())
    assert not any(found)
    assert found
    assert gc.isenabled()


def test_calls_of_the_compiler_find_room_for_their_frames():
    """Elsewhere, a function that is called at the end of a block of frames gets a new page of memory in each call."""
    resource = pytest.importorskip("resource", reason="Windows does not count page faults")

    def called(a=0, b=1, c=2, d=3, e=4, f=5, g=6, h=7, i=8, j=9):
        pass

    def faults_at(depth):
        if depth:
            return faults_at(depth - 1)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
        for _ in range(200):
            called()
        return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

    found = []
    if sys.version_info >= (3, 11):
        assert max(faults_at(depth) for depth in range(300)) >= 200
    internals._in_one_block(lambda: found.extend(faults_at(depth) for depth in range(300)))
    assert max(found) < 100


def test_a_function_that_is_linked():
    with probe("A jitted function cannot have another class or another compiler, or is then not linked"):
        inner = internals.linked_jit(double, error_model="numpy")
        assert type(inner) is not type(numba.njit(double))
        assert numba.njit(lambda x: inner(x))(3.0) == 6.0
    with probe("A call of a jitted function from Python does not take `__call__` of its class"):
        assert inner(3.0) == 6.0
    with probe("Numba optimises the code of a function, or makes machine code of it, that is only linked"):
        calls = internals.linked_jit(lambda x: inner(x))
        whole = numba.njit(no_cpython_wrapper=True, no_cfunc_wrapper=True)(lambda x: calls(x))
        assert " call " not in code_of(whole, float64)
        assert " call " in code_of(calls, float64)
        with pytest.raises(TypeError, match="double has no machine code: give a jitted function that calls it"):
            internals.address_of(next(iter(internals.compile_results(inner).values())))
    with probe("The options `no_cpython_wrapper` and `no_cfunc_wrapper` of numba.njit do not leave wrappers out"):
        plain, bare = (code_of(function, float64) for function in (numba.njit(double), inner))
        assert "cpython" in plain
        assert "cfunc" in plain
        assert "cpython" not in bare
        assert "cfunc" not in bare
        assert "cfunc" not in code_of(numba.njit(**internals.WITHOUT_C_WRAPPER)(double), float64)
        assert "cpython" not in code_of(numba.njit(**internals.WITHOUT_WRAPPERS)(double), float64)


def test_a_function_without_the_code_for_calls_from_python(monkeypatch):
    monkeypatch.setitem(sys.modules, internals.__name__, internals)
    kept = []
    bare = internals.bare_jit(double, lambda function: kept.append(function) or function, error_model="numpy")
    with probe("A jitted function that `bare_jit` returns has the code for calls from Python, or cannot be called"):
        assert "cpython" not in code_of(bare, float64)
        assert numba.njit(lambda x: bare(x))(3.0) == bare(3.0) == 6.0
    assert kept == [bare, bare.for_python]
    with probe("A function that is called by a pointer has no code for this call"):
        by_pointer = float64(numba.types.FunctionType(float64(float64)), float64)
        assert numba.njit(by_pointer)(lambda function, x: function(x))(bare, 3.0) == 6.0
    with probe("What compiled functions call is not the function itself"):
        assert internals.code_of(bare) is bare
        linked = internals.linked_jit(double)
        assert internals.code_of(linked) is linked.for_python
    with probe("A function without the code for calls from Python cannot be called in another process"):
        assert pickle.loads(internals.cloudpickle.dumps(bare))(3.0) == 6.0
    with monkeypatch.context() as patch:
        patch.setitem(globals(), "double", bare)
        in_bytes = pickle.dumps(bare)
        patch.delitem(globals(), "double")
        with probe("A function of a notebook, whose variables another process has not, cannot be called there"):
            assert pickle.loads(in_bytes)(3.0) == 6.0


def test_functions_that_are_pickled_by_name(monkeypatch):
    with probe("Numba does not pickle a jitted function by `__reduce__` of its class"):
        named = internals.linked_jit(double)
        monkeypatch.setitem(globals(), "double", named)
        monkeypatch.setitem(sys.modules, internals.__name__, internals)
        assert pickle.loads(pickle.dumps(named)) is named
        caller = internals.cloudpickle.dumps(numba.njit(lambda x: named(x)))
        assert b"_named" in caller
        hidden = internals.linked_jit(lambda x: x)
        assert pickle.loads(internals.cloudpickle.dumps(hidden))(2.0) == 2.0
        assert internals.is_linked(named)
        assert not internals.is_linked(numba.njit(lambda x: x))


def test_what_a_pickled_function_keeps():
    kept = []
    with probe(
        "Numba rebuilds a jitted function in another process without `_rebuild` and what `_reduce_states` returns"
    ):
        bare = internals.bare_jit(double, lambda function: kept.append(function) or function, **internals.WITH_ROOTS)
        internals.set_cache(bare, MemoryCache(double, str))
        again = type(bare)._rebuild(**{**bare._reduce_states(), "uuid": "of another process"})
        assert again is not bare
        assert again._compiler.pipeline_class is bare._compiler.pipeline_class
        assert kept == [bare, again]


def test_arrays_that_do_not_overlap():
    def copies(x, y):
        for j in range(x.size):
            y[j] = x[j]

    with probe("`_compiler._customize_flags` of a jitted function does not set the flag `noalias`"):
        plain, free = numba.njit(copies), internals.assume_no_overlap(numba.njit(copies))
        counts = [code_of(function, VECTOR, VECTOR).count("noalias") for function in (plain, free)]
        assert counts[0] < counts[1]


def test_vectors_of_512_bits():
    def scales(x):
        for j in range(x.size):
            x[j] *= 3.0

    with probe("Numba's code generator has no `_tm_features`"):
        has_wide = internals.has_wide_vectors()
    with probe("Numba's code generator does not compile with the target machine `_tm`"):
        with internals.wide_vectors():
            function = numba.njit("(f8[::1],)")(scales)
        assert ("zmm" in next(iter(function.inspect_asm().values()))) == has_wide
        x = np.ones(37)
        function(x)
        assert (x == 3.0).all()


def test_patches_can_be_left_out(monkeypatch):
    """Without them, a linked function has machine code of its own, and operators have nothing to remember."""
    monkeypatch.setenv("EIG3_NUMBA_PATCHES", "")
    plain, usual = loaded(FILE), BaseFunction.get_call_type
    assert internals.PATCHES > plain.PATCHES
    assert not plain.has_wide_vectors()
    function = plain.linked_jit(double)
    with plain._replaced("operators", BaseFunction, "get_call_type", plain._with_memory):
        assert BaseFunction.get_call_type is usual
        plain.compile_for(function, (float64,))
    assert called_at(plain.address_of(plain.compile_results(function)[(float64,)]), 2.0) == 4.0


def test_flags_of_the_compiler_have_the_same_values_in_the_same_order():
    flags = Flags()
    flags.nrt, flags.fastmath = True, {"contract"}
    with probe("Numba's flags have no `options` with a `default`, or no `_values`"):
        values = internals._values_of(flags)
    assert list(values.items()) == list(flags.values().items())


@pytest.mark.skipif(find_spec("scipy") is None, reason="Numba compiles products of matrices with SciPy only")
def test_products_of_matrices_compile_without_the_early_import_of_scipy():
    product = numba.njit(lambda a, b: np.dot(a, b))
    with probe("Numba needs `ensure_blas` of numba.np.linalg before it compiles `np.dot`"):
        internals.compile_for(product, (float64[:, ::1], float64[::1]))
    assert product(np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([5.0, 6.0])).tolist() == [17.0, 39.0]


def test_functions_with_python_objects_and_generators_keep_their_variables(capsys):
    """Numba still finds what lives at the entry of a block and at a yield where compiled code needs it."""

    @numba.njit
    def odd(n):
        for i in range(n):
            yield 2 * i + 1

    def square(n):
        total = 0
        for x in odd(n):
            total += x
        with numba.objmode():
            print(total)
        return total

    jitted = numba.njit(square)
    with probe("generators and objmode need the variables at the entries of blocks, which Numba no longer finds"):
        internals.compile_for(jitted, (int64,))
    assert jitted(5) == 25
    assert capsys.readouterr().out == "25\n"


def test_half_powers_become_roots():
    def power(x):
        return x**1.5

    with probe("a pass after `InlineInlinables` does not see powers as expressions of numba.core.ir"):
        function = numba.njit(**internals.WITH_ROOTS)(power)
        assert function(4.0) == 8.0
        assert "sqrt" in next(iter(function.inspect_llvm().values()))


def test_addresses_come_from_arrays():
    def reads(x, i):
        return x[i]

    with probe("Numba computes addresses of entries with integers: LLVM cannot tell to which array one belongs"):
        assert "inttoptr" not in code_of(numba.njit(no_cpython_wrapper=True)(reads), STRIDED, int64)
    assert numba.njit(reads)(np.arange(9.0)[::2], 3) == 6.0


def test_compilations_are_counted():
    first, second = numba.njit(double), numba.njit(double)
    first(3.0)
    with probe("numba.core.event has no event numba:compile with the function as data['dispatcher']"):
        with internals.compilations() as compiled:
            first(3.0)
            second(3.0)
        first(3)
        assert compiled == [second]


# Values in the code of an intrinsic


def test_parts_of_an_array():
    def codegen(context, builder, signature, args):
        data, shape, strides = internals.parts_of(context, builder, signature.args[0], args[0])
        address = builder.ptrtoint(data, context.get_value_type(intp))
        return context.make_tuple(builder, signature.return_type, [address, *shape, *strides])

    parts = intrinsic(lambda typingctx, array: (UniTuple(intp, 5)(array), codegen))

    with probe("numba.np.arrayobj.make_array gives no struct with `data`, `shape` and `strides`"):
        x = np.zeros((4, 6))[::2, ::3]
        assert numba.njit(lambda x: parts(x))(x) == (x.ctypes.data, *x.shape, *x.strides)
        assert internals.ArrayParts._fields == ("data", "shape", "strides")


def test_an_array_over_memory():
    def codegen(context, builder, signature, args):
        data = internals.parts_of(context, builder, signature.args[0], args[0]).data
        n, stride = (context.get_constant(intp, value) for value in (3, 16))
        return internals.array_over(context, builder, STRIDED, data, n, stride)

    every_other = intrinsic(lambda typingctx, array: (STRIDED(array), codegen))

    @numba.njit(**internals.WITHOUT_RUNTIME)
    def summed(x):
        y = every_other(x)
        return y.size, y[0] + 10 * y[1] + 100 * y[2]

    with probe("numba.np.arrayobj.populate_array does not make an array over memory"):
        assert summed(np.arange(1.0, 7.0)) == (3, 531.0)


@pytest.mark.parametrize("kind", ["float64", "int64", "int32"])
def test_a_part_of_an_array_counts_no_references(kind):
    part, numbers = internals.part_of_array(kind), np.arange(12, dtype=kind)
    x = np.concatenate([[-1.0], numbers.view(np.float64)])

    def taken(x):
        y = part(x, 1, (2, 3))
        return y[1, 2] + 10 * y[0, 1] + 100 * y.shape[0]

    jitted = numba.njit(taken)
    with probe("numba.np.arrayobj.populate_array does not make a part of an array"):
        assert jitted(x) == 5 + 10 + 200
    body = jitted.inspect_llvm(jitted.signatures[0])
    with probe("an array without meminfo is counted"):
        assert "call void @NRT_incref" not in body[body.index("define") :].partition("\n}")[0]


def test_a_part_of_the_values_in_a_lane():
    """Every third number is of the lane; 32 bits of another number would be read in between."""
    part, whole = internals.part_of_array("float64"), internals.part_of_array("int32")
    jitted = numba.njit(lambda x: part(x, 1, (2,))[1])
    with probe("a part of a strided array is not strided"):
        assert jitted(np.arange(12.0)[::3]) == 6.0
    with pytest.raises(numba.TypingError, match="only from parameters that all members share"):
        numba.njit(lambda x: whole(x, 1, (2,))[1])(np.arange(12.0)[::3])


def test_a_flat_array():
    with probe("an array of several axes is not in one row"):
        assert numba.njit(lambda x: internals_flat(x)[5])(np.arange(8.0).reshape(2, 2, 2)) == 5.0


def test_floats_on_the_stack():
    def codegen(context, builder, signature, args):
        data = internals.floats_on_stack(builder, 2)
        places = [builder.gep(data, [context.get_constant(intp, j)]) for j in range(2)]
        for place, value in zip(places, args, strict=True):
            builder.store(value, place)
        return context.make_tuple(builder, signature.return_type, [builder.load(place) for place in places[::-1]])

    swapped = intrinsic(lambda typingctx, x, y: (UniTuple(float64, 2)(x, y), codegen))

    with probe("llvmlite's builder does not reserve memory on the stack by goto_entry_block and alloca"):
        assert numba.njit(lambda x, y: swapped(x, y))(1.0, 2.0) == (2.0, 1.0)


def test_a_copy_on_the_stack():
    def codegen(context, builder, signature, args):
        return builder.load(internals.copy_on_stack(builder, args[0]))

    copied = intrinsic(lambda typingctx, x: (float64(x), codegen))

    with probe("numba.core.cgutils.alloca_once_value does not copy a value onto the stack"):
        assert numba.njit(lambda x: copied(x))(1.5) == 1.5


def test_a_symbol_stands_for_an_address():
    def codegen(context, builder, signature, args):
        return internals.address_of_symbol(context, builder, "a_symbol_of_this_test")

    address = intrinsic(lambda typingctx: (int64(), codegen))

    with probe("llvmlite.binding.add_symbol does not define a symbol for compiled code"):
        internals.define_symbol("a_symbol_of_this_test", 4711)
        assert numba.njit(lambda: address())() == 4711


def test_entries_of_a_tuple():
    def codegen(context, builder, signature, args):
        return internals.entries_of(builder, args[0], 3)[-1]

    last = intrinsic(lambda typingctx, values: (float64(values), codegen))

    with probe("numba.core.cgutils.unpack_tuple does not give the entries of a tuple"):
        assert numba.njit(lambda x: last((x, 2 * x, 3 * x)))(1.0) == 3.0


def at_an_address(kind):
    @intrinsic
    def function_at(typingctx, address):
        return kind(address), lambda context, builder, signature, args: args[0]

    return function_at


def test_a_function_at_an_address():
    function_at = at_an_address(internals.CompiledFunction(float64(float64)))

    def fail_at_zero(x):
        if x == 0:
            raise ValueError("zero")
        return 2 * x

    call = numba.njit(lambda address, x: function_at(address)(x))
    with probe("A type whose call has a receiver, or `call_conv.call_function`, has changed"):
        address = address_of(result_of(numba.njit(fail_at_zero), float64))
        assert call(address, 3.0) == call(address, 3) == 6.0
    with probe("An exception in a function at an address is lost"), pytest.raises(ValueError, match="zero"):
        call(address, 0.0)


def test_a_function_at_an_address_that_is_called_by_another_function():
    result = result_of(numba.njit(double), float64)
    with_another = numba.njit(lambda x, y, function: function(x) + y)
    function_at = at_an_address(internals.CompiledFunction(float64(float64), with_another))
    with probe("Calls of a value of a subclass of `numba.types.Callable` do not call another function"):
        assert numba.njit(lambda address: function_at(address)(3.0, 0.5))(address_of(result)) == 6.5


def test_the_jitted_function_of_a_type():
    with probe("The type of a jitted function has no `dispatcher`"):
        inner = numba.njit(double)
        assert internals.jitted_of(numba.typeof(inner)) is inner


def test_code_with_an_address_of_this_process_is_not_kept(memory):
    size = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)(abs)  # the next process has another address
    with probe("The library of a compile result does not say by `has_dynamic_globals` that it has addresses"):
        assert cached(lambda x: size(x))(-3.0) == 3.0
        assert not memory.kept


def test_the_numbers_of_functions_begin_at_random():
    def number():
        name = result_of(numba.njit(double), float64).fndesc.mangled_name
        return int(re.search(r"B\d+v(\d+)", name)[1])

    with probe("The symbols of machine code have no number from `FunctionIdentity._unique_ids`"):
        first = number()
        assert number() == first + 1
        internals._number_functions()
        assert abs(number() - first) > 10


def test_cells():
    def codegen(context, builder, signature, args):
        begin = internals.floats_on_stack(builder, 1)
        builder.store(args[0], begin)
        return begin

    cell = intrinsic(lambda typingctx, value: (internals.FloatPointer()(value), codegen))

    def changed(value):
        row = cell(value)
        row[0] += 1.0
        for j in range(1):
            row[j] = 2 * row[j]
        return row[0]

    with probe("Numba does not take the types of operator.getitem and operator.setitem from `type_callable`"):
        assert numba.njit(changed)(0.25) == 2.5


class Inner(NamedTuple):
    x: float
    k: int


class Outer(NamedTuple):
    inner: Inner
    y: float


def test_located_records():
    """The fields of a record at an address are read when they are named; a field that is a record is located too."""

    def codegen(context, builder, signature, args):
        data = internals.parts_of(context, builder, signature.args[0], args[0]).data
        place = builder.bitcast(data, args[1].type.as_pointer())
        builder.store(args[1], place)
        return place

    located = intrinsic(lambda typingctx, memory, record: (internals.Located(record)(memory, record), codegen))

    def read(memory, record):
        at = located(memory, record)
        inner = at.inner
        return 100 * inner.x + 10 * inner.k + at.y

    with probe("Numba does not take the fields of a type from `infer_getattr` and `lower_getattr_generic`"):
        assert numba.njit(read)(np.empty(8), Outer(Inner(1.0, 2), 3.0)) == 123.0


def test_rows():
    """The address and the number of floats are indexed as an array is, and given to a function that takes an array."""

    def codegen(context, builder, signature, args):
        parts = internals.parts_of(context, builder, signature.args[0], args[0])
        row = internals.row_over(context, builder, parts.data, parts.shape[0])
        data, n = internals.parts_of_row(builder, row)
        return internals.row_over(context, builder, data, builder.sub(n, context.get_constant(intp, 1)))

    row_of = intrinsic(lambda typingctx, array: (internals.Row()(array), codegen))

    result = result_of(numba.njit(lambda x: x.sum() + 10.0 * x.size), VECTOR)
    total_at = at_an_address(internals.CompiledFunction(float64(VECTOR)))

    def changed(array, address, j):
        row = row_of(array)
        row[j] = 2 * row[j]
        return total_at(address)(row)

    values = np.array([1.0, 2.0, 3.0, 4.0])
    with probe("Numba does not take a model of two values, or its cast, from `register_model` and `lower_cast`"):
        assert numba.njit(changed)(values, address_of(result), 2) == 39.0
    np.testing.assert_array_equal(values, [1.0, 2.0, 6.0, 4.0])
    with probe("Numba's target context has no `enable_boundscheck`"), pytest.raises(IndexError):
        numba.njit(boundscheck=True)(changed)(values, address_of(result), 3)


def test_strips():
    """The address of neighbouring floats is indexed as an array is, and given to a function that takes an array."""

    def codegen(context, builder, signature, args):
        return internals.parts_of(context, builder, signature.args[0], args[0]).data

    strip = intrinsic(lambda typingctx, array: (internals.Strip(3)(array), codegen))

    result = result_of(numba.njit(lambda x: x.sum() + 10.0 * x.size), VECTOR)
    total_at = at_an_address(internals.CompiledFunction(float64(VECTOR)))

    def changed(array, address):
        row = strip(array)
        for j in range(3):
            row[j] = 2 * row[j]
        return total_at(address)(row)

    values = np.array([1.0, 2.0, 3.0, 4.0])
    with probe("Numba does not take the cast of a type from `lower_cast`"):
        assert numba.njit(changed)(values, address_of(result)) == 42.0
    np.testing.assert_array_equal(values, [2.0, 4.0, 6.0, 4.0])


def test_a_strip_of_integers():
    def codegen(context, builder, signature, args):
        return internals.parts_of(context, builder, signature.args[0], args[0]).data

    strip = intrinsic(lambda typingctx, array: (internals.Strip(None, numba.types.int32)(array), codegen))

    def changed(array):
        row = strip(array)
        row[1] = row[0]
        return row[2]

    values = np.array([7, 8, 9], dtype=np.int32)
    assert numba.njit(changed)(values) == 9
    np.testing.assert_array_equal(values, [7, 7, 9])


def test_what_intrinsics_ask_the_target_context():
    def codegen(context, builder, signature, args):
        context.get_dummy_value()
        whole = context.cast(builder, args[0], float64, int64)
        bits = builder.bitcast(args[0], context.get_value_type(int64))
        return context.make_tuple(builder, signature.return_type, [whole, bits, context.get_constant(intp, 7)])

    converted = intrinsic(lambda typingctx, x: (UniTuple(int64, 3)(x), codegen))

    with probe("Numba's target context has no get_constant, get_value_type, get_dummy_value, make_tuple or cast"):
        assert numba.njit(lambda x: converted(x))(1.5) == (1, np.float64(1.5).view(np.int64), 7)


# Families


def test_addresses_of_the_members_of_a_family():
    result = result_of(numba.njit(lambda k, x: 10 * k + x), float64, float64)
    with probe("Numba's target context or code library does not take functions that are written as code of LLVM"):
        addresses, library = internals.addresses_of_members(result, 3)
        assert [called_at(address, 0.5) for address in addresses] == [0.5, 10.5, 20.5]
        assert library is not None
        again, _ = internals.addresses_of_members(result, 1)
        assert called_at(*again, 0.25) == 0.25


# The cache


class Memory:
    """Files of a cache that are in memory."""

    def __init__(self):
        self.kept = {}

    def load(self, key):
        return self.kept.get(key)

    def save(self, key, data):
        self.kept[key] = data


class MemoryCache(internals.DiskCache):
    memory, world = Memory(), "a world"

    def open_files(self, folder):
        self.folder, self.failures = folder, []
        return self.memory

    def find_key(self):
        return self.world

    def failed(self, what, error):
        self.failures.append((what, str(error)))


def cached(function):
    with probe("Numba's FunctionCache has no `cache_path`"):
        jitted, cache = numba.njit(function), MemoryCache(function, str)
    internals.set_cache(jitted, cache)
    return jitted


@pytest.fixture
def memory(monkeypatch):
    monkeypatch.setattr(MemoryCache, "memory", Memory())
    return MemoryCache.memory


def test_kept_code_calls_its_own_copies(memory):
    """Otherwise it would call the copy that its process loaded first, which may round differently."""

    def first_two(x):
        return np.cumsum(x)[1]

    kept, by_numba = cached(first_two), numba.njit(first_two)
    copied = {name: "linkonce_odr" in linkages(f) for name, f in (("kept", kept), ("by Numba", by_numba))}
    with probe("A code library does not compile the linkage that `_finalize_final_module` gives its functions"):
        assert copied == {"kept": False, "by Numba": True}
        assert kept(np.array([3.0, 1.0, 2.0])) == 4.0
    caller = numba.njit(lambda x: kept(x))
    with probe("A code library does not link what is in `_shared_module`"):
        assert caller(np.array([3.0, 1.0, 2.0])) == 4.0


def linkages(function):
    """How the functions in the code of a function of a vector are linked."""
    lines = internals.optimised_code(result_of(function, VECTOR)).splitlines()
    return {line.split()[1] for line in lines if line.startswith("define ")}


def test_what_a_cache_knows_of_its_function(memory):
    cache = internals.cache_of(cached(double))
    with probe("`cache_path` of Numba's FunctionCache has another meaning"):
        assert cache.folder.is_dir()
        assert cache.folder == MemoryCache(called_at, str).folder


def test_code_is_kept_and_loaded(memory, monkeypatch):
    def compiled():
        function = cached(double)
        with internals.compilations() as functions:
            assert function(3.0) == 6.0
        return bool(functions)

    with probe(
        "Numba's FunctionCache does not save a compile result in `_cache_file`, or the function has no `_cache`"
    ):
        assert compiled()
        assert len(memory.kept) == 1
    with probe("Numba's FunctionCache does not load a compile result from `_cache_file`"):
        assert not compiled()
    with probe("Numba's FunctionCache does not take the key from `_index_key`"):
        assert all("a world" in key for key in memory.kept)
        monkeypatch.setattr(MemoryCache, "world", "another world")
        assert compiled()
        assert len(memory.kept) == 2
        monkeypatch.setattr(MemoryCache, "world", "")  # nothing is known of the function: it is not kept
        assert compiled()
        assert compiled()
        assert len(memory.kept) == 2
        monkeypatch.setattr(MemoryCache, "world", "a world")
    with probe("`recompile` of a jitted function does not compile it, or its cache has no `flush`"):
        function = cached(double)
        function(3.0)
        function.recompile()
        assert function(3.0) == 6.0
    with probe("A cache does not keep the description of a compile result"):
        assert internals.cache_of(function).description.startswith("CompileResult")


def test_errors_of_a_cache(memory, monkeypatch):
    def broken(*arguments):
        raise OSError("a broken disk")

    monkeypatch.setattr(memory, "load", broken)
    monkeypatch.setattr(memory, "save", broken)
    function = cached(double)
    with probe("Numba does not call `load_overload` and `save_overload` of the cache of a function"):
        assert function(3.0) == 6.0
        assert internals.cache_of(function).failures == [("load", "a broken disk"), ("keep", "a broken disk")]


def test_a_function_without_a_folder():
    namespace = {}
    exec("def nowhere(x):\n    return x", namespace)
    other_words = "Numba does not say `no locator available` if a function has no folder for its cache"
    with probe(other_words), pytest.raises(internals.NoFolderError):
        MemoryCache(namespace["nowhere"], str)


def test_whose_cache_a_function_has(memory):
    with probe("A function that is jitted with cache=True has no FunctionCache in `_cache`"):
        kept, plain, own = numba.njit(cache=True)(double), numba.njit(double), cached(double)
        assert [internals.has_numbas_cache(function) for function in (kept, plain, own)] == [True, False, False]
        assert type(internals.cache_of(own)) is MemoryCache


def test_functions_of_the_main_module_travel():
    main = {"__name__": "__main__"}
    exec("def outer(k):\n    return lambda x: k * x", main)
    with probe("numba.cloudpickle does not pickle functions of the main module and of other functions"):
        assert internals.unpickled(internals.pickled(main["outer"](2)))(3.0) == 6.0


# Errors


def error_of(function, *arguments):
    with pytest.raises(Exception) as caught:  # noqa: PT011  # Numba raises its own errors and plain Python errors
        function(*arguments)
    return caught.value


def test_writes_to_a_readonly_array():
    def writes(x):
        x[0] = 1.0

    def multiplies(x):
        np.multiply(x, 2.0, x)

    with probe("Numba's error for a write to a readonly array has other words"):
        x = np.ones(1)
        x.flags.writeable = False
        for function in (writes, multiplies):
            assert internals.is_write_to_readonly(error_of(numba.njit(function), x))
        assert not internals.is_write_to_readonly(error_of(numba.njit(lambda x: x.missing), x))


def plain(x):
    return x


def adds(x):
    x += 1.0


def test_reasons_in_one_line():
    with probe("Numba's error for a function with listed signatures has other words"):
        listed = numba.njit("f8(f8)")(double)
        assert (
            internals.gist(error_of(internals.compile_for, listed, (VECTOR,)))
            == "its decorator must not list signatures"
        )
    with probe("Numba's error for += on a readonly array has other words"):
        x = np.ones(1)
        x.flags.writeable = False
        assert internals.gist(error_of(numba.njit(adds), x)).startswith("it has an operator such as += on an array")
    with probe("Numba's error for a call that it cannot compile does not show the call after >>>"):
        reason = internals.gist(error_of(numba.njit(lambda x: sorted(x, 7)), np.ones(1)))
        assert re.fullmatch(rf'Numba cannot do sorted\(.*\) \(File ".*{Path(__file__).name}", line \d+\)', reason)
    with probe("Numba's error for a call of a plain function has other words"):
        reason = internals.gist(error_of(numba.njit(lambda x: plain(x)), 1.0))
        assert reason.startswith("it calls plain, which must be decorated with @eig3.jit too")
    with probe("Numba's error for an unknown attribute does not begin with its reason after `Failed in`"):
        reason = internals.gist(error_of(numba.njit(lambda x: x.missing), np.ones(1)))
        assert re.fullmatch(rf'Unknown attribute .missing. .* \(File ".*{Path(__file__).name}", line \d+\)', reason)
