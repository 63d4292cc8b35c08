"""The loops that a careful user would write by hand for the article's problems: one for each method and form.

They use nothing of `eig3.kernels` except the LDU solve, which a user would call too. Like the library's kernels they
take the right-hand side as an argument, and can be compiled with it as a pointer or inlined. The loops for two degrees
of freedom write both out, as one would for a pendulum.
"""

import math

import numpy as np

from eig3.kernels.methods import ldu


def eig3_scalar(f, u, v, p, h, n, u_rows, v_rows):
    a_past = f(0.0, u, v, p)
    for i in range(n):
        a = f(i * h, u, v, p)
        u = u + (h * v - h * h / 2 * a_past) + h * h * a
        v = v - h / 2 * a_past + 1.5 * h * a
        a_past = a
        u_rows[i], v_rows[i] = u, v


def cd_scalar(f, u, v, p, h, n, u_rows, v_rows):
    a = f(0.0, u, v, p)
    w = v - h / 2 * a
    for i in range(n):
        u = u + h * w + h * h * a
        w = w + h * a
        a = f((i + 1) * h, u, w, p)
        u_rows[i], v_rows[i] = u, w + h / 2 * a


def rk2_scalar(f, u, v, p, h, n, u_rows, v_rows):
    for i in range(n):
        a1 = f(i * h, u, v, p)
        a2 = f((i + 1) * h, u + h * v, v + h * a1, p)
        u = u + h * v + h * h / 2 * a1
        v = v + h / 2 * (a1 + a2)
        u_rows[i], v_rows[i] = u, v


def rk3_scalar(f, u, v, p, h, n, u_rows, v_rows):
    for i in range(n):
        t = i * h
        a1 = f(t, u, v, p)
        a2 = f(t + h / 2, u + h / 2 * v, v + h / 2 * a1, p)
        a3 = f(t + h, u + h * v + h * h * a1, v + h * (2 * a2 - a1), p)
        u = u + h * v + h * h / 6 * (a1 + 2 * a2)
        v = v + h / 6 * (a1 + 4 * a2 + a3)
        u_rows[i], v_rows[i] = u, v


def rk4_scalar(f, u, v, p, h, n, u_rows, v_rows):
    for i in range(n):
        t = i * h
        a1 = f(t, u, v, p)
        a2 = f(t + h / 2, u + h / 2 * v, v + h / 2 * a1, p)
        a3 = f(t + h / 2, u + h / 2 * v + h * h / 4 * a1, v + h / 2 * a2, p)
        a4 = f(t + h, u + h * v + h * h / 2 * a2, v + h * a3, p)
        u = u + h * v + h * h / 6 * (a1 + a2 + a3)
        v = v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        u_rows[i], v_rows[i] = u, v


def ab2_scalar(f, u, v, p, h, n, u_rows, v_rows):
    a_past = f(0.0, u, v, p)
    v_past = v - h * a_past
    for i in range(n):
        a = f(i * h, u, v, p)
        u = u + h * (1.5 * v - 0.5 * v_past)
        v_past = v
        v = v + h * (1.5 * a - 0.5 * a_past)
        a_past = a
        u_rows[i], v_rows[i] = u, v


def ab3_scalar(f, u, v, p, h, n, u_rows, v_rows):
    # a constant past is enough: the benchmark does not time the two steps of a better start
    a1 = a2 = f(0.0, u, v, p)
    v1 = v2 = v
    for i in range(n):
        a = f(i * h, u, v, p)
        u = u + h / 12 * (23 * v - 16 * v1 + 5 * v2)
        v2, v1 = v1, v
        v = v + h / 12 * (23 * a - 16 * a1 + 5 * a2)
        a2, a1 = a1, a
        u_rows[i], v_rows[i] = u, v


def eig3_pair(f, u, v, p, h, n, u_rows, v_rows):
    a, past = np.empty(2), np.empty(2)
    f(0.0, u, v, p, past)
    for i in range(n):
        f(i * h, u, v, p, a)
        u[0] += h * v[0] - h * h / 2 * past[0] + h * h * a[0]
        u[1] += h * v[1] - h * h / 2 * past[1] + h * h * a[1]
        v[0] += 1.5 * h * a[0] - h / 2 * past[0]
        v[1] += 1.5 * h * a[1] - h / 2 * past[1]
        past[0], past[1] = a[0], a[1]
        u_rows[i, 0], u_rows[i, 1], v_rows[i, 0], v_rows[i, 1] = u[0], u[1], v[0], v[1]


