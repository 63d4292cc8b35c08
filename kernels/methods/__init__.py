"""The formulas of the methods, one method per file. The names in such a file are described in `eig3.kernels`."""
