"""The kernels: the compiled loops of the methods.

A file of `eig3.kernels.methods` contains the formulas of one method. `eig3.kernels.loops.fixed` makes the kernel from
them. The file defines these names, of which all but the first two may be left out:

ROWS : int
    Number of rows of n values: u, v, the past values, and scratch.
step(f, at, y, c, n)
    One step of n degrees of freedom. It writes the rows of the tuple y, and returns them in the order of the next step,
    and True. With one degree of freedom, a row is one value in a register: it is only indexed, and has no size.
PAST : int
    Number of values besides u and v that a step passes to the next step; 0 by default.
EVALUATIONS : int
    Evaluations of f in a step; left out by a method that counts them itself, in the counters.
start(u, v, a, h)
    The past values before the first step, as a tuple, from a = f(t0, u0, v0); zeros by default.
START : str, START_STEPS : int
    The file of `eig3.kernels.methods` whose method takes the first steps, and the number of these steps.
start_step(f, at, y, c, n)
    A starting step for a method whose own step cannot record the past values. c is (c, scratch). It calls the starter,
    ``success = STARTER(f, at, u, v, scratch, n)``.
brief_step(f, at, u, v, scratch, n)
    A step that starts another method, written for a short compilation. It changes u and v and the rows of scratch.
step_of_one(f, at, y, c, n)
    The step of one degree of freedom, for a method whose `step` would take longer to run or to compile.
TURN : int
    Number of steps after which the rows are in their places again; 6 by default.
member(...)
    For a family of methods, a function that returns an object with the other names for the member that a record names.
constants(settings, h, work)
    The argument c of the steps. It is computed once per call of the kernel, from the `settings` of the method's record
    and, for a method that solves equations, a `eig3.kernels.protocol.Work`; () by default.
complete(y, c, h, n)
    Computes v in y[1] when a state is written, for a method whose steps do not need v.
MATRIX : bool
    Whether a step needs an n x n matrix, `work.matrix`; False by default.
KEEPS_CONSTRAINTS : bool
    Whether a step ends at a state that keeps the constraints of a scene; False by default: the state is then projected.

`at` contains the step index `i`, the time `t`, the step `h` and the parameters `p`. A step that fails returns False in
place of True, and must not have changed the rows of the state. The README of this folder shows how to add a method.
"""
