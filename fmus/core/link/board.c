/* board.c - answers requests, one at a time, by calls to the FMUs on the board.
 *
 * A request that comes twice is answered twice and carried out once; one that is older than the
 * last is dropped. A damaged frame is answered by DAMAGED, and the simulation sends it again. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "board.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

enum { TEXT_SIZE = 2000 };

/* one request at a time, so one of each */
static unsigned char incoming[FRAME_LIMIT], outgoing[FRAME_LIMIT];
static union {
    fmi2Real real[PAYLOAD_LIMIT / 8];
    fmi2Integer integer[PAYLOAD_LIMIT / 4];
} values;
static fmi2ValueReference references[PAYLOAD_LIMIT / 8];
static char said[TEXT_SIZE]; /* by the FMU that is being called */
static size_t answer_size;   /* of the last answer, which stands in `outgoing` */
static size_t answered;      /* slot */

/* ---- what an FMU needs of its master */
static void keep_message(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status,
                         fmi2String category, fmi2String format, ...)
{
    va_list arguments;
    (void)environment, (void)name, (void)category;
    if (status == fmi2OK || !format) return;
    va_start(arguments, format);
    vsnprintf(said, sizeof said, format, arguments);
    va_end(arguments);
}

static size_t taken; /* bytes that FMUs have asked for */
static void *count_memory(size_t count, size_t size)
{
    taken += count * size;
    return calloc(count, size);
}

static const fmi2CallbackFunctions callbacks = {keep_message, count_memory, free, NULL, NULL};

/* ---- requests: each returns fmi2Status or Trouble, and writes what it answers */
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
    Slot *own = &board->slot[slot];
    (void)in, (void)out;
    own->cost = (Cost){0, 0, 0, 0};
    if (own->instance) return (unsigned)s->reset(own->instance);
    size_t before = taken;
    own->instance =
        s->instantiate(s->name, fmi2CoSimulation, s->guid, "", &callbacks, fmi2False, fmi2True);
    own->memory = (uint32_t)(taken - before);
    return own->instance ? fmi2OK : fmi2Error;
}

static unsigned enter(const Board *board, size_t slot, Reader *in, Writer *out)
{
    const Software *s = &board->software[slot];
    fmi2Component c = board->slot[slot].instance;
    double start = take_double(in);
    fmi2Boolean bounded = take_number(in, 1) != 0;
    double stop = take_double(in);
    (void)out;
    if (in->short_of) return MALFORMED;
    fmi2Status status = s->setup_experiment(c, fmi2False, 0, start, bounded, stop);
    return (unsigned)(status > fmi2Warning ? status : s->enter_initialization(c));
}

static unsigned initialize(const Board *board, size_t slot, Reader *in, Writer *out)
{
    (void)in, (void)out;
    unsigned status =
        (unsigned)board->software[slot].exit_initialization(board->slot[slot].instance);
    if (board->paint_stack) board->paint_stack(); /* what counts is what the steps need */
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
    for (size_t i = 0; i < run.count && !in->short_of; i++)
        if (run.type == REAL_TYPE) values.real[i] = take_double(in);
        else values.integer[i] = (fmi2Integer)(int32_t)take_number(in, 4);
    if (in->short_of) return fmi2OK; /* judged by the caller */
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
    for (size_t left = take_number(in, 2); left > 0; left--) {
        RunOf run = take_run(in);
        if (in->short_of || too_long(run)) return MALFORMED;
        fmi2Status status = set_run(&board->software[slot], board->slot[slot].instance, run, in);
        if (in->short_of) return MALFORMED;
        if (status > fmi2Warning) return (unsigned)status;
        if (status > worst) worst = status;
    }
    return (unsigned)worst;
}

