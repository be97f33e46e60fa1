/* simulation.c - a fused system in a web page: new values, initialization, macro steps in chunks.
 *
 * There is one instance of the system. It uses the same adapter as every FMU, so that error
 * messages are the same. A page calls restart, set, begin, then run until all macro steps are done.
 * After a call that returns 0, or fewer steps than requested, message() returns the reason. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "life.h"

#if defined __wasm__
#define PAGE(name) __attribute__((export_name(#name)))
#else
#define PAGE(name)
#endif

enum { LONGEST_LINE = sizeof(Problems) + 200 };

static Instance *whole;
static char line[LONGEST_LINE];

typedef struct {
    double start, step; /* macro step k begins at start + k step [s] */
    int steps;          /* number of macro steps of the run */
    int every;          /* macro steps between two rows; the last macro step also gives a row */
} Schedule;

static Schedule schedule;

static void store_line(const Instance *instance, Status status, const char *category, char *text)
{
    (void)instance, (void)status, (void)category;
    snprintf(line, sizeof line, "%s", text);
}

static void ignore(void) {}

static int fail(const char *text)
{
    snprintf(line, sizeof line, "%s", text);
    return 0;
}

/* returns new memory for values and rows; its size is in bytes */
PAGE(reserve) void *reserve(size_t bytes);
void *reserve(size_t bytes) { return malloc(bytes); }

/* reason of the last failure since restart; empty if nothing has failed */
PAGE(message) const char *message(void);
const char *message(void) { return line; }

/* resets all values to the start values of the module */
PAGE(restart) int restart(void);
int restart(void)
{
    static char name[] = "whole";
    Instance caller = {.name = name, .call = {.write_line = store_line, .logger = ignore}};
    line[0] = '\0';
    if (!whole) whole = new_instance(&caller);
    if (!whole) return fail("out of memory");
    reset_model(whole);
    return 1;
}

/* sets parameters and open inputs by their value references */
PAGE(set) int set(const unsigned vr[], const double value[], size_t count);
int set(const unsigned vr[], const double value[], size_t count)
{
    char name[NAME_SIZE];
    for (size_t i = 0; i < count; i++) {
        Scalar s = scalar_of(&fmu_model, vr[i]);
        if (!s.row || s.row->causality == OUTPUT_ROW)
            return fail("a value reference belongs to no parameter and no input");
        const char *rule = violated_rule(rule_when_set(s), value[i]);
        if (rule) {
            snprintf(line, sizeof line, "%s: %s", element_name(name, s), rule);
            return 0;
        }
        *pointer_to(whole->model, s) = value[i];
    }
    return 1;
}

static void write_row(const unsigned vr[], size_t width, double row[])
{
    for (size_t i = 0; i < width; i++)
        row[i] = value_of(whole->model, scalar_of(&fmu_model, vr[i]));
}

/* initializes the system and writes the first row: the values of the `width` variables `vr`;
 * `every`: macro steps between two rows. Returns 0 if the initialization fails */
PAGE(begin)
int begin(double start, double step, int steps, int every, const unsigned vr[], size_t width,
          double row[]);
int begin(double start, double step, int steps, int every, const unsigned vr[], size_t width,
          double row[])
{
    schedule = (Schedule){start, step, steps, every};
    set_span(whole, start, true, start + steps * step);
    whole->now.phase = INITIALIZING;
    if (!leave_initialization(whole, "initialization")) return 0;
    write_row(vr, width, row);
    return 1;
}

/* does the macro steps first .. last - 1 and writes their rows, the values of the `width` variables
 * `vr`; returns the number of macro steps completed since the start, below `last` if one fails */
PAGE(run)
int run(int first, int last, const unsigned vr[], size_t width, double rows[]);
int run(int first, int last, const unsigned vr[], size_t width, double rows[])
{
    for (int k = first; k < last; k++) {
        if (!advance(whole, "step", schedule.start + k * schedule.step, schedule.step)) return k;
        if ((k + 1) % schedule.every == 0 || k + 1 == schedule.steps) {
            write_row(vr, width, rows);
            rows += width;
        }
    }
    return last;
}
