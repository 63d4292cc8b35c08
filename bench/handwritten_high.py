"""Loops written by hand, as in `handwritten`, for methods of high order.

EIG-5 and EIG-9 stand for their family, whose kernels come from one template. RK5 is written out. RK8 and BM6 loop over
their tables, as most users would. The coefficients of the tables are those of the library's kernels.
"""

import numba
import numpy as np

from eig3.kernels.methods import bm6, rk5, rk8

A5, B5, C5 = rk5.A, rk5.B, rk5.C
A8 = np.array([[*row, *[0.0] * (12 - len(row))] for row in [(), *rk8.A, rk8.B]])
C8 = np.array([*rk8.C, 1.0])
KICKS, DRIFTS, TIMES = np.array(bm6.KICKS), np.array(bm6.DRIFTS), np.array(bm6.TIMES)


@numba.njit
def rk4_step(f, t, u, v, p, h):
    """One step, with which a loop starts."""
    a1 = f(t, u, v, p)
    a2 = f(t + h / 2, u + h / 2 * v, v + h / 2 * a1, p)
    a3 = f(t + h / 2, u + h / 2 * v + h * h / 4 * a1, v + h / 2 * a2, p)
    a4 = f(t + h, u + h * v + h * h / 2 * a2, v + h * a3, p)
    return u + h * v + h * h / 6 * (a1 + a2 + a3), v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)


@numba.njit
def rk4_steps_pair(f, u, v, p, h, count, u_rows, v_rows, past):
    """The first steps; `past` gets the accelerations at the start of each and at the end, the newest first."""
    a1, a2, a3, a4, us, vs = np.empty(2), np.empty(2), np.empty(2), np.empty(2), np.empty(2), np.empty(2)
    for i in range(count):
        t = i * h
        f(t, u, v, p, a1)
        for j in range(2):
            past[count - i, j] = a1[j]
            us[j], vs[j] = u[j] + h / 2 * v[j], v[j] + h / 2 * a1[j]
        f(t + h / 2, us, vs, p, a2)
        for j in range(2):
            us[j], vs[j] = u[j] + h / 2 * v[j] + h * h / 4 * a1[j], v[j] + h / 2 * a2[j]
        f(t + h / 2, us, vs, p, a3)
        for j in range(2):
            us[j], vs[j] = u[j] + h * v[j] + h * h / 2 * a2[j], v[j] + h * a3[j]
        f(t + h, us, vs, p, a4)
        for j in range(2):
            u[j] += h * v[j] + h * h / 6 * (a1[j] + a2[j] + a3[j])
            v[j] += h / 6 * (a1[j] + 2 * a2[j] + 2 * a3[j] + a4[j])
            u_rows[i, j], v_rows[i, j] = u[j], v[j]
    f(count * h, u, v, p, past[0])


def eig5_scalar(f, u, v, p, h, n, u_rows, v_rows):
    past = np.empty(4)
    for i in range(3):
        past[3 - i] = f(i * h, u, v, p)
        u, v = rk4_step(f, i * h, u, v, p, h)
        u_rows[i], v_rows[i] = u, v
    a0, a1, a2, a3 = f(3 * h, u, v, p), past[1], past[2], past[3]
    w = v - h / 360 * (97 * a0 + 114 * a1 - 39 * a2 + 8 * a3)
    for i in range(3, n):
        w = w + h / 12 * (14 * a0 - 5 * a1 + 4 * a2 - a3)
        u = u + h * w
        predicted = w + h / 24 * (27 * a0 - 22 * a1 + 7 * a2)
        a1, a2, a3 = a0, a1, a2
        a0 = f((i + 1) * h, u, predicted, p)
        u_rows[i], v_rows[i] = u, w + h / 360 * (97 * a0 + 114 * a1 - 39 * a2 + 8 * a3)


def eig5_pair(f, u, v, p, h, n, u_rows, v_rows):
    past, w = np.empty((4, 2)), np.empty(2)
    rk4_steps_pair(f, u, v, p, h, 3, u_rows, v_rows, past)
    a0, a1, a2, a3 = past[0], past[1], past[2], past[3]
    for j in range(2):
        w[j] = v[j] - h / 360 * (97 * a0[j] + 114 * a1[j] - 39 * a2[j] + 8 * a3[j])
    for i in range(3, n):
        for j in range(2):
            w[j] += h / 12 * (14 * a0[j] - 5 * a1[j] + 4 * a2[j] - a3[j])
            u[j] += h * w[j]
            v[j] = w[j] + h / 24 * (27 * a0[j] - 22 * a1[j] + 7 * a2[j])
        a0, a1, a2, a3 = a3, a0, a1, a2
        f((i + 1) * h, u, v, p, a0)
        for j in range(2):
            v_rows[i, j] = w[j] + h / 360 * (97 * a0[j] + 114 * a1[j] - 39 * a2[j] + 8 * a3[j])
            u_rows[i, j] = u[j]


