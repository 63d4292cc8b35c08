"""The members of a family of functions: one function that takes the number of the member first, compiled once.

A kernel calls a function at an address, with fixed arguments. Each member thus needs an address of its own: that of a
function of a few instructions, which adds the number and jumps to the function of the family. These are written as code
of LLVM, because Numba would take some tenths of a second for each. The number is a float, for which there is a free
register on most processors: an integer would displace the other arguments, and each of them would have to be moved.
"""

import itertools
from typing import Any

from llvmlite import ir
from numba.core.compiler_lock import global_compiler_lock

_families = itertools.count()  # for names that occur once in a process


@global_compiler_lock
def addresses_of_members(result: Any, count: int) -> tuple[list[int], Any]:
    """Return the addresses of functions that call a compiled function with 0 to count - 1 as its first argument.

    Parameters
    ----------
    result : Numba's compile result
        The function of the family. Its first argument is of the type float64.
    count : int

    Returns
    -------
    addresses : list of int
    library : Numba's code library
        Keeps the machine code alive. `result` must be kept too.
    """
    name, context = result.fndesc.llvm_func_name, result.target_context
    family = context.call_conv.get_function_type(result.fndesc.restype, result.fndesc.argtypes)
    results, number, others = family.args[:2], family.args[2], family.args[3:]  # where to write a value and an error
    address = ir.Constant(ir.IntType(64), result.library.get_pointer_to_function(name))
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
