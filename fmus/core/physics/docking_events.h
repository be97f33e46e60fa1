/* docking_events.h - phases of the docking mechanism: latch window, capture, release, break.
 *
 * The phase changes only at communication points, at most once at each. Between soft and hard
 * capture a drive in the latch retracts the probe. A jump of the stored energy at a change of phase
 * is added to the work of this drive if it is positive, else to the dissipated energy. Equations:
 * docs/models.md I.4 */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef DOCKING_EVENTS_H
#define DOCKING_EVENTS_H

#include "docking_rows.h"
#include "time_grid.h"

typedef struct {
    /* phase; time of the last change_phase(); tip position at soft capture or release; rest attitude,
     * set at soft capture */
    PhaseEntry entry;
    /* 1 in the latch window; time of entry into it; largest normal force from the step before on */
    double in_window, t_window, window_force;
    double F_inner; /* largest normal force at the internal steps of the last step */
    double load_force, load_moment; /* sizes of mean force and couple over the last step */
    double dissipated, drive;
} MechanismState;

static inline vec3 probe_axis(const PortState *s) { return dcm_of_quat(s->q_PQ).row[0]; }
static inline double misalignment(const PortState *s)
{
    return angle(probe_axis(s), vec(-1, 0, 0));
}
static inline double offset(vec3 e) { return sqrt(e.y * e.y + e.z * e.z); }
static inline int is_latched(const PhaseEntry *c) { return c->phase == SOFT || c->phase == HARD; }

/* sets the phase; adds a rise of the stored energy to the work of the drive, a fall to the
 * dissipated energy */
static inline void change_phase(const DockingParameters *p, MechanismState *x, const PortState *s,
                                double phase, double t)
{
    double before = port_load(&p->port, &x->entry, s, t).U;
    if (phase == SOFT || phase == RELEASED) x->entry.e_c = s->e;
    if (phase == SOFT) x->entry.q_R = rest_attitude(s->q_PQ);
    x->entry.phase = phase;
    x->entry.t_phase = t;
    x->in_window = 0;
    double rise = port_load(&p->port, &x->entry, s, t).U - before;
    x->drive += larger(rise, 0);
    x->dissipated += larger(-rise, 0);
}

static inline int in_latch_window(const DockingParameters *p, int armed, const PortState *s,
                                  const PortLoad *touch)
{
    return armed && s->e.x <= -p->latch_depth && offset(s->e) <= p->latch_offset &&
           misalignment(s) <= p->latch_angle && norm(s->u) <= p->latch_speed &&
           norm(s->w) <= p->latch_rate && !touch->too_deep;
}

/* updates the state of the latch window. Soft capture needs a normal force of at least trip_force
 * in the window: a probe that is too slow bounces off. armed: 0: the window stays closed */
static inline void update_latch_window(const DockingParameters *p, int armed, MechanismState *x,
                                       const PortState *s, double t)
{
    PortLoad touch = contact_load(&p->port, s->e, s->u);
    x->entry.phase = touch.touches ? CONTACT : FREE;
    if (!in_latch_window(p, armed, s, &touch)) {
        x->in_window = 0;
        return;
    }
    if (!x->in_window) x->in_window = 1, x->t_window = t, x->window_force = 0;
    x->window_force = larger(x->window_force, larger(touch.normal, x->F_inner));
    if (x->window_force >= p->trip_force && reached(t, x->t_window + p->latch_dwell))
        change_phase(p, x, s, SOFT, t);
}

static inline int is_seated(const DockingParameters *p, const MechanismState *x, const PortState *s,
                            double t)
{
    return reached(t, x->entry.t_phase + p->port.draw_delay + p->port.draw_time) &&
           norm(sub(s->e, seated_tip(&p->port))) <= p->hard_distance &&
           4 * norm(rotation_from_rest(&x->entry, s)) <= p->hard_angle &&
           norm(s->u) <= p->hard_speed && norm(s->w) <= p->hard_rate;
}

static inline void update_phase(const DockingParameters *p, int armed, int release,
                                MechanismState *x, const PortState *s, double t)
{
    if (x->entry.phase == FREE || x->entry.phase == CONTACT) update_latch_window(p, armed, x, s, t);
    else if (is_latched(&x->entry)) {
        if (x->load_force > p->break_force || x->load_moment > p->break_moment)
            change_phase(p, x, s, BROKEN, t);
        else if (release) change_phase(p, x, s, RELEASED, t);
        else if (x->entry.phase == SOFT && is_seated(p, x, s, t)) change_phase(p, x, s, HARD, t);
    } else if (x->entry.phase == RELEASED) {
        int out = s->e.x - x->entry.e_c.x >= p->port.stroke_sep && s->e.x > 0;
        if (out && !release) change_phase(p, x, s, FREE, t);
    }
}

#endif
