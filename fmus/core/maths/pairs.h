/* pairs.h - pairs of vectors, quaternions or matrices for two bodies, stored as one array per
 * component.
 *
 * In a loop over the pair, compilers then process both bodies at once; the results have the same
 * bits as if each body was processed alone. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef PAIRS_H
#define PAIRS_H

#include "attitude.h"

enum { PAIR = 2 };

typedef struct { double x[PAIR], y[PAIR], z[PAIR]; } vec3_pair;
typedef struct { vec3_pair row[3]; } mat3_pair;
typedef struct { double w[PAIR], x[PAIR], y[PAIR], z[PAIR]; } quat_pair;

static inline vec3 vec_of(const vec3_pair *a, int i) { return vec(a->x[i], a->y[i], a->z[i]); }
static inline void set_vec(vec3_pair *a, int i, vec3 b)
{
    a->x[i] = b.x;
    a->y[i] = b.y;
    a->z[i] = b.z;
}

static inline mat3 mat_of_pair(const mat3_pair *m, int i)
{
    return rows(vec_of(&m->row[0], i), vec_of(&m->row[1], i), vec_of(&m->row[2], i));
}
static inline void set_mat(mat3_pair *m, int i, mat3 b)
{
    set_vec(&m->row[0], i, b.row[0]);
    set_vec(&m->row[1], i, b.row[1]);
    set_vec(&m->row[2], i, b.row[2]);
}

static inline quat quat_of(const quat_pair *q, int i)
{
    return (quat){q->w[i], q->x[i], q->y[i], q->z[i]};
}
static inline void set_quat(quat_pair *q, int i, quat b)
{
    q->w[i] = b.w;
    q->x[i] = b.x;
    q->y[i] = b.y;
    q->z[i] = b.z;
}

#endif
