/* link_requests.c - requests of a link FMU, and log messages for its master. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "link.h"

/* ---- log */
void log_line(const Link *l, fmi2Status status, const char *category, const char *text)
{
    char line[MESSAGE_SIZE + 100];
    if (!l->call.logger) return;
    snprintf(line, sizeof line, "%s", text);
    for (char *at = line; *at; at++)
        if (*at == '%') *at = ' ';
    l->call.logger(l->call.componentEnvironment, l->name, status, category, line);
}

fmi2Status failure(const Link *l, const char *function, const char *text)
{
    char line[MESSAGE_SIZE + 100];
    snprintf(line, sizeof line, "%s: %s", function, text);
    log_line(l, fmi2Error, "logStatusError", line);
    return fmi2Error;
}

fmi2Status report_answer(Link *l, unsigned status)
{
    if (status == fmi2Warning && l->log_warnings)
        log_line(l, fmi2Warning, "logStatusWarning", l->client.message);
    if (status > fmi2Warning) log_line(l, (fmi2Status)status, "logStatusError", l->client.message);
    return (fmi2Status)status;
}

/* ---- requests */
static unsigned report_wrong_values(Link *l)
{
    snprintf(l->client.message, MESSAGE_SIZE, "the answer does not contain the requested values");
    return fmi2Error;
}

unsigned finish_exchange(Link *l, unsigned status)
{
    return status <= fmi2Warning && !take_values(l, was_read) ? report_wrong_values(l) : status;
}

unsigned finish_late_answer(Link *l)
{
    if (!l->client.outstanding) return fmi2OK;
    return finish_exchange(l, wait_for_answer(&l->client));
}

fmi2Status send_simple_request(Link *l, Code code)
{
    unsigned status = finish_late_answer(l);
    Writer w = new_request(&l->client);
    return report_answer(l, status > fmi2Warning ? status : request_and_wait(&l->client, code, &w));
}

fmi2Status send_pending(Link *l)
{
    if (!any_entry(l, is_pending)) return fmi2OK;
    unsigned status = finish_late_answer(l);
    Writer w = new_request(&l->client);
    put_list(l, &w, is_pending, true);
    if (status <= fmi2Warning) status = request_and_wait(&l->client, SET, &w);
    invalidate(l, true);
    return report_answer(l, status);
}

fmi2Status read_missing(Link *l)
{
    if (l->client.outstanding && !any_entry(l, needs_value))
        return fmi2OK; /* no request: until the late answer arrives, the master reads old outputs */
    fmi2Status status = send_pending(l);
    if (status > fmi2Warning || !any_entry(l, needs_value)) return status;
    unsigned outcome = finish_late_answer(l);
    Writer w = new_request(&l->client);
    put_list(l, &w, needs_value, false);
    if (outcome <= fmi2Warning) outcome = request_and_wait(&l->client, GET, &w);
    if (outcome <= fmi2Warning && !take_values(l, needs_value)) outcome = report_wrong_values(l);
    return report_answer(l, outcome);
}
