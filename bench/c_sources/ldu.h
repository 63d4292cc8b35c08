/* P A Q = L D U with rook pivoting, which the article uses for Newton's step; a is n x n, stored by rows. */

static inline void swap(double *x, double *y)
{
    const double z = *x;
    *x = *y;
    *y = z;
}

static inline int factorise(double *a, int n, int *rows, int *columns)
{
    for (int k = 0; k < n; k++) {
        int row = k, column = k, moved = 1;
        while (moved) {
            moved = 0;
            for (int i = k; i < n; i++)
                if (fabs(a[i * n + column]) > fabs(a[row * n + column]))
                    row = i, moved = 1;
            for (int j = k; j < n; j++)
                if (fabs(a[row * n + j]) > fabs(a[row * n + column]))
                    column = j, moved = 1;
        }
        rows[k] = row;
        columns[k] = column;
        if (row != k)
            for (int j = 0; j < n; j++)
                swap(&a[k * n + j], &a[row * n + j]);
        if (column != k)
            for (int i = 0; i < n; i++)
                swap(&a[i * n + k], &a[i * n + column]);
        if (a[k * n + k] == 0)
            return 0;
        for (int i = k + 1; i < n; i++) {
            a[i * n + k] /= a[k * n + k];
            for (int j = k + 1; j < n; j++)
                a[i * n + j] -= a[i * n + k] * a[k * n + j];
        }
        for (int j = k + 1; j < n; j++)
            a[k * n + j] /= a[k * n + k];
    }
    return 1;
}

static inline void solve(const double *a, int n, const int *rows, const int *columns, double *b)
{
    for (int k = 0; k < n; k++)
        swap(&b[k], &b[rows[k]]);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < i; j++)
            b[i] -= a[i * n + j] * b[j];
    for (int i = 0; i < n; i++)
        b[i] /= a[i * n + i];
    for (int i = n - 1; i >= 0; i--)
        for (int j = i + 1; j < n; j++)
            b[i] -= a[i * n + j] * b[j];
    for (int k = n - 1; k >= 0; k--)
        swap(&b[k], &b[columns[k]]);
}
