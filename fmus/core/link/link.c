/* link.c - an FMU that stands for a component which runs elsewhere: FMI 2.0 calls become requests.
 *
 * In a step there is one exchange: what has been set since the last step, the step, and everything
 * that has ever been read. Inputs are judged by the component when they arrive there, with the
 * step; otherwise a call is answered as the component answers it. */
/* SPDX-License-Identifier: BSD-2-Clause */
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

/* ---- log */
static void say(const Link *l, fmi2Status status, const char *category, const char *text)
{
    char line[SAID_SIZE + 100];
    if (!l->call.logger) return;
    snprintf(line, sizeof line, "%s", text);
    for (char *at = line; *at; at++)
        if (*at == '%') *at = ' ';
    l->call.logger(l->call.componentEnvironment, l->name, status, category, line);
}

static fmi2Status failure(const Link *l, const char *function, const char *text)
{
    char line[SAID_SIZE + 100];
    snprintf(line, sizeof line, "%s: %s", function, text);
    say(l, fmi2Error, "logStatusError", line);
    return fmi2Error;
}

/* what the board has answered, with what the component has said */
static fmi2Status told(Link *l, unsigned status)
{
    if (status == fmi2Warning && l->warns) say(l, fmi2Warning, "logStatusWarning", l->client.said);
    if (status > fmi2Warning) say(l, (fmi2Status)status, "logStatusError", l->client.said);
    return (fmi2Status)status;
}

/* ---- values known here */
static Entry *entry_of(Link *l, ValueType type, fmi2ValueReference reference, size_t guess)
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

static void forget(Link *l, bool pending)
{
    for (Entry *e = l->entry; e < l->entry + l->entries; e++) {
        e->valid = false;
        if (pending) e->pending = false;
    }
}

typedef bool Chosen(const Entry *e);
static bool is_pending(const Entry *e) { return e->pending; }
static bool is_read(const Entry *e) { return e->read; }
static bool is_missing(const Entry *e) { return e->read && !e->valid; }

static bool any(const Link *l, Chosen *chosen)
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

static void put_list(Link *l, Writer *w, Chosen *chosen, bool with_values)
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
static bool take_values(Link *l, Chosen *chosen)
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

static unsigned wrong_values(Link *l)
{
    snprintf(l->client.said, SAID_SIZE, "the answer does not hold the values that were asked for");
    return fmi2Error;
}

/* ---- requests */
static unsigned finish_exchange(Link *l, unsigned status)
{
    return status <= fmi2Warning && !take_values(l, is_read) ? wrong_values(l) : status;
}

static unsigned settle(Link *l) /* an answer that was too late for its step */
{
    if (!l->client.outstanding) return fmi2OK;
    return finish_exchange(l, conclude(&l->client));
}

static fmi2Status plain(Link *l, Code code)
{
    unsigned status = settle(l);
    Writer w = new_request(&l->client);
    return told(l, status > fmi2Warning ? status : ask(&l->client, code, &w));
}

static fmi2Status flush(Link *l)
{
    if (!any(l, is_pending)) return fmi2OK;
    unsigned status = settle(l);
    Writer w = new_request(&l->client);
    put_list(l, &w, is_pending, true);
    if (status <= fmi2Warning) status = ask(&l->client, SET, &w);
    forget(l, true);
    return told(l, status);
}

static fmi2Status fetch(Link *l)
{
    if (l->client.outstanding && !any(l, is_missing)) return fmi2OK; /* the outputs are held */
    fmi2Status status = flush(l);
    if (status > fmi2Warning || !any(l, is_missing)) return status;
    unsigned outcome = settle(l);
    Writer w = new_request(&l->client);
    put_list(l, &w, is_missing, false);
    if (outcome <= fmi2Warning) outcome = ask(&l->client, GET, &w);
    if (outcome <= fmi2Warning && !take_values(l, is_missing)) outcome = wrong_values(l);
    return told(l, outcome);
}

/* ---- life */
static int hex(char c)
{
    return c >= '0' && c <= '9' ? c - '0' : c >= 'a' && c <= 'f' ? c - 'a' + 10 : c - 'A' + 10;
}

/* file:///a%20b or file:/a -> /a b; a path stays as it is */
static void path_of(const char *uri, char path[PATH_SIZE])
{
    char *end = path + PATH_SIZE - 1;
    if (strncmp(uri, "file:", 5) == 0) uri += 5;
    if (strncmp(uri, "//", 2) == 0) uri += 2;
    if (strncmp(uri, "localhost/", 10) == 0) uri += 9;
    while (*uri && path < end) {
        bool coded = uri[0] == '%' && uri[1] && uri[2];
        *path++ = coded ? (char)(16 * hex(uri[1]) + hex(uri[2])) : *uri;
        uri += coded ? 3 : 1;
    }
    while (path[-1] == '/') path--;
    *path = 0;
}

