/* link_entries.c - the values of a component that are known in the simulation, and lists of them: runs
 * of neighbouring references, as the protocol has them. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "link.h"

Entry *entry_of(Link *l, ValueType type, fmi2ValueReference reference, size_t guess)
{
    for (size_t k = 0; k < l->entries; k++) {
        Entry *e = &l->entry[(guess + k) % l->entries];
        if (e->reference == reference && e->type == type) return e;
    }
    if (l->entries == l->room) {
        size_t room = 2 * l->room + 64;
        Entry *more = realloc(l->entry, room * sizeof *more);
        if (!more) return NULL;
        l->entry = more;
        l->room = room;
    }
    l->entry[l->entries] = (Entry){.type = type, .reference = reference};
    return &l->entry[l->entries++];
}

void forget(Link *l, bool pending)
{
    for (Entry *e = l->entry; e < l->entry + l->entries; e++) {
        e->valid = false;
        if (pending) e->pending = false;
    }
}

bool is_pending(const Entry *e) { return e->pending; }
bool is_read(const Entry *e) { return e->read; }
bool is_missing(const Entry *e) { return e->read && !e->valid; }

bool any(const Link *l, Chosen *chosen)
{
    for (const Entry *e = l->entry; e < l->entry + l->entries; e++)
        if (chosen(e)) return true;
    return false;
}

/* neighbours from *at on that make a run, also on the list that is sent; 0: there is none left */
static size_t next_run(const Link *l, Chosen *chosen, size_t *at)
{
    while (*at < l->entries && !chosen(&l->entry[*at])) ++*at;
    const Entry *first = l->entry + *at;
    size_t count = 0;
    while (*at + count < l->entries && count < UINT16_MAX && chosen(first + count) &&
           first[count].type == first->type &&
           first[count].reference == first->reference + (fmi2ValueReference)count)
        count++;
    return count;
}

static void put_values(Writer *w, const Entry *first, size_t count)
{
    for (const Entry *e = first; e < first + count; e++)
        if (e->type == REAL_TYPE) put_double(w, e->real);
        else put_number(w, (uint32_t)e->integer, 4);
}

void put_list(Link *l, Writer *w, Chosen *chosen, bool with_values)
{
    unsigned char *runs = w->bytes + w->used;
    size_t total = 0, at = 0, count;
    put_number(w, 0, 2);
    while ((count = next_run(l, chosen, &at)) > 0) {
        const Entry *first = l->entry + at;
        put_run(w, (RunOf){first->type, (uint16_t)count, first->reference});
        if (with_values) put_values(w, first, count);
        total++;
        at += count;
    }
    if (!w->full) store(runs, total, 2);
}

/* the values of an answer, in the order in which they were asked for */
bool take_values(Link *l, Chosen *chosen)
{
    Reader *r = &l->client.data;
    for (Entry *e = l->entry; e < l->entry + l->entries; e++) {
        if (!chosen(e)) continue;
        if (e->type == REAL_TYPE) e->real = take_double(r);
        else e->integer = (fmi2Integer)(int32_t)take_number(r, 4);
    }
    if (r->short_of || r->left) return false;
    for (Entry *e = l->entry; e < l->entry + l->entries; e++) e->valid |= chosen(e);
    return true;
}