@numba.njit(inline="always")
def eig9_mean(a0, a1, a2, a3, a4, a5, a6, a7):
    late = 236568 * a4 - 117051 * a5 + 33190 * a6 - 4125 * a7
    return (88324 * a0 - 121797 * a1 + 245598 * a2 - 300227 * a3 + late) / 60480


@numba.njit(inline="always")
def eig9_predicted(a0, a1, a2, a3, a4, a5, a6):
    late = 606783 * a4 - 200838 * a5 + 28549 * a6
    return (257593 * a0 - 650982 * a1 + 1041699 * a2 - 1022324 * a3 + late) / 120960


@numba.njit(inline="always")
def eig9_reported(a0, a1, a2, a3, a4, a5, a6, a7):
    late = 362112 * a5 - 768805 * a4 - 99359 * a6 + 12062 * a7
    return (416173 * a0 + 950684 * a1 - 1025097 * a2 + 1059430 * a3 + late) / 1814400


def eig9_scalar(f, u, v, p, h, n, u_rows, v_rows):
    past = np.empty(8)
    for i in range(7):
        past[7 - i] = f(i * h, u, v, p)
        u, v = rk4_step(f, i * h, u, v, p, h)
        u_rows[i], v_rows[i] = u, v
    a1, a2, a3, a4, a5, a6, a7 = past[1], past[2], past[3], past[4], past[5], past[6], past[7]
    a0 = f(7 * h, u, v, p)
    w = v - h * eig9_reported(a0, a1, a2, a3, a4, a5, a6, a7)
    for i in range(7, n):
        w = w + h * eig9_mean(a0, a1, a2, a3, a4, a5, a6, a7)
        u = u + h * w
        predicted = w + h * eig9_predicted(a0, a1, a2, a3, a4, a5, a6)
        a1, a2, a3, a4, a5, a6, a7 = a0, a1, a2, a3, a4, a5, a6
        a0 = f((i + 1) * h, u, predicted, p)
        u_rows[i], v_rows[i] = u, w + h * eig9_reported(a0, a1, a2, a3, a4, a5, a6, a7)


def eig9_pair(f, u, v, p, h, n, u_rows, v_rows):
    past, w = np.empty((8, 2)), np.empty(2)
    rk4_steps_pair(f, u, v, p, h, 7, u_rows, v_rows, past)
    a0, a1, a2, a3, a4, a5, a6, a7 = past[0], past[1], past[2], past[3], past[4], past[5], past[6], past[7]
    for j in range(2):
        w[j] = v[j] - h * eig9_reported(a0[j], a1[j], a2[j], a3[j], a4[j], a5[j], a6[j], a7[j])
    for i in range(7, n):
        for j in range(2):
            w[j] += h * eig9_mean(a0[j], a1[j], a2[j], a3[j], a4[j], a5[j], a6[j], a7[j])
            u[j] += h * w[j]
            v[j] = w[j] + h * eig9_predicted(a0[j], a1[j], a2[j], a3[j], a4[j], a5[j], a6[j])
        a0, a1, a2, a3, a4, a5, a6, a7 = a7, a0, a1, a2, a3, a4, a5, a6
        f((i + 1) * h, u, v, p, a0)
        for j in range(2):
            v_rows[i, j] = w[j] + h * eig9_reported(a0[j], a1[j], a2[j], a3[j], a4[j], a5[j], a6[j], a7[j])
            u_rows[i, j] = u[j]


def rk5_scalar(f, u, v, p, h, n, u_rows, v_rows):
    for i in range(n):
        t = i * h
        a1 = f(t, u, v, p)
        v2 = v + h * (A5[0][0] * a1)
        a2 = f(t + C5[1] * h, u + h * (A5[0][0] * v), v2, p)
        v3 = v + h * (A5[1][0] * a1 + A5[1][1] * a2)
        a3 = f(t + C5[2] * h, u + h * (A5[1][0] * v + A5[1][1] * v2), v3, p)
        v4 = v + h * (A5[2][0] * a1 + A5[2][1] * a2 + A5[2][2] * a3)
        a4 = f(t + C5[3] * h, u + h * (A5[2][0] * v + A5[2][1] * v2 + A5[2][2] * v3), v4, p)
        v5 = v + h * (A5[3][0] * a1 + A5[3][1] * a2 + A5[3][2] * a3 + A5[3][3] * a4)
        u5 = u + h * (A5[3][0] * v + A5[3][1] * v2 + A5[3][2] * v3 + A5[3][3] * v4)
        a5 = f(t + C5[4] * h, u5, v5, p)
        v6 = v + h * (A5[4][0] * a1 + A5[4][1] * a2 + A5[4][2] * a3 + A5[4][3] * a4 + A5[4][4] * a5)
        u6 = u + h * (A5[4][0] * v + A5[4][1] * v2 + A5[4][2] * v3 + A5[4][3] * v4 + A5[4][4] * v5)
        a6 = f(t + h, u6, v6, p)
        u = u + h * (B5[0] * v + B5[1] * v2 + B5[2] * v3 + B5[3] * v4 + B5[4] * v5 + B5[5] * v6)
        v = v + h * (B5[0] * a1 + B5[1] * a2 + B5[2] * a3 + B5[3] * a4 + B5[4] * a5 + B5[5] * a6)
        u_rows[i], v_rows[i] = u, v


