/* timeline.c - decisions of the ground (go, retreat, resume) and faults (navigation that is not
 * valid) by a table of times.
 *
 * The last row whose time is reached is in force. Before the first time go_1, go_2, go_3 and
 * relative_valid are 1, retreat and resume are 0. Columns of a row: go_1, go_2, go_3, retreat,
 * resume, relative_valid. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "fmu.h"
#include "time_grid.h"

enum { ROWS = 16 };

typedef struct { double go_1, go_2, go_3, retreat, resume, relative_valid; } Word;
typedef struct { Word row[ROWS]; } Table;
typedef struct {
    double times[ROWS];
    Table rows;
    double sample_period;
} Parameters;
typedef struct { double none; } Input;
typedef struct { double none; } State;
typedef Word Output;
MODEL_STRUCT;

#define LATER 1e30 /* time of a row that is not used */
#define GO    {.go_1 = 1, .go_2 = 1, .go_3 = 1, .relative_valid = 1}

static const Model start = {
    .p = {.times = {LATER, LATER, LATER, LATER, LATER, LATER, LATER, LATER, LATER, LATER, LATER,
                    LATER, LATER, LATER, LATER, LATER},
          .rows = {{GO, GO, GO, GO, GO, GO, GO, GO, GO, GO, GO, GO, GO, GO, GO, GO}}},
};

static const Variable variables[] = {
    PARAMETER(times, "s",
              "time from which a row is in force; ascending, 1e30 = unused; before the first: go_1 "
              "to 3, relative_valid 1, else 0"),
    ROW_AS(PARAMETER_ROW, p, "rows", rows, 6, "1",
           "elements of a row: go_1, go_2, go_3, retreat, resume, relative_valid; one row per time",
           SWITCH_VALUE),
    SAMPLE_PERIOD,

    FLAG(go_1, "1: go for the closing"),
    FLAG(go_2, "1: go for the fly-around"),
    FLAG(go_3, "1: go for mating"),
    FLAG(retreat, "1: ground orders the retreat"),
    FLAG(resume, "1: the ground permits a safely drifting servicer to resume the approach"),
    FLAG(relative_valid, "1: the estimates of target and servicer are valid"),
};

/* J.6-3 */
static void check(const Parameters *p, Problems *problems)
{
    char name[16];
    for (int i = 1; i < ROWS; i++) {
        snprintf(name, sizeof name, "times[%d]", i + 1);
        if (!(p->times[i] > p->times[i - 1] || p->times[i] == LATER))
            reject(problems, name, p->times[i], "must be above the previous time, or 1e30");
    }
}

/* J.6-1, J.6-2 */
static void publish(const Parameters *p, Output *y, double t)
{
    *y = (Word)GO;
    for (int i = 0; i < ROWS; i++)
        if (reached(t, p->times[i])) *y = p->rows.row[i];
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    (void)u, (void)x;
    publish(p, y, t);
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    (void)u, (void)x;
    for (Sample s = first_sample(t, h, p->sample_period); s.left > 0; s = next_sample(s))
        publish(p, y, s.t);
}

FMU_MODEL("timeline", "Decisions of the ground and faults by time: go, retreat, resume, validity");
