/* board.c - the board's end of the protocol: answers requests, one at a time, by calls to its FMUs.
 *
 * A request that arrives twice is answered twice and processed once. A request older than the last
 * one is ignored. The answer to a damaged frame is DAMAGED, after which the simulation repeats the
 * request. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "board.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

enum { TEXT_SIZE = 2000 };

/* As requests are processed one at a time, one buffer for frames that arrive and one for frames
 * that are sent suffice. */
static unsigned char incoming[FRAME_LIMIT], outgoing[FRAME_LIMIT];
static union {
    fmi2Real real[PAYLOAD_LIMIT / 8];
    fmi2Integer integer[PAYLOAD_LIMIT / 4];
} values;
static fmi2ValueReference references[PAYLOAD_LIMIT / 8];
static char message[TEXT_SIZE]; /* last message of the FMU that is called */
static size_t answer_size;      /* size of the last answer, which is in `outgoing` */
static size_t answered;         /* index of the FMU that gave the last answer */

/* ---- callbacks for the FMUs */
static void store_message(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status,
                          fmi2String category, fmi2String format, ...)
{
    va_list arguments;
    (void)environment, (void)name, (void)category;
    if (status == fmi2OK || !format) return;
    va_start(arguments, format);
    vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
}

static size_t allocated; /* bytes allocated by FMUs */
static void *count_memory(size_t count, size_t size)
{
    allocated += count * size;
    return calloc(count, size);
}

static const fmi2CallbackFunctions callbacks = {store_message, count_memory, free, NULL, NULL};

/* ---- requests: each function returns fmi2Status or Trouble and writes the data of its answer */
typedef unsigned Answer(const Board *board, size_t slot, Reader *in, Writer *out);

static unsigned describe(const Board *board, size_t slot, Reader *in, Writer *out)
{
    const Software *s = &board->software[slot];
    (void)in;
    put_number(out, board->count, 2);
    put_number(out, s->variables, 4);
    put_number(out, PAYLOAD_LIMIT, 4);
    put_number(out, s->get_state != NULL, 1);
    put_double(out, probe_value);
    put_text(out, s->guid);
    put_text(out, s->name);
    put_text(out, board->target);
    return fmi2OK;
}

static unsigned reset(const Board *board, size_t slot, Reader *in, Writer *out)
{
    const Software *s = &board->software[slot];
    Slot *session = &board->slot[slot];
    (void)in, (void)out;
    session->cost = (Cost){0, 0, 0, 0};
    if (session->instance) return (unsigned)s->reset(session->instance);
    size_t before = allocated;
    session->instance =
        s->instantiate(s->name, fmi2CoSimulation, s->guid, "", &callbacks, fmi2False, fmi2True);
    session->memory = (uint32_t)(allocated - before);
    return session->instance ? fmi2OK : fmi2Error;
}

static unsigned enter_initialization_mode(const Board *board, size_t slot, Reader *in, Writer *out)
{
    const Software *s = &board->software[slot];
    fmi2Component c = board->slot[slot].instance;
    double start = take_double(in);
    fmi2Boolean bounded = take_number(in, 1) != 0;
    double stop = take_double(in);
    (void)out;
    if (in->truncated) return MALFORMED;
    fmi2Status status = s->setup_experiment(c, fmi2False, 0, start, bounded, stop);
    return (unsigned)(status > fmi2Warning ? status : s->enter_initialization(c));
}

static unsigned initialize(const Board *board, size_t slot, Reader *in, Writer *out)
{
    (void)in, (void)out;
    unsigned status =
        (unsigned)board->software[slot].exit_initialization(board->slot[slot].instance);
    if (board->paint_stack) board->paint_stack(); /* the stack is measured without initialization */
    return status;
}

static unsigned terminate(const Board *board, size_t slot, Reader *in, Writer *out)
{
    (void)in, (void)out;
    return (unsigned)board->software[slot].terminate(board->slot[slot].instance);
}

/* ---- values */
static void list_references(RunOf run)
{
    for (uint32_t i = 0; i < run.count; i++) references[i] = run.first + i;
}

static fmi2Status set_run(const Software *s, fmi2Component c, RunOf run, Reader *in)
{
    for (size_t i = 0; i < run.count && !in->truncated; i++)
        if (run.type == REAL_TYPE) values.real[i] = take_double(in);
        else values.integer[i] = (fmi2Integer)(int32_t)take_number(in, 4);
    if (in->truncated) return fmi2OK; /* the caller set() then returns MALFORMED */
    list_references(run);
    if (run.type == REAL_TYPE) return s->set_real(c, references, run.count, values.real);
    if (run.type == INTEGER_TYPE) return s->set_integer(c, references, run.count, values.integer);
    return s->set_boolean(c, references, run.count, values.integer);
}

