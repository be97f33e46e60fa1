/* link_requests.c - requests of a link FMU, and what its master is told of the answers. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "link.h"

/* ---- log */
void say(const Link *l, fmi2Status status, const char *category, const char *text)
{
    char line[SAID_SIZE + 100];
    if (!l->call.logger) return;
    snprintf(line, sizeof line, "%s", text);
    for (char *at = line; *at; at++)
        if (*at == '%') *at = ' ';
    l->call.logger(l->call.componentEnvironment, l->name, status, category, line);
}

fmi2Status failure(const Link *l, const char *function, const char *text)
{
    char line[SAID_SIZE + 100];
    snprintf(line, sizeof line, "%s: %s", function, text);
    say(l, fmi2Error, "logStatusError", line);
    return fmi2Error;
}

fmi2Status told(Link *l, unsigned status)
{
    if (status == fmi2Warning && l->warns) say(l, fmi2Warning, "logStatusWarning", l->client.said);
    if (status > fmi2Warning) say(l, (fmi2Status)status, "logStatusError", l->client.said);
    return (fmi2Status)status;
}

/* ---- requests */
static unsigned wrong_values(Link *l)
{
    snprintf(l->client.said, SAID_SIZE, "the answer does not hold the values that were asked for");
    return fmi2Error;
}

unsigned finish_exchange(Link *l, unsigned status)
{
    return status <= fmi2Warning && !take_values(l, is_read) ? wrong_values(l) : status;
}

unsigned settle(Link *l)
{
    if (!l->client.outstanding) return fmi2OK;
    return finish_exchange(l, conclude(&l->client));
}

fmi2Status plain(Link *l, Code code)
{
    unsigned status = settle(l);
    Writer w = new_request(&l->client);
    return told(l, status > fmi2Warning ? status : ask(&l->client, code, &w));
}

fmi2Status flush(Link *l)
{
    if (!any(l, is_pending)) return fmi2OK;
    unsigned status = settle(l);
    Writer w = new_request(&l->client);
    put_list(l, &w, is_pending, true);
    if (status <= fmi2Warning) status = ask(&l->client, SET, &w);
    forget(l, true);
    return told(l, status);
}

fmi2Status fetch(Link *l)
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
