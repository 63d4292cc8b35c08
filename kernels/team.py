"""Share the work of one call between threads: the thread that calls posts a job, and all of them take its parts.

A part belongs to the first thread that takes it, and the thread that has posted the job waits only for parts that
others have begun. So a run does not wait for threads that sleep, and it ends without any.

The threads share an array of integers, the board. What a part does must not depend on the thread that does it.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from numba.extending import intrinsic
from numba.types import Array, boolean, float64, int64, intp, none

from .compile.jit import compile_kernel, element, function_at
from .compile.numba_internals import array_over, parts_of
from .protocol import vector_type

#: The places on the board; places that change often have separate cache lines: the ticket, the number of parts
#: that are done, whether a part has failed, whether the threads shall leave, and the job with the six numbers of its
#: arrays: where u, v, p and a are, and the sizes of u and p. The number of threads is last.
TICKET, DONE, FAILED, LEAVE, JOB, THREADS = 0, 8, 16, 24, 32, 40
SIZE = 48
_PHASE, _TIME, _U, _V, _P, _A, _U_SIZE, _P_SIZE = range(JOB, JOB + 8)
_PARTS, _NEXT, _MASK = 2**16, 1, 2**16 - 1  # a ticket is (job number, parts, next part), of 32, 16 and 16 bits
_PATIENCE = 2**20  # looks at the ticket before a thread sleeps: some milliseconds

#: The places of the team in p: the address of the board, or 0; the address of p itself, because a copy of p has no
#: team; and the number of threads that is wanted.
BOARD, SELF, WANTED = range(3)
#: ``share(phase, part, parts, t, u, v, p, a)`` does a part of a job.
SHARE = none(int64, int64, int64, float64, *[vector_type] * 4)
share_at = function_at(SHARE)
_board = Array(int64, 1, "C")


@intrinsic
def board_at(typingctx, address):  # type: ignore[no-untyped-def]
    """``board_at(address)`` is the board at an address."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        data = builder.inttoptr(args[0], context.get_value_type(int64).as_pointer())
        return array_over(context, builder, _board, data, context.get_constant(intp, SIZE))

    return _board(int64), codegen


@intrinsic
def vector_at(typingctx, address, count):  # type: ignore[no-untyped-def]
    """``vector_at(address, count)`` is an array of floats at an address."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        data = builder.inttoptr(args[0], context.get_value_type(float64).as_pointer())
        return array_over(context, builder, vector_type, data, args[1])

    return vector_type(int64, int64), codegen


@intrinsic
def address_of_vector(typingctx, array):  # type: ignore[no-untyped-def]
    """``address_of_vector(x)`` is the address of the first value of an array."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return builder.ptrtoint(
            parts_of(context, builder, signature.args[0], args[0]).data, context.get_value_type(int64)
        )

    return int64(array), codegen


def _cell(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    return builder.gep(parts_of(context, builder, signature.args[0], args[0]).data, [args[1]])


@intrinsic
def load(typingctx, board, place):  # type: ignore[no-untyped-def]
    """``load(board, place)`` reads a number that other threads change."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return builder.load_atomic(_cell(context, builder, signature, args), "seq_cst", 8)

    return int64(_board, int64), codegen


@intrinsic
def store(typingctx, board, place, value):  # type: ignore[no-untyped-def]
    """``store(board, place, value)`` writes a number that other threads read, after all that was written before."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        builder.store_atomic(args[2], _cell(context, builder, signature, args), "seq_cst", 8)
        return context.get_dummy_value()

    return none(_board, int64, int64), codegen


@intrinsic
def add(typingctx, board, place, value):  # type: ignore[no-untyped-def]
    """``add(board, place, value)`` adds to a number that other threads add to."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        builder.atomic_rmw("add", _cell(context, builder, signature, args), args[2], "seq_cst")
        return context.get_dummy_value()

    return none(_board, int64, int64), codegen


@intrinsic
def replace(typingctx, board, place, old, new):  # type: ignore[no-untyped-def]
    """``replace(board, place, old, new)`` writes a number, and returns True, if it still was the old one."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        found = builder.cmpxchg(_cell(context, builder, signature, args), args[2], args[3], "seq_cst", "seq_cst")
        return builder.extract_value(found, 1)

    return boolean(_board, int64, int64, int64), codegen


@element
def board_of(p, place):
    """Return the address of the board of a run with the parameters p, or 0 if no other thread is there."""
    return int64(p[place + BOARD]) if p[place + SELF] == address_of_vector(p) else 0


@element
def do_part(share, board, part, parts):
    """Do one part of the job at a board, and note an exception."""
    n, t = board[_U_SIZE], vector_at(address_of_vector(board), SIZE)[_TIME]
    u, v = vector_at(board[_U], n), vector_at(board[_V], n)
    p, a = vector_at(board[_P], board[_P_SIZE]), vector_at(board[_A], n)
    try:
        share(board[_PHASE], part, parts, t, u, v, p, a)
    except Exception:
        store(board, FAILED, 1)
    add(board, DONE, 1)


@element
def together(share, board, phase, parts, t, u, v, p, a):
    """Do all parts of a job, with the threads at the board."""
    job = board_at(board)
    floats = vector_at(board, SIZE)
    job[_PHASE], floats[_TIME], job[_U_SIZE], job[_P_SIZE] = phase, t, len(u), len(p)
    job[_U], job[_V] = address_of_vector(u), address_of_vector(v)
    job[_P], job[_A] = address_of_vector(p), address_of_vector(a)
    store(job, DONE, 0)
    store(job, FAILED, 0)
    number = (load(job, TICKET) >> 32) + 1
    ticket = (number & 0x7FFFFFFF) << 32 | parts * _PARTS
    store(job, TICKET, ticket)
    while True:
        ticket = load(job, TICKET)
        if ticket & _MASK >= parts:
            break
        if replace(job, TICKET, ticket, ticket + _NEXT):
            do_part(share, job, ticket & _MASK, parts)
    while load(job, DONE) < parts:
        pass
    if load(job, FAILED) == 1:
        for part in range(parts):  # that with an exception raises it here, after the others have left their arrays
            share(phase, part, parts, t, u, v, p, a)
        raise RuntimeError("a function failed in one thread, but not in another.")


def serving(board, address):
    """Do parts of the jobs that are posted at a board, until none was posted for some time.

    `address` is the address of the function `share`. Return whether to continue later.
    """
    share, patience = share_at(address), _PATIENCE
    while patience > 0:
        if load(board, LEAVE) == 1:
            return False
        ticket = load(board, TICKET)
        part, parts = ticket & _MASK, (ticket >> 16) & _MASK
        if part >= parts:
            patience -= 1
        elif replace(board, TICKET, ticket, ticket + _NEXT):
            do_part(share, board, part, parts)
            patience = _PATIENCE
    return True


@functools.cache
def serve() -> Any:
    """Compile the loop of the other threads, or load it from the disk: it is called as ``serve()(board, address)``."""
    return compile_kernel(serving, {}, boolean(_board, int64), "team")


def new_board(threads: int) -> np.ndarray:
    """Return a board without a job, for the thread that posts and others."""
    board = np.zeros(SIZE, dtype=np.int64)
    board[THREADS] = threads
    return board