def rk5_pair(f, u, v, p, h, n, u_rows, v_rows):
    a1, a2, a3, a4, a5, a6 = np.empty(2), np.empty(2), np.empty(2), np.empty(2), np.empty(2), np.empty(2)
    v2, v3, v4, v5, v6, us = np.empty(2), np.empty(2), np.empty(2), np.empty(2), np.empty(2), np.empty(2)
    for i in range(n):
        t = i * h
        f(t, u, v, p, a1)
        for j in range(2):
            us[j], v2[j] = u[j] + h * (A5[0][0] * v[j]), v[j] + h * (A5[0][0] * a1[j])
        f(t + C5[1] * h, us, v2, p, a2)
        for j in range(2):
            us[j] = u[j] + h * (A5[1][0] * v[j] + A5[1][1] * v2[j])
            v3[j] = v[j] + h * (A5[1][0] * a1[j] + A5[1][1] * a2[j])
        f(t + C5[2] * h, us, v3, p, a3)
        for j in range(2):
            us[j] = u[j] + h * (A5[2][0] * v[j] + A5[2][1] * v2[j] + A5[2][2] * v3[j])
            v4[j] = v[j] + h * (A5[2][0] * a1[j] + A5[2][1] * a2[j] + A5[2][2] * a3[j])
        f(t + C5[3] * h, us, v4, p, a4)
        for j in range(2):
            us[j] = u[j] + h * (A5[3][0] * v[j] + A5[3][1] * v2[j] + A5[3][2] * v3[j] + A5[3][3] * v4[j])
            v5[j] = v[j] + h * (A5[3][0] * a1[j] + A5[3][1] * a2[j] + A5[3][2] * a3[j] + A5[3][3] * a4[j])
        f(t + C5[4] * h, us, v5, p, a5)
        for j in range(2):
            early = A5[4][0] * v[j] + A5[4][1] * v2[j] + A5[4][2] * v3[j]
            us[j] = u[j] + h * (early + A5[4][3] * v4[j] + A5[4][4] * v5[j])
            early = A5[4][0] * a1[j] + A5[4][1] * a2[j] + A5[4][2] * a3[j]
            v6[j] = v[j] + h * (early + A5[4][3] * a4[j] + A5[4][4] * a5[j])
        f(t + h, us, v6, p, a6)
        for j in range(2):
            early = B5[0] * v[j] + B5[1] * v2[j] + B5[2] * v3[j]
            u[j] += h * (early + B5[3] * v4[j] + B5[4] * v5[j] + B5[5] * v6[j])
            early = B5[0] * a1[j] + B5[1] * a2[j] + B5[2] * a3[j]
            v[j] += h * (early + B5[3] * a4[j] + B5[4] * a5[j] + B5[5] * a6[j])
            u_rows[i, j], v_rows[i, j] = u[j], v[j]


def rk8_scalar(f, u, v, p, h, n, u_rows, v_rows):
    a, w = np.empty(12), np.empty(12)
    for i in range(n):
        us, vs = u, v
        for k in range(12):
            w[k] = vs
            a[k] = f(i * h + C8[k] * h, us, vs, p)
            u_sum, v_sum = 0.0, 0.0
            for m in range(k + 1):
                u_sum += A8[k + 1, m] * w[m]
                v_sum += A8[k + 1, m] * a[m]
            us, vs = u + h * u_sum, v + h * v_sum
        u, v = us, vs
        u_rows[i], v_rows[i] = u, v


def rk8_pair(f, u, v, p, h, n, u_rows, v_rows):
    a, w, us, vs = np.empty((12, 2)), np.empty((12, 2)), np.empty(2), np.empty(2)
    for i in range(n):
        us[0], us[1], vs[0], vs[1] = u[0], u[1], v[0], v[1]
        for k in range(12):
            w[k, 0], w[k, 1] = vs[0], vs[1]
            f(i * h + C8[k] * h, us, vs, p, a[k])
            for j in range(2):
                u_sum, v_sum = 0.0, 0.0
                for m in range(k + 1):
                    u_sum += A8[k + 1, m] * w[m, j]
                    v_sum += A8[k + 1, m] * a[m, j]
                us[j], vs[j] = u[j] + h * u_sum, v[j] + h * v_sum
        u[0], u[1], v[0], v[1] = us[0], us[1], vs[0], vs[1]
        u_rows[i, 0], u_rows[i, 1], v_rows[i, 0], v_rows[i, 1] = u[0], u[1], v[0], v[1]


def bm6_scalar(f, u, v, p, h, n, u_rows, v_rows):
    a = f(0.0, u, v, p)
    for i in range(n):
        for k in range(11):
            v += KICKS[k] * h * a
            u += DRIFTS[k] * h * v
            a = f(i * h + TIMES[k] * h, u, v, p)
        v += KICKS[11] * h * a
        u_rows[i], v_rows[i] = u, v
