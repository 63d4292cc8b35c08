"""The displacement of two points along a unit vector, x2, which turns with the body of the second point."""

from .compile.jit import element


@element
def product(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@element
def displacement(x0, x1, x2):
    return product(x0, x2) - product(x1, x2)


@element
def displacement_rate(x, v):
    return product(v[0], x[2]) - product(v[1], x[2]) + product(x[0], v[2]) - product(x[1], v[2])


@element
def forces_along(x, force):
    """Return the force on the first point, its opposite, and the force on the axis, which has the moment of both."""
    a, b, e = x
    f, g = (force * e[0], force * e[1], force * e[2]), (-force * e[0], -force * e[1], -force * e[2])
    return f, g, (force * (a[0] - b[0]), force * (a[1] - b[1]), force * (a[2] - b[2]))
