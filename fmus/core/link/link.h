/* link.h - the state of a link FMU, and what its files have in common.
 *
 *   link.c           life of the FMU: instantiation, initialization, end
 *   link_values.c    setting and getting
 *   link_step.c      the step, and answers that are late
 *   link_states.c    saving and restoring
 *   link_requests.c  requests to the board, with what a master is told of them
 *   link_entries.c   values known here, and the lists of them that are sent */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef LINK_H
#define LINK_H

#include "client.h"
#include "fmi2Functions.h"
#include "link_statistics.h"

typedef struct {
    ValueType type;
    fmi2ValueReference reference;
    bool pending, read, valid; /* set and not sent; ever read; value as on the board */
    double real;
    fmi2Integer integer;
} Entry;

typedef struct {
    fmi2CallbackFunctions call;
    char *name;
    bool warns, counts; /* log categories that are on */
    Entry *entry;
    size_t entries, room;
    bool stepping, behind;    /* behind: steps were held, the board has yet to make them */
    double start, stop, time; /* s; time: end of the last step that the board has been sent */
    fmi2Boolean bounded;
    size_t late;
    Client client;
} Link;

/* ---- link_entries.c */
typedef bool Chosen(const Entry *e);
Chosen is_pending, is_read, is_missing;

Entry *entry_of(Link *l, ValueType type, fmi2ValueReference reference, size_t guess);
void forget(Link *l, bool pending); /* values are not those of the board; nor what has been set */
bool any(const Link *l, Chosen *chosen);
void put_list(Link *l, Writer *w, Chosen *chosen, bool with_values);
bool take_values(Link *l, Chosen *chosen); /* of an answer, in the order of the list */

/* ---- link_requests.c */
fmi2Status failure(const Link *l, const char *function, const char *text); /* logs it */
fmi2Status told(Link *l, unsigned status); /* what the board has answered, logged */
void say(const Link *l, fmi2Status status, const char *category, const char *text);

unsigned finish_exchange(Link *l, unsigned status);
unsigned settle(Link *l);             /* an answer that was too late for its step */
fmi2Status plain(Link *l, Code code); /* a request without payload */
fmi2Status flush(Link *l);            /* what has been set goes to the board */
fmi2Status fetch(Link *l);            /* what is read and not known here comes from it */

#endif
