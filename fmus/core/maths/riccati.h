/* riccati.h - algebraic Riccati and Lyapunov equations of sixth order, dense, without allocation.
 *
 *   Riccati:   A^T X + X A - X S X + Q = 0,     A - S X stable
 *   Lyapunov: T A + A^T T = C for many symmetric C and one stable A
 *
 * The Riccati equation is solved by the structure-preserving doubling algorithm (Chu, Fan & Lin
 * 2005), which converges quadratically for a stabilisable, detectable problem, followed by Newton
 * steps (Kleinman 1968) that bring stiff problems to full precision. The Lyapunov equation is
 * solved as 21 linear equations for the elements on and above the diagonal. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef RICCATI_H
#define RICCATI_H

#include "exact.h"

enum { ORDER = 6, ELEMENTS = ORDER * (ORDER + 1) / 2 };

typedef struct { double at[ORDER][ORDER]; } mat6;
typedef struct { double at[ELEMENTS]; } Packed; /* upper triangle of a symmetric matrix, by rows */
typedef struct { double at[ELEMENTS][ELEMENTS]; } LyapunovInverse;

/* ---- algebra ---- */
static inline mat6 sum6(double ka, mat6 a, double kb, mat6 b) /* ka a + kb b */
{
    for (int i = 0; i < ORDER; i++)
        for (int j = 0; j < ORDER; j++) a.at[i][j] = ka * a.at[i][j] + kb * b.at[i][j];
    return a;
}

static inline mat6 product6(mat6 a, mat6 b)
{
    mat6 c = {{{0}}};
    for (int i = 0; i < ORDER; i++)
        for (int k = 0; k < ORDER; k++)
            for (int j = 0; j < ORDER; j++) c.at[i][j] += a.at[i][k] * b.at[k][j];
    return c;
}

static inline mat6 transpose6(mat6 a)
{
    mat6 c;
    for (int i = 0; i < ORDER; i++)
        for (int j = 0; j < ORDER; j++) c.at[i][j] = a.at[j][i];
    return c;
}

static inline mat6 identity6(void)
{
    mat6 c = {{{0}}};
    for (int i = 0; i < ORDER; i++) c.at[i][i] = 1;
    return c;
}

static inline void exchange_rows(double *m, int columns, int i, int j)
{
    for (int k = 0; k < columns; k++) {
        double other = m[i * columns + k];
        m[i * columns + k] = m[j * columns + k];
        m[j * columns + k] = other;
    }
}

static inline int largest_below(const double *a, int n, int column)
{
    int best = column;
    for (int i = column + 1; i < n; i++)
        if (fabs(a[i * n + column]) > fabs(a[best * n + column])) best = i;
    return best;
}

/* solves a x = b for the n x m matrix x, which replaces b, by Gauss-Jordan elimination with row
 * pivoting; the n x n matrix a is overwritten */
static inline void solve_in_place(double *a, int n, double *b, int m)
{
    for (int c = 0; c < n; c++) {
        int pivot = largest_below(a, n, c);
        exchange_rows(a, n, c, pivot);
        exchange_rows(b, m, c, pivot);
        double scale_row = 1 / a[c * n + c];
        for (int k = c; k < n; k++) a[c * n + k] *= scale_row;
        for (int k = 0; k < m; k++) b[c * m + k] *= scale_row;
        for (int i = 0; i < n; i++) {
            double factor = i == c ? 0 : a[i * n + c];
            if (factor == 0) continue;
            for (int k = c; k < n; k++) a[i * n + k] -= factor * a[c * n + k];
            for (int k = 0; k < m; k++) b[i * m + k] -= factor * b[c * m + k];
        }
    }
}

static inline mat6 solve6(mat6 a, mat6 b) /* a^-1 b */
{
    solve_in_place(&a.at[0][0], ORDER, &b.at[0][0], ORDER);
    return b;
}

static inline double largest6(mat6 a)
{
    double largest = 0;
    for (int i = 0; i < ORDER; i++)
        for (int j = 0; j < ORDER; j++) largest = larger(largest, fabs(a.at[i][j]));
    return largest;
}

/* ---- Riccati by doubling ---- */
typedef struct { mat6 E, G, H; } Doubling;

/* start of the doubling algorithm: Cayley transform at the point 1; any positive point works and
 * affects only the speed of convergence.
 * B = A - I, W = B^T + Q B^-1 S, E = I + 2 W^-T, G = 2 B^-1 S W^-1, H = 2 W^-1 Q B^-1 */