def cd_pair(f, u, v, p, h, n, u_rows, v_rows):
    a, moved, residual, matrix = np.empty(2), np.empty(2), np.empty(2), np.empty((2, 2))
    row_swaps, column_swaps = np.empty(2), np.empty(2)
    f(0.0, u, v, p, a)
    w0, w1 = v[0] - h / 2 * a[0], v[1] - h / 2 * a[1]
    for i in range(n):
        w0, w1 = 2 * v[0] - w0, 2 * v[1] - w1
        u[0] += h * w0
        u[1] += h * w1
        t = (i + 1) * h
        for iteration in range(50):
            f(t, u, v, p, a)
            residual[0], residual[1] = v[0] - w0 - h / 2 * a[0], v[1] - w1 - h / 2 * a[1]
            scale = abs(v[0]) + abs(v[1]) + abs(w0) + abs(w1)
            norm = abs(residual[0]) + abs(residual[1])
            converged = iteration > 0 and norm <= 1e-12 * scale
            if not math.isfinite(norm):
                return
            if not converged:
                for j in range(2):
                    kept = v[j]
                    v[j] += 1.5e-8 * max(abs(kept), scale / 2)
                    dv = v[j] - kept
                    f(t, u, v, p, moved)
                    v[j] = kept
                    matrix[0, j], matrix[1, j] = -h / 2 * (moved[0] - a[0]) / dv, -h / 2 * (moved[1] - a[1]) / dv
                    matrix[j, j] += 1
                ldu.factorise(matrix, 2, row_swaps, column_swaps)
            ldu.solve(matrix, 2, row_swaps, column_swaps, residual)
            v[0] -= residual[0]
            v[1] -= residual[1]
            if converged:
                break
        u_rows[i, 0], u_rows[i, 1], v_rows[i, 0], v_rows[i, 1] = u[0], u[1], v[0], v[1]


def rk2_pair(f, u, v, p, h, n, u_rows, v_rows):
    a1, a2, u2, v2 = np.empty(2), np.empty(2), np.empty(2), np.empty(2)
    for i in range(n):
        f(i * h, u, v, p, a1)
        u2[0], u2[1], v2[0], v2[1] = u[0] + h * v[0], u[1] + h * v[1], v[0] + h * a1[0], v[1] + h * a1[1]
        f((i + 1) * h, u2, v2, p, a2)
        u[0] += h * v[0] + h * h / 2 * a1[0]
        u[1] += h * v[1] + h * h / 2 * a1[1]
        v[0] += h / 2 * (a1[0] + a2[0])
        v[1] += h / 2 * (a1[1] + a2[1])
        u_rows[i, 0], u_rows[i, 1], v_rows[i, 0], v_rows[i, 1] = u[0], u[1], v[0], v[1]


def rk3_pair(f, u, v, p, h, n, u_rows, v_rows):
    a1, a2, a3, us, vs = np.empty(2), np.empty(2), np.empty(2), np.empty(2), np.empty(2)
    for i in range(n):
        t = i * h
        f(t, u, v, p, a1)
        us[0], us[1] = u[0] + h / 2 * v[0], u[1] + h / 2 * v[1]
        vs[0], vs[1] = v[0] + h / 2 * a1[0], v[1] + h / 2 * a1[1]
        f(t + h / 2, us, vs, p, a2)
        us[0], us[1] = u[0] + h * v[0] + h * h * a1[0], u[1] + h * v[1] + h * h * a1[1]
        vs[0], vs[1] = v[0] + h * (2 * a2[0] - a1[0]), v[1] + h * (2 * a2[1] - a1[1])
        f(t + h, us, vs, p, a3)
        u[0] += h * v[0] + h * h / 6 * (a1[0] + 2 * a2[0])
        u[1] += h * v[1] + h * h / 6 * (a1[1] + 2 * a2[1])
        v[0] += h / 6 * (a1[0] + 4 * a2[0] + a3[0])
        v[1] += h / 6 * (a1[1] + 4 * a2[1] + a3[1])
        u_rows[i, 0], u_rows[i, 1], v_rows[i, 0], v_rows[i, 1] = u[0], u[1], v[0], v[1]