static bool connect_link(Link *l, fmi2String guid, fmi2String resources)
{
    char folder[PATH_SIZE];
    Client *c = &l->client;
    path_of(resources ? resources : "", folder);
    if (!open_client(c, folder)) return false;
    if (guid && strcmp(guid, c->config.guid) == 0) {
        Writer w = new_request(c);
        return ask(c, RESET, &w) <= fmi2Warning;
    }
    snprintf(c->said, sizeof c->said, "wrong guid '%.60s', expected '%.60s'", guid ? guid : "",
             c->config.guid);
    return false;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible,
                              fmi2Boolean logging)
{
    Link *l = calloc(1, sizeof *l);
    char *copy = calloc(1, name ? strlen(name) + 1 : 1);
    (void)visible;
    if (!l || !copy) return free(l), free(copy), NULL;
    l->name = strcpy(copy, name ? name : "");
    if (functions) l->call = *functions;
    l->warns = l->counts = logging;
    l->client.stream = (Stream){.in = -1, .out = -1, .life = -1, .lock = -1};
    bool fine = type == fmi2CoSimulation && *l->name;
    if (!fine) failure(l, "fmi2Instantiate", "a name and co-simulation are needed");
    else if (!(fine = connect_link(l, guid, resources)))
        failure(l, "fmi2Instantiate", l->client.said);
    if (fine) return l;
    fmi2FreeInstance(l);
    return NULL;
}

void fmi2FreeInstance(fmi2Component component)
{
    Link *l = component;
    if (!l) return;
    close_client(&l->client);
    free(l->entry);
    free(l->name);
    free(l);
}

fmi2Status fmi2SetDebugLogging(fmi2Component component, fmi2Boolean on, size_t count,
                               const fmi2String categories[])
{
    Link *l = component;
    l->warns = l->counts = on && count == 0;
    for (size_t i = 0; i < count && on; i++) {
        l->warns |= strcmp(categories[i], "logStatusWarning") == 0;
        l->counts |= strcmp(categories[i], "logStatistics") == 0;
    }
    return fmi2OK;
}

fmi2Status fmi2SetupExperiment(fmi2Component component, fmi2Boolean tolerance_defined,
                               fmi2Real tolerance, fmi2Real start, fmi2Boolean stop_defined,
                               fmi2Real stop)
{
    Link *l = component;
    (void)tolerance_defined, (void)tolerance;
    l->start = start;
    l->stop = stop_defined ? stop : start;
    l->bounded = stop_defined;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component component)
{
    Link *l = component;
    Writer w = new_request(&l->client);
    put_double(&w, l->start);
    put_number(&w, l->bounded != 0, 1);
    put_double(&w, l->stop);
    forget(l, false);
    return told(l, ask(&l->client, ENTER, &w));
}

fmi2Status fmi2ExitInitializationMode(fmi2Component component)
{
    Link *l = component;
    fmi2Status status = plain(l, INITIALIZE);
    forget(l, false);
    l->stepping = status <= fmi2Warning;
    l->time = l->start;
    return status;
}

fmi2Status fmi2Terminate(fmi2Component component)
{
    Link *l = component;
    LinkStatistics cost;
    char text[400], peer[200], line[640];
    if (l->stepping && l->counts && slnk_statistics(l, &cost)) {
        snprintf(line, sizeof line, "on %s: %s", peer_name(&l->client, peer, sizeof peer),
                 describe_cost(&cost, text, sizeof text));
        say(l, fmi2OK, "logStatistics", line);
    }
    l->stepping = false;
    return plain(l, TERMINATE);
}

fmi2Status fmi2Reset(fmi2Component component)
{
    Link *l = component;
    l->client.outstanding = false; /* whatever it was, it is of no use any more */
    l->stepping = false;
    l->start = l->stop = 0;
    l->late = 0;
    l->behind = false;
    l->bounded = fmi2False;
    forget(l, true);
    return plain(l, RESET);
}

/* ---- statistics */
bool slnk_statistics(fmi2Component component, LinkStatistics *found)
{
    Link *l = component;
    Client *c = &l->client;
    if (settle(l) > fmi2Warning) return false;
    Writer w = new_request(c);
    if (ask(c, STATISTICS, &w) > fmi2Warning) return false;
    Reader *r = &c->data;
    found->steps = take_number(r, 8);
    found->total = take_number(r, 8);
    found->largest = take_number(r, 8);
    found->when = take_double(r);
    found->stack = (uint32_t)take_number(r, 4);
    found->memory = (uint32_t)take_number(r, 4);
    found->late = l->late;
    return !r->short_of;
}

