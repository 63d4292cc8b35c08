"""The compiled loops, one method a file.

Each method's file holds, in this order: what it computes and where that comes from; the update of one component,
written once; a step for one degree of freedom and a step for n, which both use that update; `start`, which fills the
history that a method carries beside u and v; `scratch`, the rows of n values that the vector form needs beside those;
and `scalar` and `vector`, the kernels that `jit` compiles for the fixed signatures.

`tally` holds evaluations, iterations, and what a failed solve leaves: its residual, NaN where the step began with
something not finite, and then the degree of freedom of that.
"""