static fmi2Status get_run(const Software *s, fmi2Component c, RunOf run, Writer *out)
{
    fmi2Status status;
    list_references(run);
    if (run.type == REAL_TYPE) status = s->get_real(c, references, run.count, values.real);
    else if (run.type == INTEGER_TYPE)
        status = s->get_integer(c, references, run.count, values.integer);
    else status = s->get_boolean(c, references, run.count, values.integer);
    for (size_t i = 0; i < run.count && status <= fmi2Warning; i++)
        if (run.type == REAL_TYPE) put_double(out, values.real[i]);
        else put_number(out, (uint32_t)values.integer[i], 4);
    return status;
}

static bool too_long(RunOf run) { return run.count > PAYLOAD_LIMIT / 8; }

static unsigned set(const Board *board, size_t slot, Reader *in, Writer *out)
{
    fmi2Status worst = fmi2OK;
    (void)out;
    for (size_t remaining = take_number(in, 2); remaining > 0; remaining--) {
        RunOf run = take_run(in);
        if (in->truncated || too_long(run)) return MALFORMED;
        fmi2Status status = set_run(&board->software[slot], board->slot[slot].instance, run, in);
        if (in->truncated) return MALFORMED;
        if (status > fmi2Warning) return (unsigned)status;
        if (status > worst) worst = status;
    }
    return (unsigned)worst;
}

static unsigned get(const Board *board, size_t slot, Reader *in, Writer *out)
{
    fmi2Status worst = fmi2OK;
    for (size_t remaining = take_number(in, 2); remaining > 0; remaining--) {
        RunOf run = take_run(in);
        if (in->truncated || too_long(run)) return MALFORMED;
        fmi2Status status = get_run(&board->software[slot], board->slot[slot].instance, run, out);
        if (status > fmi2Warning) return (unsigned)status;
        if (status > worst) worst = status;
    }
    return out->full ? MALFORMED : (unsigned)worst;
}

/* ---- step */
static void count_cost(Cost *cost, uint64_t spent, double t)
{
    if (cost->steps == 0 || spent > cost->largest) cost->largest = spent, cost->when = t;
    cost->steps++;
    cost->total += spent;
}

static unsigned step(const Board *board, size_t slot, Reader *in, Writer *out)
{
    Slot *session = &board->slot[slot];
    double t = take_double(in), h = take_double(in);
    bool final = take_number(in, 1) != 0;
    (void)out;
    if (in->truncated) return MALFORMED;
    uint64_t before = board->counter ? board->counter() : 0;
    fmi2Status status = board->software[slot].do_step(session->instance, t, h, final);
    if (board->counter) count_cost(&session->cost, board->counter() - before, t);
    else session->cost.steps++;
    return (unsigned)status;
}

static unsigned worse_status(unsigned a, unsigned b) { return a > b ? a : b; }

static unsigned exchange(const Board *board, size_t slot, Reader *in, Writer *out)
{
    unsigned first = set(board, slot, in, out);
    if (first > fmi2Warning) return first;
    unsigned second = step(board, slot, in, out);
    if (second > fmi2Warning) return second;
    return worse_status(worse_status(first, second), get(board, slot, in, out));
}

/* ---- states */
static unsigned put_state(const Software *s, fmi2Component c, fmi2FMUstate state, Writer *out)
{
    size_t size = 0;
    fmi2Status status = s->state_size(c, state, &size);
    if (status > fmi2Warning) return (unsigned)status;
    if (size > out->size - out->used) {
        snprintf(message, sizeof message,
                 "the state of %u bytes needs a larger PAYLOAD_LIMIT at both ends", (unsigned)size);
        return fmi2Error;
    }
    status = s->serialize(c, state, (fmi2Byte *)(out->bytes + out->used), size);
    if (status <= fmi2Warning) out->used += size;
    return (unsigned)status;
}

static unsigned save(const Board *board, size_t slot, Reader *in, Writer *out)
{
    const Software *s = &board->software[slot];
    fmi2Component c = board->slot[slot].instance;
    fmi2FMUstate state = NULL;
    (void)in;
    if (!s->get_state) return MALFORMED;
    fmi2Status status = s->get_state(c, &state);
    if (status > fmi2Warning) return (unsigned)status;
    unsigned outcome = put_state(s, c, state, out);
    s->free_state(c, &state);
    return outcome;
}

static unsigned restore(const Board *board, size_t slot, Reader *in, Writer *out)
{
    const Software *s = &board->software[slot];
    fmi2Component c = board->slot[slot].instance;
    fmi2FMUstate state = NULL;
    (void)out;
    if (!s->get_state) return MALFORMED;
    fmi2Status status = s->deserialize(c, (const fmi2Byte *)in->bytes, in->left, &state);
    if (status > fmi2Warning) return (unsigned)status;
    status = s->set_state(c, state);
    s->free_state(c, &state);
    return (unsigned)status;
}

