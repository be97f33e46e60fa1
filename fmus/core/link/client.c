/* client.c - requests and answers over a stream that may damage, lose, duplicate or delay them.
 *
 * Every request has a number; the board processes each number once and answers it whenever the
 * request is repeated, so that repeating a request is safe. Answers with other numbers are late and
 * are discarded. */
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

static unsigned fail_request(Client *c, const char *format, ...)
{
    char peer[200], text[MESSAGE_SIZE - 220];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    snprintf(c->message, sizeof c->message, "%s: %s", peer_name(c, peer, sizeof peer), text);
    c->outstanding = false;
    return FAILED_REQUEST;
}

/* ---- sending */
Writer new_request(Client *c)
{
    return (Writer){c->request + HEADER_SIZE, PAYLOAD_LIMIT, 0, false};
}

bool write_request(Client *c)
{
    c->sent = now_s();
    c->attempts++;
    return write_stream(&c->stream, c->request, c->request_size, c->sent + c->config.timeout) !=
           STREAM_ENDED;
}

bool send_request(Client *c, Code code, const Writer *payload)
{
    if (payload->full || payload->used > c->limit)
        return fail_request(
                   c, "a request of at least %u bytes needs a larger PAYLOAD_LIMIT at both ends",
                   (unsigned)payload->used),
               false;
    c->code = code;
    c->attempts = 0;
    c->outstanding = true;
    c->request_size = finish_frame(
        c->request, (Frame){.code = (uint8_t)code, .component = c->slot, .sequence = ++c->sequence},
        payload->used);
    if (write_request(c)) return true;
    fail_request(c, "%s", c->stream.reason);
    return false;
}

/* ---- receiving */
static void discard(Client *c, size_t count)
{
    memmove(c->incoming, c->incoming + count, c->buffered - count);
    c->buffered -= count;
}

/* true if a frame begins at `bytes` whose magic number or CRC is valid only in the reversed byte
 * order, that is, if the board is big-endian */
static bool is_reversed(const unsigned char *bytes, size_t count)
{
    static const unsigned char reversed_magic[4] = {'K', 'N', 'L', 'S'};
    if (count >= 4 && memcmp(bytes, reversed_magic, 4) == 0) return true;
    if (count < HEADER_SIZE || memcmp(bytes, frame_magic, 4) != 0) return false;
    uint32_t crc = crc_of(0, bytes, HEADER_SIZE - CRC_SIZE), big = 0;
    for (int i = 0; i < 4; i++) big = big << 8 | bytes[16 + i];
    return big == crc && load(bytes + 16, 4) != crc;
}

static Found next_frame(Client *c, Frame *f, size_t *size)
{
    size_t skipped = 0;
    Found found = INCOMPLETE;
    while (skipped < c->buffered) {
        found = find_frame(c->incoming + skipped, c->buffered - skipped, f, size);
        if (found != NOISE) break;
        c->reversed |= is_reversed(c->incoming + skipped, c->buffered - skipped);
        skipped++;
    }
    discard(c, skipped);
    if (found != COMPLETE || c->buffered == 0) return INCOMPLETE;
    f->payload.bytes = c->incoming + HEADER_SIZE;
    return COMPLETE;
}

static const char *text_of_trouble(unsigned status)
{
    switch (status) {
    case NO_COMPONENT: return "the board has no such component";
    case NO_SESSION: return "the board has restarted and lost the state of the component";
    case MALFORMED:
        return "the request is not valid, or its answer needs a larger PAYLOAD_LIMIT at both ends";
    default: return "the board has rejected the request";
    }
}

static bool read_answer(Client *c, Frame f, unsigned *status)
{
    Reader r = f.payload;
    *status = f.status;
    c->outstanding = false;
    if (f.status >= DAMAGED)
        return *status = fail_request(c, "%s", text_of_trouble(f.status)), true;
    size_t size = take_number(&r, 4);
    c->data = (Reader){take_bytes(&r, size), size, false};
    if (r.truncated || f.status > 4)
        return *status = fail_request(c, "the answer is malformed"), true;
    size_t count = r.left < sizeof c->message ? r.left : sizeof c->message - 1;
    memcpy(c->message, r.bytes, count);
    c->message[count] = 0;
    return true;
}

/* true if `status` is set: the frame is the answer to the last request, or the board uses another
 * version of the protocol. damaged: set if the request must be repeated at once */
