/* table.c - specimen of a table of vectors: arrays of one and two dimensions.
 *
 *   table  parameter of four rows and three columns, row after row: a vector for t = 0, 1, 2, 3 s
 *   gain   input of three elements
 *   r      output of three elements: gain * the vector, interpolated between the rows
 *   pair   output of two rows and three columns: the rows before and after t
 *
 * pair shows whether a tool takes rows for columns. After 3 s the last row holds. gain is sampled at
 * the beginning of a step. All numbers of the trace are exact in binary. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "types.h"

#define TOKEN "{5e0c1f5a-0003-4e6b-9d10-73a0b1c2d301}"
enum { ROWS = 4, COLUMNS = 3 };

typedef struct { double table[ROWS][COLUMNS], gain[COLUMNS], r[COLUMNS], pair[2][COLUMNS]; } Model;

static const Model start = {
    .table = {{0, 0.5, -1}, {1, 2, 4}, {-2, 8, 0.25}, {3, -1, 6}},
    .gain = {1, 1, 1},
};

static const Variable variables[] = {
    PARAMETER(1, FLOAT64, table),
    INPUT(2, FLOAT64, gain),
    OUTPUT(3, FLOAT64, r),
    OUTPUT(4, FLOAT64, pair),
};

#include "specimen.h"

static void publish(Model *m, double t)
{
    int row = t < 0 ? 0 : t < ROWS - 1 ? (int)t : ROWS - 1;
    int next = row < ROWS - 1 ? row + 1 : row;
    double part = t < ROWS - 1 ? t - row : 0;
    for (int k = 0; k < COLUMNS; k++) {
        m->pair[0][k] = m->table[row][k];
        m->pair[1][k] = m->table[next][k];
        m->r[k] = m->gain[k] * (m->pair[0][k] + part * (m->pair[1][k] - m->pair[0][k]));
    }
}

static void evaluate(Instance *c) { publish(&c->m, c->time); }

static void update(Instance *c) { (void)c; }

static double step(Instance *c, double t, double h)
{
    publish(&c->m, t + h);
    return t + h;
}
