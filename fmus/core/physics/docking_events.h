/* docking_events.h - phases of the docking mechanism: the window of the latch, capture, release,
 * break.
 *
 * Once per call, at the sample. Between soft and hard capture the probe is drawn in. A change of
 * phase books the jump of the stored energy. Equations: docs/models.md I.4 */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef DOCKING_EVENTS_H
#define DOCKING_EVENTS_H

#include "docking_rows.h"
#include "time_grid.h"

typedef struct {
    Catch at;                /* phase, since when, where */
    double waits, t_w, trip; /* inside the window of the latch: since when, hardest blow */
    double F_inner;          /* largest normal force at the inner instants of the last step */
    double load_force, load_moment; /* of the last step */
    double dissipated, drive;
} Capture;

static inline vec3 axis_of_probe(const PortState *s) { return dcm_of_quat(s->q_PQ).row[0]; }
static inline double misalignment(const PortState *s)
{
    return angle(axis_of_probe(s), vec(-1, 0, 0));
}
static inline double offset(vec3 e) { return sqrt(e.y * e.y + e.z * e.z); }
static inline int is_latched(const Catch *c) { return c->phase == SOFT || c->phase == HARD; }

/* a rise of the stored energy is put in by the latches, a fall is lost */
static inline void enter(const DockingParameters *p, Capture *x, const PortState *s, double phase,
                         double t)
{
    double before = port_load(&p->port, &x->at, s, t).U;
    if (phase == SOFT || phase == RELEASED) x->at.e_c = s->e;
    if (phase == SOFT) x->at.q_R = rest_attitude(s->q_PQ);
    x->at.phase = phase;
    x->at.t_phase = t;
    x->waits = 0;
    double rise = port_load(&p->port, &x->at, s, t).U - before;
    x->drive += larger(rise, 0);
    x->dissipated += larger(-rise, 0);
}

static inline int inside(const DockingParameters *p, int armed, const PortState *s,
                         const PortLoad *touch)
{
    return armed && s->e.x <= -p->latch_depth && offset(s->e) <= p->latch_offset &&
           misalignment(s) <= p->latch_angle && norm(s->u) <= p->latch_speed &&
           norm(s->w) <= p->latch_rate && !touch->too_deep;
}

/* the catch must be struck: too slow a probe bounces */
static inline void watch_window(const DockingParameters *p, int armed, Capture *x,
                                const PortState *s, double t)
{
    PortLoad touch = contact_load(&p->port, s->e, s->u);
    x->at.phase = touch.touches ? CONTACT : FREE;
    if (!inside(p, armed, s, &touch)) {
        x->waits = 0;
        return;
    }
    if (!x->waits) x->waits = 1, x->t_w = t, x->trip = 0;
    x->trip = larger(x->trip, larger(touch.normal, x->F_inner));
    if (x->trip >= p->trip_force && reached(t, x->t_w + p->latch_dwell)) enter(p, x, s, SOFT, t);
}

static inline int is_seated(const DockingParameters *p, const Capture *x, const PortState *s,
                            double t)
{
    return reached(t, x->at.t_phase + p->port.draw_delay + p->port.draw_time) &&
           norm(sub(s->e, seat(&p->port))) <= p->hard_distance &&
           4 * norm(rotation_from_rest(&x->at, s)) <= p->hard_angle &&
           norm(s->u) <= p->hard_speed && norm(s->w) <= p->hard_rate;
}

static inline void events(const DockingParameters *p, int armed, int release, Capture *x,
                          const PortState *s, double t)
{
    if (x->at.phase == FREE || x->at.phase == CONTACT) watch_window(p, armed, x, s, t);
    else if (is_latched(&x->at)) {
        if (x->load_force > p->break_force || x->load_moment > p->break_moment)
            enter(p, x, s, BROKEN, t);
        else if (release) enter(p, x, s, RELEASED, t);
        else if (x->at.phase == SOFT && is_seated(p, x, s, t)) enter(p, x, s, HARD, t);
    } else if (x->at.phase == RELEASED) {
        int out = s->e.x - x->at.e_c.x >= p->port.stroke_sep && s->e.x > 0;
        if (out && !release) enter(p, x, s, FREE, t);
    }
}

#endif