static bool is_answer(Client *c, Frame f, unsigned *status, bool *damaged)
{
    if (f.version != PROTOCOL_VERSION || (f.code & ANSWER && f.status == OTHER_VERSION))
        return *status = fail_request(
                   c, "the board uses version %u of the protocol, this link version %u", f.version,
                   PROTOCOL_VERSION),
               true;
    *damaged = f.code == ANSWER && f.status == DAMAGED;
    if (f.code != (c->code | ANSWER) || f.sequence != c->sequence || f.component != c->slot)
        return false;
    return read_answer(c, f, status);
}

/* waits for the answer to the last request until the time `until`; TOO_LATE at once if the board
 * reports a damaged request. After that time, bytes that have already arrived are still read, but
 * not many more than the longest frame has, so that TOO_LATE is returned even if the board sends
 * without end. */
Outcome wait_until(Client *c, double until, unsigned *status)
{
    size_t size, got, late_bytes = 0;
    Frame f;
    discard(c, c->done);
    for (c->done = 0;;) {
        while (next_frame(c, &f, &size) == COMPLETE) {
            bool damaged = false;
            if (is_answer(c, f, status, &damaged)) return c->done = size, ARRIVED;
            discard(c, size);
            if (damaged) return TOO_LATE;
        }
        StreamState state = read_stream(&c->stream, c->incoming + c->buffered,
                                        sizeof c->incoming - c->buffered, &got, until);
        if (state == STREAM_LATE) return TOO_LATE;
        if (state == STREAM_ENDED) return *status = fail_request(c, "%s", c->stream.reason), BROKEN;
        c->buffered += got;
        if (now_s() > until && (late_bytes += got) > FRAME_LIMIT) return TOO_LATE;
    }
}

static unsigned fail_unanswered(Client *c)
{
    if (c->reversed)
        return fail_request(c, "the board sends numbers in big-endian order, not little-endian");
    return fail_request(c, "no answer to '%s' in %ld attempts of at most %g s each",
                        code_names[c->code], c->attempts, c->config.timeout);
}

unsigned wait_for_answer(Client *c)
{
    for (;;) {
        unsigned status = FAILED_REQUEST;
        if (wait_until(c, c->sent + c->config.timeout, &status) != TOO_LATE) return status;
        if (c->attempts > c->config.retries || (c->reversed && c->attempts > 1))
            return fail_unanswered(c);
        if (!write_request(c)) return fail_request(c, "%s", c->stream.reason);
    }
}

unsigned request_and_wait(Client *c, Code code, const Writer *payload)
{
    lock_stream(&c->stream);
    unsigned status = send_request(c, code, payload) ? wait_for_answer(c) : FAILED_REQUEST;
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

static unsigned read_description(Client *c, Description *d)
{
    Writer w = new_request(c);
    c->limit = PAYLOAD_LIMIT;
    unsigned status = request_and_wait(c, DESCRIBE, &w);
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
    if (r->truncated || d->components > MOST_COMPONENTS)
        return fail_request(c, "the answer to 'describe' is malformed");
    if (d->probe != probe_value)
        return fail_request(c, "the board does not use doubles of IEEE 754");
    return status;
}

/* finds the slot of the component on the board: the slot given in link.txt or, without one, the
 * first slot with the guid of this FMU; false: the guid differs, or a request failed */
static bool find_component(Client *c)
{
    Description d = {.components = 1};
    size_t first = c->config.slot >= 0 ? (size_t)c->config.slot : 0;
    for (size_t i = first; i < d.components || i == first; i++) {
        c->slot = (uint8_t)i;
        /* the sequence number starts from the clock, so that the numbers of this session differ
         * from the numbers of earlier sessions */
        c->sequence = (uint32_t)(1e6 * now_s()) ^ (uint32_t)(i << 28);
        if (read_description(c, &d) > 1) return false;
        if (strcmp(d.guid, c->config.guid) == 0) return true;
        if (c->config.slot >= 0) break;
    }
    fail_request(c, "wrong interface: the board has %s %s, this FMU requires guid %s", d.name,
                 d.guid, c->config.guid);
    return false;
}

bool open_client(Client *c, const char *resources)
{
    if (!read_config(&c->config, resources))
        return snprintf(c->message, sizeof c->message, "%.800s/link.txt cannot be read", resources),
               false;
    if (open_stream(&c->stream, &c->config)) return find_component(c);
    fail_request(c, "%s", c->stream.reason);
    return false;
}

void close_client(Client *c) { close_stream(&c->stream); }
