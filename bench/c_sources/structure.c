/* EIG-3 and the central difference for M u'' + K u = 0, with lumped masses m and K in compressed rows. */

#include <stdint.h>

static void accelerations(long n, const double *data, const int32_t *indices, const int64_t *indptr, const double *m,
                          const double *u, double *a)
{
    for (long i = 0; i < n; i++) {
        double force = 0;
        for (int64_t k = indptr[i]; k < indptr[i + 1]; k++)
            force += data[k] * u[indices[k]];
        a[i] = -force / m[i];
    }
}

void eig3(long n, const double *data, const int32_t *indices, const int64_t *indptr, const double *m, double h,
          long steps, double *u, double *v, double *a, double *a_past)
{
    accelerations(n, data, indices, indptr, m, u, a_past);
    for (long s = 0; s < steps; s++) {
        accelerations(n, data, indices, indptr, m, u, a);
        for (long i = 0; i < n; i++) {
            u[i] += h * (v[i] + h / 2 * (2 * a[i] - a_past[i]));
            v[i] += h * (a[i] + 0.5 * (a[i] - a_past[i]));
            a_past[i] = a[i];
        }
    }
}

/* v holds the increments u - u_past. */
void cd(long n, const double *data, const int32_t *indices, const int64_t *indptr, const double *m, double h,
        long steps, double *u, double *v, double *a, double *a_past)
{
    for (long s = 0; s < steps; s++) {
        accelerations(n, data, indices, indptr, m, u, a);
        for (long i = 0; i < n; i++) {
            v[i] += h * h * a[i];
            u[i] += v[i];
        }
    }
}
