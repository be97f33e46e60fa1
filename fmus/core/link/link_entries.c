/* link_entries.c - values of a component that the master has set or read, and their lists in
 * requests. A list consists of runs: groups of values of one type with consecutive references. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "link.h"

Entry *find_or_add_entry(Link *l, ValueType type, fmi2ValueReference reference, size_t guess)
{
    for (size_t k = 0; k < l->entries; k++) {
        Entry *e = &l->entry[(guess + k) % l->entries];
        if (e->reference == reference && e->type == type) return e;
    }
    if (l->entries == l->capacity) {
        size_t capacity = 2 * l->capacity + 64;
        Entry *more = realloc(l->entry, capacity * sizeof *more);
        if (!more) return NULL;
        l->entry = more;
        l->capacity = capacity;
    }
    l->entry[l->entries] = (Entry){.type = type, .reference = reference};
    return &l->entry[l->entries++];
}

void invalidate(Link *l, bool pending)
{
    for (Entry *e = l->entry; e < l->entry + l->entries; e++) {
        e->valid = false;
        if (pending) e->pending = false;
    }
}

bool is_pending(const Entry *e) { return e->pending; }
bool was_read(const Entry *e) { return e->read; }
bool needs_value(const Entry *e) { return e->read && !e->valid; }

bool any_entry(const Link *l, EntryFilter *filter)
{
    for (const Entry *e = l->entry; e < l->entry + l->entries; e++)
        if (filter(e)) return true;
    return false;
}

/* length of the next run of entries that the filter selects, searched from index *at on; sets *at
 * to the first entry of the run; 0: there is none */
static size_t next_run(const Link *l, EntryFilter *filter, size_t *at)
{
    while (*at < l->entries && !filter(&l->entry[*at])) ++*at;
    const Entry *first = l->entry + *at;
    size_t count = 0;
    while (*at + count < l->entries && count < UINT16_MAX && filter(first + count) &&
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

void put_list(Link *l, Writer *w, EntryFilter *filter, bool with_values)
{
    unsigned char *runs = w->bytes + w->used;
    size_t total = 0, at = 0, count;
    put_number(w, 0, 2);
    while ((count = next_run(l, filter, &at)) > 0) {
        const Entry *first = l->entry + at;
        put_run(w, (RunOf){first->type, (uint16_t)count, first->reference});
        if (with_values) put_values(w, first, count);
        total++;
        at += count;
    }
    if (!w->full) store(runs, total, 2);
}

/* stores the values of an answer for the entries that the filter selects, in the order of the
 * request; false: too few or too many values */
bool take_values(Link *l, EntryFilter *filter)
{
    Reader *r = &l->client.data;
    for (Entry *e = l->entry; e < l->entry + l->entries; e++) {
        if (!filter(e)) continue;
        if (e->type == REAL_TYPE) e->real = take_double(r);
        else e->integer = (fmi2Integer)(int32_t)take_number(r, 4);
    }
    if (r->truncated || r->left) return false;
    for (Entry *e = l->entry; e < l->entry + l->entries; e++) e->valid |= filter(e);
    return true;
}
