/* symmetric3.h - eigenvalues and pseudo-inverse of a symmetric 3x3 matrix, by Jacobi rotations. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef SYMMETRIC3_H
#define SYMMETRIC3_H

#include "mat3.h"

typedef struct {
    vec3 value; /* eigenvalues in the order of `axis` */
    mat3 axis;  /* rows: eigenvectors */
} Eigen;

/* turns axes p and q of the symmetric matrix M by the angle phi after which M_pq = 0 (Jacobi
 * rotation): tan 2 phi = 2 M_pq/(M_qq - M_pp), with the smaller phi; V is the product of all
 * rotations, its rows are the turned axes */
static inline void rotate_away(double M[3][3], double V[3][3], int p, int q)
{
    if (M[p][q] == 0) return;
    double theta = (M[q][q] - M[p][p]) / (2 * M[p][q]);
    double t = (theta < 0 ? -1 : 1) / (fabs(theta) + sqrt(theta * theta + 1));
    double c = 1 / sqrt(t * t + 1), s = t * c;
    for (int k = 0; k < 3; k++) {
        double a = M[k][p], b = M[k][q];
        M[k][p] = c * a - s * b;
        M[k][q] = s * a + c * b;
    }
    for (int k = 0; k < 3; k++) {
        double a = M[p][k], b = M[q][k], v = V[p][k], w = V[q][k];
        M[p][k] = c * a - s * b;
        M[q][k] = s * a + c * b;
        V[p][k] = c * v - s * w;
        V[q][k] = s * v + c * w;
    }
}

/* eigenvalues and eigenvectors of a symmetric matrix by eight sweeps of rotations, three more than
 * needed, as convergence is quadratic */
static inline Eigen eigen(mat3 m)
{
    double M[3][3] = {{m.row[0].x, m.row[0].y, m.row[0].z},
                      {m.row[1].x, m.row[1].y, m.row[1].z},
                      {m.row[2].x, m.row[2].y, m.row[2].z}};
    double V[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    for (int sweep = 0; sweep < 8; sweep++) {
        rotate_away(M, V, 0, 1);
        rotate_away(M, V, 0, 2);
        rotate_away(M, V, 1, 2);
    }
    return (Eigen){vec(M[0][0], M[1][1], M[2][2]),
                   rows(vec(V[0][0], V[0][1], V[0][2]), vec(V[1][0], V[1][1], V[1][2]),
                        vec(V[2][0], V[2][1], V[2][2]))};
}

/* pseudo-inverse: sum of v v^T/lambda over the eigenvalues lambda above `relative_limit` times
 * the largest eigenvalue */
static inline mat3 pseudo_inverse(mat3 m, double relative_limit)
{
    Eigen e = eigen(m);
    double floor = relative_limit * larger(e.value.x, larger(e.value.y, e.value.z));
    double values[3] = {e.value.x, e.value.y, e.value.z};
    mat3 sum = diagonal(0, 0, 0);
    for (int k = 0; k < 3; k++)
        if (values[k] > floor)
            sum = plus(sum, scaled(1 / values[k], outer(e.axis.row[k], e.axis.row[k])));
    return sum;
}

#endif
