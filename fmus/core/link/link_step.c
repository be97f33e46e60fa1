/* link_step.c - the step of a link FMU: one exchange, and the treatment of late answers. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "link.h"

/* sends the request of a step from t to t + h; if earlier steps were not sent (`behind`), the
 * request begins at the end of the last step that was sent */
static bool send_exchange(Link *l, double t, double h, fmi2Boolean final)
{
    Writer w = new_request(&l->client);
    put_list(l, &w, is_pending, true);
    put_double(&w, l->behind ? l->time : t);
    put_double(&w, l->behind ? t + h - l->time : h);
    put_number(&w, final != 0, 1);
    put_list(l, &w, was_read, false);
    invalidate(l, true);
    l->time = t + h;
    l->behind = false;
    return send_request(&l->client, EXCHANGE, &w);
}

static unsigned hold_outputs(Link *l)
{
    for (Entry *e = l->entry; e < l->entry + l->entries; e++) e->valid = e->read;
    return fmi2OK;
}

/* waits for the answer to a step until the deadline. If the answer is late, waits longer, leaves
 * the outputs as they are, or fails, as configured. */
static unsigned wait_for_step(Link *l)
{
    Client *c = &l->client;
    unsigned status = FAILED_REQUEST;
    if (c->config.deadline <= 0) return finish_exchange(l, wait_for_answer(c));
    const double until = now_s() + c->config.deadline;
    Outcome outcome = wait_until(c, until, &status);
    while (outcome == TOO_LATE && now_s() < until && c->attempts <= c->config.retries &&
           write_request(c)) /* the board has reported a damaged request */
        outcome = wait_until(c, until, &status);
    if (outcome != TOO_LATE) return finish_exchange(l, status);
    l->late++;
    if (c->config.late == LATE_WAIT) return finish_exchange(l, wait_for_answer(c));
    if (c->config.late == LATE_HOLD && now_s() < c->sent + c->config.timeout)
        return hold_outputs(l);
    bool held = c->config.late == LATE_HOLD;
    snprintf(c->message, sizeof c->message, "fmi2DoStep: no answer within the %s of %g s",
             held ? "timeout" : "deadline", held ? c->config.timeout : c->config.deadline);
    return fmi2Error;
}

fmi2Status fmi2DoStep(fmi2Component component, fmi2Real t, fmi2Real h, fmi2Boolean final)
{
    Link *l = component;
    unsigned status = fmi2OK;
    if (l->client.outstanding) {
        status = wait_for_step(l); /* waits for the late answer to an earlier step */
        l->behind |= l->client.outstanding;
    }
    lock_stream(&l->client.stream);
    if (status <= fmi2Warning && !l->client.outstanding)
        status = send_exchange(l, t, h, final) ? wait_for_step(l) : FAILED_REQUEST;
    unlock_stream(&l->client.stream);
    return report_answer(l, status);
}