static inline Doubling doubling_start(mat6 A, mat6 S, mat6 Q)
{
    mat6 I = identity6(), B_inverse = solve6(sum6(1, A, -1, I), I),
         B_inverse_S = product6(B_inverse, S);
    mat6 W = sum6(1, transpose6(sum6(1, A, -1, I)), 1, product6(Q, B_inverse_S)),
         W_inverse = solve6(W, I);
    return (Doubling){sum6(1, I, 2, transpose6(W_inverse)),
                      sum6(2, product6(B_inverse_S, W_inverse), 0, I),
                      sum6(2, product6(product6(W_inverse, Q), B_inverse), 0, I)};
}

/* one doubling: E := E N E,  G := G + E N G E^T,  H := H + E^T H N E,  N = (I + G H)^-1 */
static inline Doubling doubled(Doubling d)
{
    mat6 I = identity6(), N = solve6(sum6(1, I, 1, product6(d.G, d.H)), I), EN = product6(d.E, N),
         Et = transpose6(d.E);
    mat6 NE = product6(N, d.E);
    return (Doubling){product6(EN, d.E), sum6(1, d.G, 1, product6(product6(EN, d.G), Et)),
                      sum6(1, d.H, 1, product6(product6(Et, d.H), NE))};
}

/* ---- Lyapunov ---- */
static inline int element(int i, int j) /* index in Packed of row i, column j */
{
    int row = i < j ? i : j, column = i < j ? j : i;
    return row * ORDER - row * (row - 1) / 2 + column - row;
}

static inline Packed packed(mat6 m)
{
    Packed p;
    for (int i = 0; i < ORDER; i++)
        for (int j = i; j < ORDER; j++) p.at[element(i, j)] = m.at[i][j];
    return p;
}

static inline mat6 unpacked(Packed p)
{
    mat6 m;
    for (int i = 0; i < ORDER; i++)
        for (int j = 0; j < ORDER; j++) m.at[i][j] = p.at[element(i, j)];
    return m;
}

/* inverse of T -> T A + A^T T for packed T; row (i,j) of the equations: sum over k of T_ik
 * A_kj + T_kj A_ki */
static inline void lyapunov_inverse(mat6 A, LyapunovInverse *inverse)
{
    double equations[ELEMENTS][ELEMENTS];
    memset(equations, 0, sizeof equations);
    for (int i = 0; i < ORDER; i++)
        for (int j = i; j < ORDER; j++)
            for (int k = 0; k < ORDER; k++) {
                equations[element(i, j)][element(i, k)] += A.at[k][j];
                equations[element(i, j)][element(k, j)] += A.at[k][i];
            }
    for (int i = 0; i < ELEMENTS; i++)
        for (int j = 0; j < ELEMENTS; j++) inverse->at[i][j] = i == j;
    solve_in_place(&equations[0][0], ELEMENTS, &inverse->at[0][0], ELEMENTS);
}

static inline mat6 lyapunov(const LyapunovInverse *inverse, mat6 C)
{
    Packed c = packed(C), t = {{0}};
    for (int i = 0; i < ELEMENTS; i++)
        for (int j = 0; j < ELEMENTS; j++) t.at[i] += inverse->at[i][j] * c.at[j];
    return unpacked(t);
}

/* ---- Riccati by Newton steps ---- */
/* X after one Newton step, X+: (A - S X)^T X+ + X+ (A - S X) = -(Q + X S X) */
static inline mat6 refined(mat6 A, mat6 S, mat6 Q, mat6 X, LyapunovInverse *workspace)
{
    mat6 SX = product6(S, X);
    lyapunov_inverse(sum6(1, A, -1, SX), workspace);
    return lyapunov(workspace, sum6(-1, Q, -1, product6(X, SX)));
}

/* stabilising solution X of the Riccati equation. workspace: 3.5 kB, provided by the
 * caller so that this function does not need them on the stack */
static inline mat6 riccati(mat6 A, mat6 S, mat6 Q, LyapunovInverse *workspace)
{
    Doubling d = doubling_start(A, S, Q);
    for (int k = 0; k < 60; k++) {
        Doubling next = doubled(d);
        double change = largest6(sum6(1, next.H, -1, d.H));
        d = next;
        if (!(change > 1e-16 * largest6(d.H))) break;
    }
    mat6 X = sum6(0.5, d.H, 0.5, transpose6(d.H));
    for (int k = 0; k < 3; k++)
        X = refined(A, S, Q, X,
                    workspace); /* restores digits that the doubling loses in stiff problems */
    return X;
}

#endif
