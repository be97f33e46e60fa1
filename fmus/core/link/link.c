/* link.c - FMU in place of a component that runs on a board: calls of FMI 2.0 become requests.
 *
 * A step needs one exchange with the board: the request contains the step and all values set since
 * the last step, the answer all variables that the master has ever read. During stepping, a wrong
 * value is therefore rejected by the call that sends it, usually the next step, and not by the call
 * that sets it. All other calls that send a request return what the component returns. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "link.h"

static int hex_value(char c)
{
    return c >= '0' && c <= '9' ? c - '0' : c >= 'a' && c <= 'f' ? c - 'a' + 10 : c - 'A' + 10;
}

/* converts the URI of the resources to a path: file:///a%20b and file:/a%20b become "/a b". In a
 * plain path, too, % with two digits is decoded, and slashes at the end are removed. */
static void set_path(const char *uri, char path[PATH_SIZE])
{
    char *at = path, *end = path + PATH_SIZE - 1;
    if (strncmp(uri, "file:", 5) == 0) uri += 5;
    if (strncmp(uri, "//", 2) == 0) uri += 2;
    if (strncmp(uri, "localhost/", 10) == 0) uri += 9;
    while (*uri && at < end) {
        bool coded = uri[0] == '%' && uri[1] && uri[2];
        *at++ = coded ? (char)(16 * hex_value(uri[1]) + hex_value(uri[2])) : *uri;
        uri += coded ? 3 : 1;
    }
    while (at > path && at[-1] == '/') at--;
    *at = 0;
}

static bool connect_link(Link *l, fmi2String guid, fmi2String resources)
{
    char folder[PATH_SIZE];
    Client *c = &l->client;
    set_path(resources ? resources : "", folder);
    if (!open_client(c, folder)) return false;
    if (guid && strcmp(guid, c->config.guid) == 0) {
        Writer w = new_request(c);
        return request_and_wait(c, RESET, &w) <= fmi2Warning;
    }
    snprintf(c->message, sizeof c->message, "wrong guid '%.60s', expected '%.60s'",
             guid ? guid : "", c->config.guid);
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
    l->log_warnings = l->log_statistics = logging;
    l->client.stream = (Stream){.in = -1, .out = -1, .life = -1, .lock = -1};
    bool valid = type == fmi2CoSimulation && *l->name;
    if (!valid)
        failure(l, "fmi2Instantiate",
                "the instance name must not be empty, and the type must be co-simulation");
    else if (!(valid = connect_link(l, guid, resources)))
        failure(l, "fmi2Instantiate", l->client.message);
    if (valid) return l;
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
    l->log_warnings = l->log_statistics = on && count == 0;
    for (size_t i = 0; i < count && on; i++) {
        l->log_warnings |= strcmp(categories[i], "logStatusWarning") == 0;
        l->log_statistics |= strcmp(categories[i], "logStatistics") == 0;
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
    invalidate(l, false);
    return report_answer(l, request_and_wait(&l->client, ENTER, &w));
}

fmi2Status fmi2ExitInitializationMode(fmi2Component component)
{
    Link *l = component;
    fmi2Status status = send_simple_request(l, INITIALIZE);
    invalidate(l, false);
    l->stepping = status <= fmi2Warning;
    l->time = l->start;
    return status;
}

fmi2Status fmi2Terminate(fmi2Component component)
{
    Link *l = component;
    LinkStatistics cost;
    char text[400], peer[200], line[640];
    if (l->stepping && l->log_statistics && slnk_statistics(l, &cost)) {
        snprintf(line, sizeof line, "on %s: %s", peer_name(&l->client, peer, sizeof peer),
                 describe_cost(&cost, text, sizeof text));
        log_line(l, fmi2OK, "logStatistics", line);
    }
    l->stepping = false;
    return send_simple_request(l, TERMINATE);
}

fmi2Status fmi2Reset(fmi2Component component)
{
    Link *l = component;
    l->client.outstanding = false; /* do not wait for the answer to the last request */
    l->stepping = false;
    l->start = l->stop = 0;
    l->late = 0;
    l->behind = false;
    l->bounded = fmi2False;
    invalidate(l, true);
    return send_simple_request(l, RESET);
}

/* ---- statistics */
bool slnk_statistics(fmi2Component component, LinkStatistics *result)
{
    Link *l = component;
    Client *c = &l->client;
    if (finish_late_answer(l) > fmi2Warning) return false;
    Writer w = new_request(c);
    if (request_and_wait(c, STATISTICS, &w) > fmi2Warning) return false;
    Reader *r = &c->data;
    result->steps = take_number(r, 8);
    result->total = take_number(r, 8);
    result->largest = take_number(r, 8);
    result->when = take_double(r);
    result->stack = (uint32_t)take_number(r, 4);
    result->memory = (uint32_t)take_number(r, 4);
    result->late = l->late;
    return !r->truncated;
}
