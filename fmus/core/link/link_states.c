/* link_states.c - states of a link FMU: what the component has serialized, and where the link is. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "link.h"

typedef struct {
    uint64_t guid; /* CRC of the interface: a state belongs to it and no other */
    uint64_t sum;  /* over the rest */
    uint64_t size; /* bytes of the component */
    uint64_t stepping, behind;
    double start, stop, time, bounded;
    unsigned char bytes[];
} Saved;

static uint64_t mark_of(const Link *l)
{
    const char *guid = l->client.config.guid;
    return crc_of(0, guid, strlen(guid));
}
static size_t whole(const Saved *s) { return sizeof *s + s->size; }
static uint64_t sum_of(const Saved *s)
{
    return crc_of(0, &s->size, whole(s) - offsetof(Saved, size));
}

fmi2Status fmi2GetFMUstate(fmi2Component component, fmi2FMUstate *state)
{
    Link *l = component;
    if (!state) return failure(l, "fmi2GetFMUstate", "missing pointer");
    fmi2Status status = flush(l);
    if (status <= fmi2Warning) status = plain(l, SAVE);
    if (status > fmi2Warning) return status;
    const Reader *r = &l->client.data;
    Saved *s = realloc(*state, sizeof *s + r->left);
    if (!s) return failure(l, "fmi2GetFMUstate", "out of memory");
    *s = (Saved){mark_of(l), 0,       r->left, l->stepping, l->behind,
                 l->start,   l->stop, l->time, l->bounded};
    memcpy(s->bytes, r->bytes, r->left);
    s->sum = sum_of(s);
    *state = s;
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component component, fmi2FMUstate state)
{
    Link *l = component;
    const Saved *s = state;
    if (!s) return failure(l, "fmi2SetFMUstate", "missing state");
    unsigned status = settle(l);
    Writer w = new_request(&l->client);
    put_bytes(&w, s->bytes, s->size);
    if (status <= fmi2Warning) status = ask(&l->client, RESTORE, &w);
    forget(l, true);
    if (status > fmi2Warning) return told(l, status);
    l->stepping = s->stepping != 0;
    l->behind = s->behind != 0;
    l->start = s->start, l->stop = s->stop, l->time = s->time;
    l->bounded = s->bounded != 0;
    return told(l, status);
}

fmi2Status fmi2FreeFMUstate(fmi2Component component, fmi2FMUstate *state)
{
    (void)component;
    if (state) free(*state), *state = NULL;
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component component, fmi2FMUstate state, size_t *size)
{
    if (!state || !size)
        return failure(component, "fmi2SerializedFMUstateSize", "missing state or pointer");
    *size = whole(state);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component component, fmi2FMUstate state, fmi2Byte bytes[],
                                 size_t size)
{
    if (!state || !bytes || size < whole(state))
        return failure(component, "fmi2SerializeFMUstate", "missing state, or too small an array");
    memcpy(bytes, state, whole(state));
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component component, const fmi2Byte bytes[], size_t size,
                                   fmi2FMUstate *state)
{
    Link *l = component;
    Saved *s = bytes && state && size >= sizeof *s ? calloc(1, size) : NULL;
    if (s) memcpy(s, bytes, size);
    if (!s || s->guid != mark_of(l) || s->size != size - sizeof *s || s->sum != sum_of(s)) {
        free(s);
        return failure(l, "fmi2DeSerializeFMUstate",
                       "the bytes are damaged or belong to another FMU");
    }
    *state = s;
    return fmi2OK;
}
