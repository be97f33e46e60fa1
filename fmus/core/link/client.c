/* client.c - requests and their answers over a stream that may damage, lose, double or delay them.
 *
 * Every request has a number; the board carries out each number once and answers it as often as it
 * is asked, so asking again is safe. Answers with other numbers are late ones and dropped. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "client.h"

#include <stdarg.h>

static const char *const code_names[] = {
    [DESCRIBE] = "describe", [RESET] = "reset",           [SET] = "set",
    [ENTER] = "enter",       [INITIALIZE] = "initialize", [STEP] = "step",
    [GET] = "get",           [EXCHANGE] = "exchange",     [SAVE] = "save",
    [RESTORE] = "restore",   [TERMINATE] = "terminate",   [STATISTICS] = "statistics"};

const char *peer_name(const Client *c, char *buffer, size_t size)
{
    const Config *g = &c->config;
    if (strcmp(g->via, "tcp") == 0) snprintf(buffer, size, "tcp://%s:%s", g->host, g->port);
    else if (*g->target) snprintf(buffer, size, "%s", g->target);
    else snprintf(buffer, size, "%s:%s", g->via, g->path);
    return buffer;
}

static unsigned refused(Client *c, const char *format, ...)
{
    char peer[200], text[SAID_SIZE - 220];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    snprintf(c->said, sizeof c->said, "%s: %s", peer_name(c, peer, sizeof peer), text);
    c->outstanding = false;
    return FAILED_REQUEST;
}

/* ---- sending */
Writer new_request(Client *c)
{
    return (Writer){c->request + HEADER_SIZE, PAYLOAD_LIMIT, 0, false};
}

static bool transmit(Client *c)
{
    c->sent = now_s();
    c->tries++;
    return write_stream(&c->stream, c->request, c->request_size, c->sent + c->config.timeout) !=
           STREAM_ENDED;
}

bool send_request(Client *c, Code code, const Writer *payload)
{
    if (payload->full || payload->used > c->limit)
        return refused(c, "a request of %u bytes is too long for it", (unsigned)payload->used),
               false;
    c->code = code;
    c->tries = 0;
    c->outstanding = true;
    c->request_size = seal(
        c->request, (Frame){.code = (uint8_t)code, .component = c->slot, .sequence = ++c->sequence},
        payload->used);
    if (transmit(c)) return true;
    refused(c, "%s", c->stream.reason);
    return false;
}

/* ---- receiving */
static void drop(Client *c, size_t count)
{
    memmove(c->incoming, c->incoming + count, c->held - count);
    c->held -= count;
}

/* a magic or a CRC that only the other byte order explains */
static bool of_other_order(const unsigned char *bytes, size_t count)
{
    static const unsigned char turned[4] = {'K', 'N', 'L', 'S'};
    if (count >= 4 && memcmp(bytes, turned, 4) == 0) return true;
    if (count < HEADER_SIZE || memcmp(bytes, frame_magic, 4) != 0) return false;
    uint32_t crc = crc_of(0, bytes, HEADER_SIZE - CRC_SIZE), big = 0;
    for (int i = 0; i < 4; i++) big = big << 8 | bytes[16 + i];
    return big == crc && load(bytes + 16, 4) != crc;
}

static Found next_frame(Client *c, Frame *f, size_t *size)
{
    size_t skipped = 0;
    Found found = INCOMPLETE;
    while (skipped < c->held) {
        found = look(c->incoming + skipped, c->held - skipped, f, size);
        if (found != NOISE) break;
        c->reversed |= of_other_order(c->incoming + skipped, c->held - skipped);
        skipped++;
    }
    drop(c, skipped);
    if (found != COMPLETE || c->held == 0) return INCOMPLETE;
    f->payload.bytes = c->incoming + HEADER_SIZE;
    return COMPLETE;
}

static const char *trouble_text(unsigned status)
{
    switch (status) {
    case NO_COMPONENT: return "the board has no such component";
    case NO_SESSION: return "the board has begun anew and lost the state of the component";
    case MALFORMED: return "the board does not understand the request";
    default: return "the board refuses the request";
    }
}

static bool read_answer(Client *c, Frame f, unsigned *status)
{
    Reader r = f.payload;
    *status = f.status;
    c->outstanding = false;
    if (f.status >= DAMAGED) return *status = refused(c, "%s", trouble_text(f.status)), true;
    size_t size = take_number(&r, 4);
    c->data = (Reader){take_bytes(&r, size), size, false};
    if (r.short_of || f.status > 4) return *status = refused(c, "a malformed answer"), true;
    size_t kept = r.left < sizeof c->said ? r.left : sizeof c->said - 1;
    memcpy(c->said, r.bytes, kept);
    c->said[kept] = 0;
    return true;
}

