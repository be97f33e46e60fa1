/* link.c - an FMU that stands for a component which runs elsewhere: FMI 2.0 calls become requests.
 *
 * In a step there is one exchange: what has been set since the last step, the step, and everything
 * that has ever been read. Inputs are judged by the component when they arrive there, with the
 * step; otherwise a call is answered as the component answers it. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "link.h"

static int hex(char c)
{
    return c >= '0' && c <= '9' ? c - '0' : c >= 'a' && c <= 'f' ? c - 'a' + 10 : c - 'A' + 10;
}

/* file:///a%20b or file:/a -> /a b; a path stays as it is */
static void path_of(const char *uri, char path[PATH_SIZE])
{
    char *at = path, *end = path + PATH_SIZE - 1;
    if (strncmp(uri, "file:", 5) == 0) uri += 5;
    if (strncmp(uri, "//", 2) == 0) uri += 2;
    if (strncmp(uri, "localhost/", 10) == 0) uri += 9;
    while (*uri && at < end) {
        bool coded = uri[0] == '%' && uri[1] && uri[2];
        *at++ = coded ? (char)(16 * hex(uri[1]) + hex(uri[2])) : *uri;
        uri += coded ? 3 : 1;
    }
    while (at > path && at[-1] == '/') at--;
    *at = 0;
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
