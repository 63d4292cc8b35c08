"""Vectors of 512 bits, where the processor has them.

For many processors with AVX-512, LLVM prefers vectors of 256 bits, because the first of them lowered their frequency
for wider ones. Loops over the lanes of a block do little but compute vectors: they gain a quarter.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import llvmlite.binding as llvm
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import cpu_target

_WIDER = "-prefer-256-bit"


def has_wide_vectors() -> bool:
    """Return whether the compiler can use vectors of 512 bits."""
    return "+avx512f" in _codegen()._tm_features.split(",")


@contextmanager
def wide_vectors() -> Iterator[None]:
    """A block in which Numba compiles for the widest vectors that the processor has."""
    if not has_wide_vectors():
        yield
        return
    codegen = _codegen()
    with global_compiler_lock:
        options: dict[str, Any] = {"opt": 3}
        codegen._customize_tm_options(options)
        options["features"] = f"{options['features']},{_WIDER}"
        usual = codegen._tm
        codegen._tm = llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine(**options)
        try:
            yield
        finally:
            codegen._tm = usual


def _codegen():
    return cpu_target.target_context.codegen()