/* whether this frame settles the request; a damaged one is to be asked again at once */
static bool settles(Client *c, Frame f, unsigned *status, bool *damaged)
{
    if (f.version != PROTOCOL_VERSION || (f.code & ANSWER && f.status == OTHER_VERSION))
        return *status = refused(c, "it speaks version %u of the protocol, this link version %u",
                                 f.version, PROTOCOL_VERSION),
               true;
    *damaged = f.code == ANSWER && f.status == DAMAGED;
    if (f.code != (c->code | ANSWER) || f.sequence != c->sequence || f.component != c->slot)
        return false;
    return read_answer(c, f, status);
}

/* what has come by then is read even if nobody has looked in time, but no more of it than a frame:
 * a board that never pauses is late as well */
Outcome await(Client *c, double until, unsigned *status)
{
    size_t size, got, overtime = 0;
    Frame f;
    drop(c, c->done);
    for (c->done = 0;;) {
        while (next_frame(c, &f, &size) == COMPLETE) {
            bool damaged = false;
            if (settles(c, f, status, &damaged)) return c->done = size, ARRIVED;
            drop(c, size);
            if (damaged) return TOO_LATE;
        }
        StreamState state = read_stream(&c->stream, c->incoming + c->held,
                                        sizeof c->incoming - c->held, &got, until);
        if (state == STREAM_LATE) return TOO_LATE;
        if (state == STREAM_ENDED) return *status = refused(c, "%s", c->stream.reason), BROKEN;
        c->held += got;
        if (now_s() > until && (overtime += got) > FRAME_LIMIT) return TOO_LATE;
    }
}

static unsigned no_answer(Client *c)
{
    if (c->reversed) return refused(c, "it sends numbers in the other byte order");
    return refused(c, "no answer to '%s' within %g s, asked %ld times", code_names[c->code],
                   c->config.timeout, c->tries);
}

unsigned conclude(Client *c)
{
    for (;;) {
        unsigned status = FAILED_REQUEST;
        if (await(c, c->sent + c->config.timeout, &status) != TOO_LATE) return status;
        if (c->tries > c->config.retries || (c->reversed && c->tries > 1)) return no_answer(c);
        if (!transmit(c)) return refused(c, "%s", c->stream.reason);
    }
}

unsigned ask(Client *c, Code code, const Writer *payload)
{
    lock_stream(&c->stream);
    unsigned status = send_request(c, code, payload) ? conclude(c) : FAILED_REQUEST;
    unlock_stream(&c->stream);
    return status;
}

/* ---- a session */
typedef struct {
    size_t components;
    double probe;
    char guid[80], name[200], target[80];
} Description;

enum { MOST_COMPONENTS = 64 };

static unsigned ask_who(Client *c, Description *d)
{
    Writer w = new_request(c);
    c->limit = PAYLOAD_LIMIT;
    unsigned status = ask(c, DESCRIBE, &w);
    if (status > 1) return status;
    Reader *r = &c->data;
    d->components = take_number(r, 2);
    c->variables = (uint32_t)take_number(r, 4);
    c->limit = (uint32_t)take_number(r, 4);
    c->saves = take_number(r, 1) != 0;
    d->probe = take_double(r);
    take_text(r, d->guid, sizeof d->guid);
    take_text(r, d->name, sizeof d->name);
    take_text(r, d->target, sizeof d->target);
    if (r->short_of || d->components > MOST_COMPONENTS)
        return refused(c, "a malformed description");
    if (d->probe != probe_value) return refused(c, "its doubles are not those of IEEE 754");
    return status;
}

/* by its slot, or the first of the right guid */
static bool find_component(Client *c)
{
    Description d = {.components = 1};
    size_t first = c->config.slot >= 0 ? (size_t)c->config.slot : 0;
    for (size_t i = first; i < d.components || i == first; i++) {
        c->slot = (uint8_t)i;
        c->sequence = (uint32_t)(1e6 * now_s()) ^ (uint32_t)(i << 28); /* unlike earlier ones */
        if (ask_who(c, &d) > 1) return false;
        if (strcmp(d.guid, c->config.guid) == 0) return true;
        if (c->config.slot >= 0) break;
    }
    refused(c, "another interface: it holds %s %s, this FMU stands for %s", d.name, d.guid,
            c->config.guid);
    return false;
}

bool open_client(Client *c, const char *resources)
{
    if (!read_config(&c->config, resources))
        return snprintf(c->said, sizeof c->said, "%.800s/link.txt cannot be read", resources),
               false;
    if (open_stream(&c->stream, &c->config)) return find_component(c);
    refused(c, "%s", c->stream.reason);
    return false;
}

void close_client(Client *c) { close_stream(&c->stream); }
