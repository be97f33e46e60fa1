/* columns.h - eight vectors, matrices or symmetric matrices, stored as one array per element (x, y,
 * z; xx, yy, ..).
 *
 * Compilers therefore process two of the eight at once in a loop over all eight; the results have
 * the same bits as if the loop processed one after the other. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef COLUMNS_H
#define COLUMNS_H

#include "sym3.h"

enum { COLUMNS = 8 };

typedef struct { double x[COLUMNS], y[COLUMNS], z[COLUMNS]; } vec3s;
typedef struct { vec3s row[3]; } mat3s;
typedef struct {
    double xx[COLUMNS], yy[COLUMNS], zz[COLUMNS], xy[COLUMNS], xz[COLUMNS], yz[COLUMNS];
} sym3s;

static inline vec3 vec_at(const vec3s *a, int i) { return vec(a->x[i], a->y[i], a->z[i]); }
static inline void put_vec(vec3s *a, int i, vec3 b)
{
    a->x[i] = b.x;
    a->y[i] = b.y;
    a->z[i] = b.z;
}

/* sets sum_i = from + step_0 + ... + step_(i-1) for i = 0 to 7; returns from + step_0 + ...
 * + step_7 */
static inline vec3 partial_sums(vec3s *restrict sum, vec3 from, const vec3s *restrict step)
{
    for (int i = 0; i < COLUMNS; i++) {
        put_vec(sum, i, from);
        from = add(from, vec_at(step, i));
    }
    return from;
}

static inline mat3 mat_at(const mat3s *m, int i)
{
    return rows(vec_at(&m->row[0], i), vec_at(&m->row[1], i), vec_at(&m->row[2], i));
}
static inline void put_mat(mat3s *m, int i, mat3 b)
{
    put_vec(&m->row[0], i, b.row[0]);
    put_vec(&m->row[1], i, b.row[1]);
    put_vec(&m->row[2], i, b.row[2]);
}

static inline sym3 sym_at(const sym3s *m, int i)
{
    return (sym3){m->xx[i], m->yy[i], m->zz[i], m->xy[i], m->xz[i], m->yz[i]};
}
static inline void put_sym(sym3s *m, int i, sym3 b)
{
    m->xx[i] = b.xx;
    m->yy[i] = b.yy;
    m->zz[i] = b.zz;
    m->xy[i] = b.xy;
    m->xz[i] = b.xz;
    m->yz[i] = b.yz;
}

#endif