/* ---- values */
static Entry *wanted(Link *l, ValueType type, const fmi2ValueReference vr[], size_t i, size_t *at)
{
    Entry *e = entry_of(l, type, vr[i], *at);
    if (e) *at = (size_t)(e - l->entry) + 1;
    return e;
}

static fmi2Status set_values(Link *l, ValueType type, const fmi2ValueReference vr[], size_t count,
                             const fmi2Real real[], const fmi2Integer integer[])
{
    size_t at = 0;
    for (size_t i = 0; i < count; i++) {
        Entry *e = wanted(l, type, vr, i, &at);
        if (!e) return failure(l, "fmi2Set", "out of memory");
        if (real) e->real = real[i];
        else e->integer = integer[i];
        e->pending = true;
    }
    return l->stepping ? fmi2OK : flush(l);
}

static fmi2Status get_values(Link *l, ValueType type, const fmi2ValueReference vr[], size_t count,
                             fmi2Real real[], fmi2Integer integer[])
{
    size_t at = 0;
    for (size_t i = 0; i < count; i++) {
        Entry *e = wanted(l, type, vr, i, &at);
        if (!e) return failure(l, "fmi2Get", "out of memory");
        e->read = true;
    }
    fmi2Status status = fetch(l);
    for (size_t i = at = 0; i < count && status <= fmi2Warning; i++) {
        const Entry *e = wanted(l, type, vr, i, &at);
        if (real) real[i] = e->real;
        else integer[i] = e->integer;
    }
    return status;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                       const fmi2Real value[])
{
    return set_values(c, REAL_TYPE, vr, count, value, NULL);
}
fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                          const fmi2Integer value[])
{
    return set_values(c, INTEGER_TYPE, vr, count, NULL, value);
}
fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                          const fmi2Boolean value[])
{
    return set_values(c, BOOLEAN_TYPE, vr, count, NULL, value);
}
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                       fmi2Real value[])
{
    return get_values(c, REAL_TYPE, vr, count, value, NULL);
}
fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                          fmi2Integer value[])
{
    return get_values(c, INTEGER_TYPE, vr, count, NULL, value);
}
fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                          fmi2Boolean value[])
{
    return get_values(c, BOOLEAN_TYPE, vr, count, NULL, value);
}

/* ---- step */
/* from where the board is to t + h */
static bool send_exchange(Link *l, double t, double h, fmi2Boolean final)
{
    Writer w = new_request(&l->client);
    put_list(l, &w, is_pending, true);
    put_double(&w, l->behind ? l->time : t);
    put_double(&w, l->behind ? t + h - l->time : h);
    put_number(&w, final != 0, 1);
    put_list(l, &w, is_read, false);
    forget(l, true);
    l->time = t + h;
    l->behind = false;
    return send_request(&l->client, EXCHANGE, &w);
}

static unsigned hold(Link *l)
{
    for (Entry *e = l->entry; e < l->entry + l->entries; e++) e->valid = e->read;
    return fmi2OK;
}

/* within the deadline, or what is to be done without an answer: wait, keep the outputs, stop */
static unsigned timely(Link *l)
{
    Client *c = &l->client;
    unsigned status = FAILED_REQUEST;
    if (c->config.deadline <= 0) return finish_exchange(l, conclude(c));
    if (await(c, now_s() + c->config.deadline, &status) != TOO_LATE)
        return finish_exchange(l, status);
    l->late++;
    if (c->config.late == LATE_WAIT) return finish_exchange(l, conclude(c));
    if (c->config.late == LATE_HOLD && now_s() < c->sent + c->config.timeout) return hold(l);
    snprintf(c->said, sizeof c->said, "fmi2DoStep: no answer within the deadline of %g s",
             c->config.late == LATE_HOLD ? c->config.timeout : c->config.deadline);
    return fmi2Error;
}

fmi2Status fmi2DoStep(fmi2Component component, fmi2Real t, fmi2Real h, fmi2Boolean final)
{
    Link *l = component;
    unsigned status = fmi2OK;
    if (l->client.outstanding) {
        status = timely(l); /* of an earlier step */
        l->behind |= l->client.outstanding;
    }
    lock_stream(&l->client.stream);
    if (status <= fmi2Warning && !l->client.outstanding)
        status = send_exchange(l, t, h, final) ? timely(l) : FAILED_REQUEST;
    unlock_stream(&l->client.stream);
    return told(l, status);
}

/* ---- states: what the component has serialized, and where the link is */
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
