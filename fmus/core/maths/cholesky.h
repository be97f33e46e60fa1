/* cholesky.h - dense symmetric positive definite systems, in place, without allocation. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef CHOLESKY_H
#define CHOLESKY_H

#include <math.h>

/* decomposition A = L L^T; L replaces the lower triangle of a, by rows; `stride`: distance of
 * rows in doubles. Returns 0 if A is not positive definite. */
static inline int cholesky(double *a, int n, int stride)
{
    for (int j = 0; j < n; j++) {
        double *row = a + j * stride;
        for (int k = 0; k < j; k++) {
            double *above = a + k * stride, sum = row[k];
            for (int i = 0; i < k; i++) sum -= row[i] * above[i];
            row[k] = sum / above[k];
        }
        double pivot = row[j];
        for (int k = 0; k < j; k++) pivot -= row[k] * row[k];
        if (!(pivot > 0)) return 0;
        row[j] = sqrt(pivot);
    }
    return 1;
}

static inline void cholesky_solve(const double *l, int n, int stride, double *b) /* b := A^-1 b */
{
    for (int i = 0; i < n; i++) {
        const double *row = l + i * stride;
        double sum = b[i];
        for (int k = 0; k < i; k++) sum -= row[k] * b[k];
        b[i] = sum / row[i];
    }
    for (int i = n - 1; i >= 0; i--) {
        b[i] /= l[i * stride + i];
        for (int k = 0; k < i; k++) b[k] -= l[i * stride + k] * b[i];
    }
}

/* solution x of A x = b by elimination without square roots. The upper triangle of A is in the
 * first n < 8 columns of a, b is in column n; both are overwritten. The loop over row i begins at
 * column 0, or at HALF if i >= HALF, instead of the diagonal: with a constant number of passes,
 * compilers process two numbers at a time. The loop thus also changes elements left of the
 * diagonal, which may have any value and are not used. Returns 0 if A is not positive definite. */
enum { UPPER = 8, HALF = UPPER / 2 };
static inline int solve_upper(double a[][UPPER], int n, double *x)
{
    for (int j = 0; j < n; j++) {
        double row[UPPER];
        for (int k = 0; k < UPPER; k++) row[k] = a[j][k];
        if (!(row[j] > 0)) return 0;
        double inverse = 1 / row[j];
        for (int i = j + 1; i < n; i++) {
            double ratio = row[i] * inverse;
            for (int half = i & HALF; half < UPPER; half += HALF)
                for (int k = 0; k < HALF; k++) a[i][half + k] -= ratio * row[half + k];
        }
    }
    for (int i = n - 1; i >= 0; i--) {
        const double *row = a[i];
        double sum = row[n];
        for (int k = i + 1; k < n; k++) sum -= row[k] * x[k];
        x[i] = sum / row[i];
    }
    return 1;
}

#endif