def rk4_pair(f, u, v, p, h, n, u_rows, v_rows):
    a1, a2, a3, a4, us, vs = np.empty(2), np.empty(2), np.empty(2), np.empty(2), np.empty(2), np.empty(2)
    for i in range(n):
        t = i * h
        f(t, u, v, p, a1)
        us[0], us[1] = u[0] + h / 2 * v[0], u[1] + h / 2 * v[1]
        vs[0], vs[1] = v[0] + h / 2 * a1[0], v[1] + h / 2 * a1[1]
        f(t + h / 2, us, vs, p, a2)
        us[0], us[1] = us[0] + h * h / 4 * a1[0], us[1] + h * h / 4 * a1[1]
        vs[0], vs[1] = v[0] + h / 2 * a2[0], v[1] + h / 2 * a2[1]
        f(t + h / 2, us, vs, p, a3)
        us[0], us[1] = u[0] + h * v[0] + h * h / 2 * a2[0], u[1] + h * v[1] + h * h / 2 * a2[1]
        vs[0], vs[1] = v[0] + h * a3[0], v[1] + h * a3[1]
        f(t + h, us, vs, p, a4)
        u[0] += h * v[0] + h * h / 6 * (a1[0] + a2[0] + a3[0])
        u[1] += h * v[1] + h * h / 6 * (a1[1] + a2[1] + a3[1])
        v[0] += h / 6 * (a1[0] + 2 * a2[0] + 2 * a3[0] + a4[0])
        v[1] += h / 6 * (a1[1] + 2 * a2[1] + 2 * a3[1] + a4[1])
        u_rows[i, 0], u_rows[i, 1], v_rows[i, 0], v_rows[i, 1] = u[0], u[1], v[0], v[1]


def ab2_pair(f, u, v, p, h, n, u_rows, v_rows):
    a, a_past = np.empty(2), np.empty(2)
    f(0.0, u, v, p, a_past)
    p0, p1 = v[0] - h * a_past[0], v[1] - h * a_past[1]
    for i in range(n):
        f(i * h, u, v, p, a)
        v0, v1 = v[0], v[1]
        u[0] += h * (1.5 * v0 - 0.5 * p0)
        u[1] += h * (1.5 * v1 - 0.5 * p1)
        v[0] += h * (1.5 * a[0] - 0.5 * a_past[0])
        v[1] += h * (1.5 * a[1] - 0.5 * a_past[1])
        p0, p1, a_past[0], a_past[1] = v0, v1, a[0], a[1]
        u_rows[i, 0], u_rows[i, 1], v_rows[i, 0], v_rows[i, 1] = u[0], u[1], v[0], v[1]


def ab3_pair(f, u, v, p, h, n, u_rows, v_rows):
    # a constant past is enough: the benchmark does not time the two steps of a better start
    a, a1, a2 = np.empty(2), np.empty(2), np.empty(2)
    f(0.0, u, v, p, a1)
    a2[0], a2[1] = a1[0], a1[1]
    v1, v2 = v.copy(), v.copy()
    for i in range(n):
        f(i * h, u, v, p, a)
        for j in range(2):
            now = v[j]
            u[j] += h / 12 * (23 * now - 16 * v1[j] + 5 * v2[j])
            v[j] += h / 12 * (23 * a[j] - 16 * a1[j] + 5 * a2[j])
            v2[j], v1[j], a2[j], a1[j] = v1[j], now, a1[j], a[j]
            u_rows[i, j], v_rows[i, j] = u[j], v[j]


def floor_scalar(f, u, v, p, h, n, u_rows, v_rows):
    """A lower bound of the time of a step: one evaluation and one multiply-add, on the stored states of another run."""
    for i in range(n):
        u = u_rows[i] + 1e-30 * f(i * h, u, v_rows[i], p)
    return u


def floor_pair(f, u, v, p, h, n, u_rows, v_rows):
    a = np.empty(2)
    for i in range(n):
        v[0], v[1] = v_rows[i, 0], v_rows[i, 1]
        f(i * h, u, v, p, a)
        u[0], u[1] = u_rows[i, 0] + 1e-30 * a[0], u_rows[i, 1] + 1e-30 * a[1]
    return u[0] + u[1]
