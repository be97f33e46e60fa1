/* covariance.h - covariance of a Kalman filter: propagation, and update by a measured vector of
 * three elements.
 *
 * P is n x n, row major, n <= MOST_STATES, symmetric; the transition matrix is I + F. There is no
 * allocation; only 3x3 matrices are inverted. Products with zeros are skipped: rows of F for
 * constant states, other zero elements of F, blocks of H for states that a measurement does not
 * contain. Equations: docs/models.md F.3. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef COVARIANCE_H
#define COVARIANCE_H

#include "mat3.h"

#include <string.h>

enum { MOST_STATES = 23, MOST_BLOCKS = 3, AT_ONCE = 4 /* columns computed at once */ };

/* sets the 3x3 block at (row, column) of a matrix M with n columns; add_block() adds to it */
static inline void put_block(double *M, size_t n, size_t row, size_t column, mat3 block)
{
    for (size_t i = 0; i < 3; i++) {
        double *at = M + (row + i) * n + column;
        at[0] = block.row[i].x, at[1] = block.row[i].y, at[2] = block.row[i].z;
    }
}
static inline void add_block(double *M, size_t n, size_t row, size_t column, mat3 block)
{
    for (size_t i = 0; i < 3; i++) {
        double *at = M + (row + i) * n + column;
        at[0] += block.row[i].x, at[1] += block.row[i].y, at[2] += block.row[i].z;
    }
}
static inline vec3 three(const double *x) { return vec(x[0], x[1], x[2]); }

/* standard deviations: square roots of the diagonal elements i to i + 2 of P */
static inline vec3 sigma_at(const double *P, size_t n, size_t i)
{
    const double *at = P + i * (n + 1);
    return vec(sqrt(at[0]), sqrt(at[n + 1]), sqrt(at[2 * (n + 1)]));
}

static inline void symmetrise(double *P, size_t n)
{
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < i; j++)
            P[i * n + j] = P[j * n + i] = (P[i * n + j] + P[j * n + i]) / 2;
}

/* sets the first `moving` rows and the first `columns` columns of the result to (I + F) M. As
 * AT_ONCE columns are computed at once, up to AT_ONCE - 1 more columns are set. M and the result
 * have n columns; zeros of F are skipped. */
static inline void transition_times(const double *F, size_t moving, const double *M, size_t columns,
                                    double *result, size_t n)
{
    double f[MOST_STATES] = {0};
    size_t row[MOST_STATES] = {0};
    for (size_t i = 0; i < moving; i++) {
        size_t count = 0;
        for (size_t k = 0; k < n; k++) {
            if (F[i * n + k] == 0) continue;
            f[count] = F[i * n + k];
            row[count++] = k * n;
        }
        for (size_t j = 0; j < columns; j += AT_ONCE) {
            size_t at = j + AT_ONCE <= n ? j : n - AT_ONCE;
            const double *m = M + i * n + at;
            double a = m[0], b = m[1], c = m[2], d = m[3];
            for (size_t k = 0; k < count; k++) {
                m = M + row[k] + at;
                a += f[k] * m[0], b += f[k] * m[1], c += f[k] * m[2], d += f[k] * m[3];
            }
            double *to = result + i * n + at;
            to[0] = a, to[1] = b, to[2] = c, to[3] = d;
        }
    }
}

/* P <- (I + F) P (I + F)^T, computed as (I + F) ((I + F) P)^T of a symmetric P; the caller makes
 * P symmetric after adding noise. Only the first `moving` rows of F are not zero: the other states
 * are constant. The covariance between constant and moving states is taken from (I + F) P; the
 * covariance of the constant states does not change. */
static inline void propagate_covariance(double *P, const double *F, size_t moving, size_t n)
{
    double half[MOST_STATES * MOST_STATES], transposed[MOST_STATES * MOST_STATES];
    size_t used = moving + AT_ONCE < n ? moving + AT_ONCE : n; /* columns used */
    transition_times(F, moving, P, n, half, n);
    for (size_t i = 0; i < used; i++)
        for (size_t j = 0; j < n; j++) transposed[j * n + i] = (i < moving ? half : P)[i * n + j];
    transition_times(F, moving, transposed, moving, P, n);
    for (size_t i = 0; i < moving; i++)
        for (size_t j = moving; j < n; j++) P[i * n + j] = P[j * n + i] = half[i * n + j];
}

/* adds to P the covariance q [T^3/3, T^2/2; T^2/2, T] of three position states and their rates
 * after the time T, caused by white noise of density q in the acceleration; position, rate: index
 * of the first of the three positions, of the first of the three rates */
static inline void add_white_acceleration(double *P, size_t n, size_t position, size_t rate,
                                          double q, double T)
{
    add_block(P, n, position, position, identity(q * T * T * T / 3));
    add_block(P, n, position, rate, identity(q * T * T / 2));
    add_block(P, n, rate, position, identity(q * T * T / 2));
    add_block(P, n, rate, rate, identity(q * T));
}

/* residual of a measurement, y = H dx + noise with covariance R, dx: errors of the states; H is
 * zero except for `count` 3x3 blocks, each from column `at` on */
typedef struct {
    vec3 y;
    mat3 R;
    size_t count;
    struct {
        size_t at;
        mat3 H;
    } block[MOST_BLOCKS];
} Residual;

/* one row of M H^T, from that row of M */
static inline vec3 row_times_H_transposed(const Residual *m, const double *row)
{
    vec3 sum = vec(0, 0, 0);
    for (size_t b = 0; b < m->count; b++)
        sum = add(sum, mul(m->block[b].H, three(row + m->block[b].at)));
    return sum;
}

/* covariance of the innovation, S = H P H^T + R, from the rows of P H^T */
static inline mat3 innovation_covariance(const Residual *m, const vec3 *PHt)
{
    mat3 S = m->R;
    for (size_t b = 0; b < m->count; b++) {
        const vec3 *a = PHt + m->block[b].at;
        S = plus(S, matmul(m->block[b].H, rows(a[0], a[1], a[2])));
    }
    return S;
}

/* updates P in place by the Joseph form: M = (I - K H) P, then P = M (I - K H)^T + K R K^T; K, PHt:
 * rows of the gain K and of P H^T */
static inline void joseph_update(double *P, size_t n, const Residual *m, const vec3 *K,
                                 const vec3 *PHt)
{
    for (size_t i = 0; i < n; i++) {
        double *row = P + i * n;
        for (size_t j = 0; j < n; j++) row[j] -= dot(K[i], PHt[j]);
        vec3 rest = sub(mul(m->R, K[i]), row_times_H_transposed(m, row));
        for (size_t j = 0; j < n; j++) row[j] += dot(rest, K[j]);
    }
    symmetrise(P, n);
}

/* updates P by a residual and sets dx: S = H P H^T + R, K = P H^T S^-1, dx = K y; returns the
 * normalised innovation squared y^T S^-1 y */
static inline double update_covariance(double *P, size_t n, const Residual *m, double *dx)
{
    vec3 PHt[MOST_STATES], K[MOST_STATES];
    for (size_t i = 0; i < n; i++) PHt[i] = row_times_H_transposed(m, P + i * n);
    mat3 S = inverted(innovation_covariance(m, PHt));
    for (size_t i = 0; i < n; i++) {
        K[i] = mul(S, PHt[i]);
        dx[i] = dot(K[i], m->y);
    }
    joseph_update(P, n, m, K, PHt);
    return dot(m->y, mul(S, m->y));
}

#endif
