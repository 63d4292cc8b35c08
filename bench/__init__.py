"""Benchmarks: the article's tables, and the speed, accuracy and stability of the methods."""

#: The benchmarks of `eig3 bench`, in the order of its help. Each is a module of this package that defines
#: ``SUMMARY``, ``add_options(parser)``, and ``benchmark``, whose keywords are its options, or ``run(options)``, which
#: returns an exit status; its docstring is the description in its help.
BENCHMARKS = (
    "paper",
    "speed",
    "c",
    "precision",
    "bars",
    "structures",
    "plan",
    "stability",
    "family",
    "hard",
    "trust",
    "scenes",
    "ensemble",
    "report",
)
