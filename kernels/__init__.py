"""The compiled loops, one method a file.

Each method's file holds, in this order: what it computes and where that comes from; the update of one component,
written once; a step for one degree of freedom and a step for n, which both use that update; and what `jit` and
`eig3.Stepper` look for:

start(u, v, a, h)
    The history that the method carries beside u and v, at the first step: a tuple of floats or arrays.
scratch(n)
    Rows of n values that the vector form needs beside u, v and the history. Too few are written out of bounds.
scalar, vector (f, state, settings, tally, run)
    The kernels: plain functions that unpack `state` (the floats, or the rows) into a tuple y, march it, and store it.

A step is ``step(f, t, y, c, h, p)``, in the vector form ``step(f, t, y, c, h, p, n)`` for n components, with y that
tuple and c whatever the kernel hands to the march: coefficients, as a rule. It returns the new tuple and True (scalar),
or True (vector, in place); False where it failed. `settings` are the numbers of the record, and `run` says what to
march, see `jit.pointer_kernel`. `tally` holds the counts of evaluations and of iterations, and what a failed solve
leaves: its residual, NaN where the step began with something not finite, and then the degree of freedom of that.
"""
