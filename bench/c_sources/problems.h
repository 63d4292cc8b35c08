/* The right-hand sides of the article's four problems. */
#include <math.h>

static inline double single_dof(double t, double u, double v, const double *p)
{
    (void)t, (void)v;
    return -p[0] * p[0] * u;
}

static inline double hardening_spring(double t, double u, double v, const double *p)
{
    (void)t, (void)v;
    return -p[0] * u * (1 + p[1] * u * u);
}

static inline double softening_spring(double t, double u, double v, const double *p)
{
    (void)t, (void)v;
    return -p[0] * tanh(u);
}

static inline void spring_pendulum(double t, const double *u, const double *v, const double *p, double *a)
{
    const double m = p[0], l0 = p[1], k = p[2], g = p[3], r = u[0];
    (void)t;
    a[0] = r * v[1] * v[1] - k / m * (r - l0) + g * cos(u[1]);
    a[1] = -(2 * v[0] * v[1] + g * sin(u[1])) / r;
}