static unsigned get(const Board *board, size_t slot, Reader *in, Writer *out)
{
    fmi2Status worst = fmi2OK;
    for (size_t left = take_number(in, 2); left > 0; left--) {
        RunOf run = take_run(in);
        if (in->short_of || too_long(run)) return MALFORMED;
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
    Slot *own = &board->slot[slot];
    double t = take_double(in), h = take_double(in);
    bool final = take_number(in, 1) != 0;
    (void)out;
    if (in->short_of) return MALFORMED;
    uint64_t before = board->counter ? board->counter() : 0;
    fmi2Status status = board->software[slot].do_step(own->instance, t, h, final);
    if (board->counter) count_cost(&own->cost, board->counter() - before, t);
    else own->cost.steps++;
    return (unsigned)status;
}

static unsigned worse(unsigned a, unsigned b) { return a > b ? a : b; }

static unsigned exchange(const Board *board, size_t slot, Reader *in, Writer *out)
{
    unsigned first = set(board, slot, in, out);
    if (first > fmi2Warning) return first;
    unsigned second = step(board, slot, in, out);
    if (second > fmi2Warning) return second;
    return worse(worse(first, second), get(board, slot, in, out));
}

/* ---- states */
static unsigned serialized(const Software *s, fmi2Component c, fmi2FMUstate state, Writer *out)
{
    size_t size = 0;
    fmi2Status status = s->state_size(c, state, &size);
    if (status > fmi2Warning) return (unsigned)status;
    if (size > out->size - out->used) {
        snprintf(said, sizeof said, "its state of %u bytes does not fit into a frame",
                 (unsigned)size);
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
    unsigned outcome = serialized(s, c, state, out);
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
    [DESCRIBE] = describe, [RESET] = reset,           [SET] = set,
    [ENTER] = enter,       [INITIALIZE] = initialize, [STEP] = step,
    [GET] = get,           [EXCHANGE] = exchange,     [SAVE] = save,
    [RESTORE] = restore,   [TERMINATE] = terminate,   [STATISTICS] = statistics,
};
enum { ANSWERS = sizeof answers / sizeof answers[0] };

/* an answer: size of its data, the data, what was said; a failed request has no data */
static void answer(const Board *board, Frame f, unsigned status, size_t data)
{
    size_t length = strlen(said);
    unsigned char *payload = outgoing + HEADER_SIZE;
    store(payload, data, 4);
    memcpy(payload + 4 + data, said, length);
    f.code |= ANSWER;
    f.status = (uint8_t)status;
    answered = f.component;
    answer_size = seal(outgoing, f, 4 + data + length);
    board->write(board->port, outgoing, answer_size);
}

/* what was not carried out; the last answer stays */
static void refuse(const Board *board, Frame f, Trouble trouble)
{
    unsigned char bytes[HEADER_SIZE + CRC_SIZE];
    f.code |= ANSWER;
    f.status = (uint8_t)trouble;
    board->write(board->port, bytes, seal(bytes, f, 0));
}

static void carry_out(const Board *board, Frame f)
{
    Writer out = {outgoing + HEADER_SIZE + 4, PAYLOAD_LIMIT - 4 - TEXT_SIZE, 0, false};
    bool known = f.code < ANSWERS && answers[f.code];
    bool ready = board->slot[f.component].instance || f.code == DESCRIBE || f.code == RESET;
    said[0] = 0;
    unsigned status =
        known && ready ? answers[f.code](board, f.component, &f.payload, &out) : MALFORMED;
    answer(board, f, status, status > fmi2Warning ? 0 : out.used);
}

static bool begins_session(const Slot *own, const Frame *f)
{
    return f->code == DESCRIBE && !(own->described && f->sequence == own->first);
}

static bool acceptable(const Board *board, const Frame *f)
{
    if (f->version != PROTOCOL_VERSION) return refuse(board, *f, OTHER_VERSION), false;
    if (f->component >= board->count) return refuse(board, *f, NO_COMPONENT), false;
    if (f->code == DESCRIBE || board->slot[f->component].described) return true;
    return refuse(board, *f, NO_SESSION), false;
}

/* new: carried out; the last once more: answered once more; any other: dropped */
static void receive(const Board *board, Frame f)
{
    if (!acceptable(board, &f)) return;
    Slot *own = &board->slot[f.component];
    bool begins = begins_session(own, &f);
    if (begins) own->first = f.sequence, own->described = true;
    if (begins || f.sequence == own->last + 1) {
        own->last = f.sequence;
        carry_out(board, f);
    } else if (f.sequence == own->last && answered == f.component)
        board->write(board->port, outgoing, answer_size);
}

void serve(const Board *board)
{
    size_t held = 0, got;
    bool damaged = false;
    while ((got = board->read(board->port, incoming + held, sizeof incoming - held)) > 0) {
        unsigned char *front = incoming;
        size_t size;
        Frame f;
        held += got;
        for (Found found; held > 0 && (found = look(front, held, &f, &size)) != INCOMPLETE;) {
            if (found == COMPLETE) receive(board, f), damaged = false;
            else if (!damaged) refuse(board, (Frame){.code = 0}, DAMAGED), damaged = true;
            front += size;
            held -= size;
        }
        memmove(incoming, front, held);
    }
}
