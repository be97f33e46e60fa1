/* fly.c - a fused system in a web page: new values, initialization, macro steps in chunks.
 *
 * There is one instance, over the adapter that every FMU has, so refusals come in its words. A page
 * calls renew, set, begin, then fly until all macro steps are done; after a call that answers 0, or
 * fewer steps than were asked for, said() tells why. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "life.h"

#if defined __wasm__
#define PAGE(name) __attribute__((export_name(#name)))
#else
#define PAGE(name)
#endif

enum { LONGEST_LINE = sizeof(Problems) + 200 };

static Instance *flown;
static char line[LONGEST_LINE];

typedef struct {
    double start, step; /* macro step k begins at start + k step [s] */
    int steps;          /* of the whole flight */
    int every;          /* rows: after every so many, and after the last */
} Flight;

static Flight flight;

static void keep_line(const Instance *instance, Status status, const char *category, char *text)
{
    (void)instance, (void)status, (void)category;
    snprintf(line, sizeof line, "%s", text);
}

static void nobody(void) {}

static int refuse_page(const char *text)
{
    snprintf(line, sizeof line, "%s", text);
    return 0;
}

/* memory for values and rows */
PAGE(room) void *room(size_t bytes);
void *room(size_t bytes) { return malloc(bytes); }

PAGE(said) const char *said(void);
const char *said(void) { return line; }

/* all values as in the module */
PAGE(renew) int renew(void);
int renew(void)
{
    static char name[] = "whole";
    Instance caller = {.name = name, .call = {.hand_over = keep_line, .logger = nobody}};
    line[0] = '\0';
    if (!flown) flown = new_instance(&caller);
    if (!flown) return refuse_page("out of memory");
    make_new(flown);
    return 1;
}

/* parameters and open inputs by value reference */
PAGE(set) int set(const unsigned vr[], const double value[], size_t count);
int set(const unsigned vr[], const double value[], size_t count)
{
    char name[NAME_SIZE];
    for (size_t i = 0; i < count; i++) {
        Scalar s = scalar_of(&fmu_model, vr[i]);
        if (!s.row || s.row->causality == OUTPUT_ROW) return refuse_page("no parameter or input");
        const char *rule = broken_rule(rule_when_set(s), value[i]);
        if (rule) {
            snprintf(line, sizeof line, "%s: %s", element_name(name, s), rule);
            return 0;
        }
        *pointer_to(flown->model, s) = value[i];
    }
    return 1;
}

static void write_row(const unsigned vr[], size_t width, double row[])
{
    for (size_t i = 0; i < width; i++)
        row[i] = value_of(flown->model, scalar_of(&fmu_model, vr[i]));
}

/* initialization; the first row */
PAGE(begin)
int begin(double start, double step, int steps, int every, const unsigned vr[], size_t width,
          double row[]);
int begin(double start, double step, int steps, int every, const unsigned vr[], size_t width,
          double row[])
{
    flight = (Flight){start, step, steps, every};
    set_span(flown, start, true, start + steps * step);
    flown->now.phase = INITIALIZING;
    if (!leave_initialization(flown, "initialization")) return 0;
    write_row(vr, width, row);
    return 1;
}

/* macro steps first .. last - 1, their rows; how many are done now */
PAGE(fly)
int fly(int first, int last, const unsigned vr[], size_t width, double rows[]);
int fly(int first, int last, const unsigned vr[], size_t width, double rows[])
{
    for (int k = first; k < last; k++) {
        if (!advance(flown, "step", flight.start + k * flight.step, flight.step)) return k;
        if ((k + 1) % flight.every == 0 || k + 1 == flight.steps) {
            write_row(vr, width, rows);
            rows += width;
        }
    }
    return last;
}