static unsigned statistics(const Board *board, size_t slot, Reader *in, Writer *out)
{
    const Cost *cost = &board->slot[slot].cost;
    (void)in;
    put_number(out, cost->steps, 8);
    put_number(out, cost->total, 8);
    put_number(out, cost->largest, 8);
    put_double(out, cost->when);
    put_number(out, board->measure_stack ? board->measure_stack() : 0, 4);
    put_number(out, board->slot[slot].memory, 4);
    return fmi2OK;
}

/* ---- frames */
static Answer *const answers[] = {
    [DESCRIBE] = describe,
    [RESET] = reset,
    [SET] = set,
    [ENTER] = enter_initialization_mode,
    [INITIALIZE] = initialize,
    [STEP] = step,
    [GET] = get,
    [EXCHANGE] = exchange,
    [SAVE] = save,
    [RESTORE] = restore,
    [TERMINATE] = terminate,
    [STATISTICS] = statistics,
};
enum { ANSWERS = sizeof answers / sizeof answers[0] };

/* sends an answer: size of its data, the data, the message; the answer to a failed request has
 * no data */
static void send_answer(const Board *board, Frame f, unsigned status, size_t data)
{
    size_t length = strlen(message);
    unsigned char *payload = outgoing + HEADER_SIZE;
    store(payload, data, 4);
    memcpy(payload + 4 + data, message, length);
    f.code |= ANSWER;
    f.status = (uint8_t)status;
    answered = f.component;
    answer_size = finish_frame(outgoing, f, 4 + data + length);
    board->write(board->port, outgoing, answer_size);
}

/* sends the reason why a request was not processed; the last answer remains in `outgoing`, to
 * be sent again for a repeated request */
static void send_rejection(const Board *board, Frame f, Trouble trouble)
{
    unsigned char bytes[HEADER_SIZE + CRC_SIZE];
    f.code |= ANSWER;
    f.status = (uint8_t)trouble;
    board->write(board->port, bytes, finish_frame(bytes, f, 0));
}

static void process_request(const Board *board, Frame f)
{
    Writer out = {outgoing + HEADER_SIZE + 4, PAYLOAD_LIMIT - 4 - TEXT_SIZE, 0, false};
    bool known = f.code < ANSWERS && answers[f.code];
    bool ready = board->slot[f.component].instance || f.code == DESCRIBE || f.code == RESET;
    message[0] = 0;
    unsigned status =
        known && ready ? answers[f.code](board, f.component, &f.payload, &out) : MALFORMED;
    send_answer(board, f, status, status > fmi2Warning ? 0 : out.used);
}

static bool begins_session(const Slot *session, const Frame *f)
{
    return f->code == DESCRIBE && !(session->described && f->sequence == session->first);
}

static bool acceptable(const Board *board, const Frame *f)
{
    if (f->version != PROTOCOL_VERSION) return send_rejection(board, *f, OTHER_VERSION), false;
    if (f->component >= board->count) return send_rejection(board, *f, NO_COMPONENT), false;
    if (f->code == DESCRIBE || board->slot[f->component].described) return true;
    return send_rejection(board, *f, NO_SESSION), false;
}

/* rejects a frame that is not acceptable(); else processes a new request, repeats the last answer
 * if it answered the same request, and ignores any other frame */
static void receive(const Board *board, Frame f)
{
    if (!acceptable(board, &f)) return;
    Slot *session = &board->slot[f.component];
    bool begins = begins_session(session, &f);
    if (begins) session->first = f.sequence, session->described = true;
    if (begins || f.sequence == session->last + 1) {
        session->last = f.sequence;
        process_request(board, f);
    } else if (f.sequence == session->last && answered == f.component)
        board->write(board->port, outgoing, answer_size);
}

void serve(const Board *board)
{
    size_t buffered = 0, got;
    bool damaged = false;
    while ((got = board->read(board->port, incoming + buffered, sizeof incoming - buffered)) > 0) {
        unsigned char *front = incoming;
        size_t size;
        Frame f;
        buffered += got;
        for (Found found;
             buffered > 0 && (found = find_frame(front, buffered, &f, &size)) != INCOMPLETE;) {
            if (found == COMPLETE) receive(board, f), damaged = false;
            else if (!damaged) send_rejection(board, (Frame){.code = 0}, DAMAGED), damaged = true;
            front += size;
            buffered -= size;
        }
        memmove(incoming, front, buffered);
    }
}
