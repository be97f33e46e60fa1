/* link.h - state of a link FMU and declarations shared by its files:
 *
 *   link.c           life cycle: instantiation, initialization, end
 *   link_values.c    setting and getting
 *   link_step.c      the step, and late answers
 *   link_states.c    saving and restoring
 *   link_requests.c  requests to the board, and log messages for the master
 *   link_entries.c   values known in the simulation, and their lists in requests */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef LINK_H
#define LINK_H

#include "client.h"
#include "fmi2Functions.h"
#include "link_statistics.h"

typedef struct {
    ValueType type;
    fmi2ValueReference reference;
    /* pending: set by the master, not yet sent; read: read by the master at least once; valid: need
     * not be requested, because it equals the board's value or is held until a late answer */
    bool pending, read, valid;
    double real;
    fmi2Integer integer;
} Entry;

typedef struct {
    fmi2CallbackFunctions call;
    char *name;
    bool log_warnings, log_statistics; /* log categories that are switched on */
    Entry *entry;
    size_t entries, capacity;
    /* stepping: initialization has ended; behind: steps after `time` are not sent yet */
    bool stepping, behind;
    double start, stop, time; /* s; time: end of the last step sent to the board */
    fmi2Boolean bounded;
    size_t late;
    Client client;
} Link;

/* ---- link_entries.c */
typedef bool EntryFilter(const Entry *e);
EntryFilter is_pending, was_read, needs_value;

Entry *find_or_add_entry(Link *l, ValueType type, fmi2ValueReference reference, size_t guess);
void invalidate(Link *l,
                bool pending); /* declares all values invalid; pending: also drops unsent values */
bool any_entry(const Link *l, EntryFilter *filter);
void put_list(Link *l, Writer *w, EntryFilter *filter, bool with_values);
/* stores the values of an answer in the entries that pass the filter; false: the number of values
 * is wrong */
bool take_values(Link *l, EntryFilter *filter);

/* ---- link_requests.c */
/* logs the text and returns fmi2Error */
fmi2Status failure(const Link *l, const char *function, const char *text);
/* logs the message of an answer that is a warning or an error, and returns `status` */
fmi2Status report_answer(Link *l, unsigned status);
void log_line(const Link *l, fmi2Status status, const char *category, const char *text);

unsigned finish_exchange(Link *l, unsigned status);
/* waits for the late answer of an earlier step, if there is one, and returns its status */
unsigned finish_late_answer(Link *l);
fmi2Status send_simple_request(Link *l, Code code); /* without payload */
fmi2Status send_pending(Link *l);                   /* sends values that have been set */
/* requests from the board all values that the master has read before and that are not valid in
 * the link */
fmi2Status read_missing(Link *l);

#endif
