/* link_states.c - states of a link FMU: the serialized state of the component, and the state of the
 * link. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "link.h"

typedef struct {
    uint64_t guid; /* CRC of the guid; an FMU with another guid rejects the state */
    uint64_t sum;  /* checksum of the members from size to bytes */
    uint64_t size; /* bytes of the state of the component */
    uint64_t stepping, behind;
    double start, stop, time, bounded;
    unsigned char bytes[];
} Saved;

static uint64_t guid_checksum(const Link *l)
{
    const char *guid = l->client.config.guid;
    return crc_of(0, guid, strlen(guid));
}
static size_t saved_size(const Saved *s) { return sizeof *s + s->size; }
static uint64_t checksum(const Saved *s)
{
    return crc_of(0, &s->size, saved_size(s) - offsetof(Saved, size));
}

fmi2Status fmi2GetFMUstate(fmi2Component component, fmi2FMUstate *state)
{
    Link *l = component;
    if (!state) return failure(l, "fmi2GetFMUstate", "a pointer argument is NULL");
    fmi2Status status = send_pending(l);
    if (status <= fmi2Warning) status = send_simple_request(l, SAVE);
    if (status > fmi2Warning) return status;
    const Reader *r = &l->client.data;
    Saved *s = realloc(*state, sizeof *s + r->left);
    if (!s) return failure(l, "fmi2GetFMUstate", "out of memory");
    *s = (Saved){guid_checksum(l), 0,       r->left, l->stepping, l->behind,
                 l->start,         l->stop, l->time, l->bounded};
    memcpy(s->bytes, r->bytes, r->left);
    s->sum = checksum(s);
    *state = s;
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component component, fmi2FMUstate state)
{
    Link *l = component;
    const Saved *s = state;
    if (!s) return failure(l, "fmi2SetFMUstate", "the state is NULL");
    unsigned status = finish_late_answer(l);
    Writer w = new_request(&l->client);
    put_bytes(&w, s->bytes, s->size);
    if (status <= fmi2Warning) status = request_and_wait(&l->client, RESTORE, &w);
    invalidate(l, true);
    if (status > fmi2Warning) return report_answer(l, status);
    l->stepping = s->stepping != 0;
    l->behind = s->behind != 0;
    l->start = s->start, l->stop = s->stop, l->time = s->time;
    l->bounded = s->bounded != 0;
    return report_answer(l, status);
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
        return failure(component, "fmi2SerializedFMUstateSize",
                       "the state or the pointer to its size is NULL");
    *size = saved_size(state);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component component, fmi2FMUstate state, fmi2Byte bytes[],
                                 size_t size)
{
    if (!state || !bytes || size < saved_size(state))
        return failure(component, "fmi2SerializeFMUstate",
                       "the state or the array is NULL, or the array is smaller than the size "
                       "from fmi2SerializedFMUstateSize");
    memcpy(bytes, state, saved_size(state));
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component component, const fmi2Byte bytes[], size_t size,
                                   fmi2FMUstate *state)
{
    Link *l = component;
    Saved *s = bytes && state && size >= sizeof *s ? calloc(1, size) : NULL;
    if (s) memcpy(s, bytes, size);
    if (!s || s->guid != guid_checksum(l) || s->size != size - sizeof *s || s->sum != checksum(s)) {
        free(s);
        return failure(l, "fmi2DeSerializeFMUstate",
                       "the bytes are damaged or belong to another FMU");
    }
    *state = s;
    return fmi2OK;
}
