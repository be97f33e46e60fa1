/* docking_mechanism.c - probe-drogue mechanism between servicer and target: contact, soft and hard
 * capture, release, break; the load of each step follows from the predicted motion of both bodies.
 *
 *   free (0), contact (1)   a point in a cone with a floor, in a flat face: Hunt-Crossley, Coulomb
 *   soft (2), hard (3)      spring-damper in six degrees of freedom to a rest point and attitude
 *   released (4)            contact and separation spring;         broken (5): contact
 *
 *   I = integral F_N,  A_S = integral d_S x F_N + M_N,  A_T = -integral d_T x F_N + M_N
 *   F = I/h,   M_S = A_S/h - g/2,   M_T = A_T/h - g/2,   g = (A_S + A_T)/h + m x F
 *
 * The first three lines state the load in each phase. In contact, the tip of the probe is a point
 * that touches the cone, its floor, or the flat face around its mouth. F_N, M_N: force at the tip
 * and couple, both on the servicer, N axes; d_S, d_T: tip from the centres of mass; m: mean of
 * r_S - r_T; the integrals are over the step h. The outputs are the mean loads F, M_S on the
 * servicer and -F, M_T on the target.
 *
 * If the force of a spring of frequency omega were held over each step at its value from the start
 * of the step, each step would multiply the energy by 1 + theta^2/2, theta = omega h. The mechanism
 * therefore integrates both bodies over the step under its own load only (gravity, thrust and
 * wheels move them by less than 1e-6 m), and its outputs are the mean wrench of the step: the
 * factor is then 1 - theta^4/24. Force and reaction act at one point, the tip. The term g shifts
 * the mean forces to one line of action, so that the total momentum is conserved. The phase can
 * change once per call, at its start, before the step. This is the only plant for which two steps
 * of h differ from one of 2 h. With latency = 1, the outputs are for the step after the next
 * communication point, for masters that transfer them one step late (Jacobi). Equations:
 * docs/models.md I. Sources: Hunt & Crossley 1975 (contact). */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "body_rows.h"
#include "docking_events.h"
#include "rk4.h"
#include "small_rotation.h"
#include "two_bodies.h"

typedef DockingParameters Parameters;
typedef struct {
    Body T, S;
    double latch_enable, release;
} Input;
typedef struct {
    MechanismState now;
    Wrench wrench; /* mean load of the last step, as published */
    double missed, peak;
} State;
typedef struct {
    vec3 F_contact_S, M_contact_S, F_T, M_T, tip_Q, dtip_Q;
    quat q_PQ;
    vec3 omega_PQ_Q;
    double misalignment, offset, phase, contact, soft, hard, broken, missed;
    double normal_force, contact_force_peak, load_force, load_moment;
    double energy_elastic, energy_dissipated, energy_drive;
} Output;
MODEL_STRUCT;

static const Model start = {
    .p = DOCKING_START,
    .u = {.T = {.q = {1, 0, 0, 0}}, .S = {.r = {3, 0, 0}, .q = {0, 0, 0, 1}}},
};

static const Variable variables[] = {
    DOCKING_PARAMETERS,

    BODY_INPUTS("T", T, "target"),
    BODY_INPUTS("S", S, "servicer"),
    SWITCH_INPUT(latch_enable, "1: the latch is armed"),
    SWITCH_INPUT(release, "1: command to release"),

    OUTPUT(F_contact_S, "N", "force on the servicer, servicer axes"),
    OUTPUT(M_contact_S, "N.m", "torque on the servicer about its centre of mass, servicer axes"),
    OUTPUT(F_T, "N", "force on the target, target axes"),
    OUTPUT(M_T, "N.m", "torque on the target about its centre of mass, target axes"),
    OUTPUT(tip_Q, "m", "tip of the probe from the centre of the mouth, drogue axes"),
    OUTPUT(dtip_Q, "m/s", "velocity of the tip of the probe as seen in the drogue"),
    OUTPUT(q_PQ, "1", "attitude of the probe relative to the drogue, scalar first"),
    OUTPUT(omega_PQ_Q, "rad/s",
           "angular velocity of the probe relative to the drogue, drogue axes"),
    ANGLE_OUTPUT(misalignment, "angle between the axes of probe and drogue, 0 when mated"),
    NONNEGATIVE_OUTPUT(offset, "m", "distance of the tip from the axis of the drogue"),
    MODE(phase, "phase of the capture", "free|contact|soft capture|hard capture|released|broken"),
    FLAG(contact, "1: contact before capture (phase = 1)"),
    FLAG(soft, "1: soft capture (phase = 2)"),
    FLAG(hard, "1: hard capture (phase = 3)"),
    FLAG(broken, "1: the latch is broken"),
    FLAG(missed, "1: the tip has been deeper in the material than depth_max"),
    NONNEGATIVE_OUTPUT(normal_force, "N",
                       "sum of the normal forces of contact at the start of the step"),
    NONNEGATIVE_OUTPUT(contact_force_peak, "N",
                       "largest normal_force at the internal steps since the start of the run"),
    NONNEGATIVE_OUTPUT(load_force, "N",
                       "magnitude of the mean force between probe and drogue over the step"),
    NONNEGATIVE_OUTPUT(
        load_moment, "N.m",
        "magnitude of the mean moment between probe and drogue about the tip over the step"),
    NONNEGATIVE_OUTPUT(
        energy_elastic, "J",
        "elastic energy of contact, latch and separation spring at the end of the step"),
    OUTPUT(energy_dissipated, "J", "energy dissipated since the start, at the end of the step"),
    OUTPUT(energy_drive, "J",
           "energy put in by latches and retraction drive since the start, at the end of the step"),
};

static void check(const Parameters *p, Problems *problems) { check_docking(problems, p); }

/* ---- relative motion of the ports ---- */
typedef struct {
    vec3_pair p; /* p_PS_S, p_QT_T */
    quat_pair q; /* q_PS, q_QT */
} PortGeometry;

static PortGeometry port_geometry(const Parameters *p)
{
    PortGeometry of;
    set_vec(&of.p, BODY_S, p->p_PS_S);
    set_vec(&of.p, BODY_T, p->p_QT_T);
    set_quat(&of.q, BODY_S, canonical(p->q_PS));
    set_quat(&of.q, BODY_T, canonical(p->q_QT));
    return of;
}

static PortState port_state(const PortGeometry *restrict p, const TwoBodies *restrict x,
                            const mat3_pair *restrict C)
{
    PortState s;
    quat_pair q;
    vec3_pair port, w, v;
    for (int i = 0; i < PAIR; i++) {
        mat3 C_i = mat_of_pair(C, i);
        set_quat(&q, i, product(quat_of(&x->q, i), quat_of(&p->q, i)));
        set_vec(&port, i, tmul(C_i, vec_of(&p->p, i)));
        set_vec(&w, i, tmul(C_i, vec_of(&x->w, i)));
    }
    vec3 d_S = vec_of(&port, BODY_S), d_T = add(x->rho, d_S);
    set_vec(&s.d, BODY_S, d_S);
    set_vec(&s.d, BODY_T, d_T);
    for (int i = 0; i < PAIR; i++) set_vec(&v, i, cross(vec_of(&w, i), vec_of(&s.d, i)));
    quat q_QN = quat_of(&q, BODY_T);
    s.C_QN = dcm_of_quat(q_QN);
    s.e = mul(s.C_QN, sub(d_T, vec_of(&port, BODY_T)));
    s.u = mul(s.C_QN, sum3(x->drho, vec_of(&v, BODY_S), neg(vec_of(&v, BODY_T))));
    s.w = mul(s.C_QN, sub(vec_of(&w, BODY_S), vec_of(&w, BODY_T)));
    s.q_PQ = canonical(product(conjugate(q_QN), quat_of(&q, BODY_S)));
    return s;
}

static PortState port_state_of(const PortGeometry *p, const TwoBodies *x)
{
    mat3_pair at = attitude_matrices(x);
    return port_state(p, x, &at);
}

/* relative motion of both bodies. Positions are subtracted first: a sum with an orbit radius
 * loses seven digits. */
static TwoBodies relative_motion(const Input *u)
{
    TwoBodies b = {.rho = sub(u->S.r, u->T.r), .drho = sub(u->S.v, u->T.v)};
    set_quat(&b.q, BODY_S, canonical(u->S.q));
    set_quat(&b.q, BODY_T, canonical(u->T.q));
    set_vec(&b.w, BODY_S, u->S.omega);
    set_vec(&b.w, BODY_T, u->T.omega);
    return b;
}

/* ---- prediction ---- */
typedef struct {
    TwoBodies body;
    vec3 I, couple; /* integrals over the step of F_N and of the couple M_N */
    vec3_pair A;    /* integrals over the step of the torques on S and on T, N axes */
    double dissipated, drive;
} Motion;
typedef struct {
    const Port *port;
    const PhaseEntry *entry;
    PortGeometry port_geometry;
    TwoMasses m;
} Context;

static void derivative(const Context *c, double t, const Motion *x, Motion *dx)
{
    mat3_pair at = attitude_matrices(&x->body);
    PortState s = port_state(&c->port_geometry, &x->body, &at);
    PortLoad load = port_load(c->port, c->entry, &s, t);
    vec3 F_N = tmul(s.C_QN, load.F), M_N = tmul(s.C_QN, load.M);
    Wrench on = {.F = F_N};
    for (int i = 0; i < PAIR; i++) set_vec(&on.M, i, add(cross(vec_of(&s.d, i), F_N), M_N));
    set_vec(&on.M, BODY_T, neg(vec_of(&on.M, BODY_T)));
    two_bodies_derivative(&c->m, &x->body, &at, &on, &dx->body);
    dx->I = on.F;
    dx->A = on.M;
    dx->couple = M_N;
    dx->dissipated = load.P_diss;
    dx->drive = load.P_drive;
}

RK4(integrate_motion, derivative, Context, Motion)

typedef struct {
    TwoMasses m;
    Wrench on;
} HeldLoad;

static void held_derivative(const HeldLoad *c, double t, const TwoBodies *x, TwoBodies *dx)
{
    (void)t;
    mat3_pair at = attitude_matrices(x);
    two_bodies_derivative(&c->m, x, &at, &c->on, dx);
}

RK4(propagate_under_load, held_derivative, HeldLoad, TwoBodies)

/* updates the largest normal force, and sets `missed` if the tip is too deep in the material, at
 * an instant inside the step; while the latch holds, no contact acts */
static void record_contact(const Context *c, State *x, const TwoBodies *b, double t)
{
    if (is_latched(c->entry)) return;
    PortState s = port_state_of(&c->port_geometry, b);
    PortLoad load = port_load(c->port, c->entry, &s, t);
    x->now.F_inner = larger(x->now.F_inner, load.normal);
    x->peak = larger(x->peak, load.normal);
    if (load.too_deep) x->missed = 1;
}

/* mean wrench of the step from b to `end`, with force and reaction on one line of action; the
 * variable `mean` is the mean of r_S - r_T over the step under a constant F */
static Wrench balanced_wrench(const TwoMasses *m, const TwoBodies *b, const Motion *end, double h)
{
    Wrench w = {.F = scale(1 / h, end->I)};
    vec3 M_S = scale(1 / h, vec_of(&end->A, BODY_S)), M_T = scale(1 / h, vec_of(&end->A, BODY_T));
    vec3 mean = sum3(b->rho, scale(h / 2, b->drho), scale(h * h / (6 * m->m_red), w.F));
    vec3 half = scale(0.5, sum3(M_S, M_T, cross(mean, w.F)));
    set_vec(&w.M, BODY_S, sub(M_S, half));
    set_vec(&w.M, BODY_T, sub(M_T, half));
    return w;
}

/* rotation matrix C(q_m) of body i for its mean attitude during the step */
static mat3 mean_attitude(const TwoBodies *b, const TwoBodies *end, int i, double h)
{
    vec3 a = scale(h / 6, add(scale(2, vec_of(&b->w, i)), vec_of(&end->w, i)));
    return dcm_of_quat(product(quat_of(&b->q, i), rotation(a)));
}

static void publish_loads(const TwoBodies *b, const TwoBodies *end, const Wrench *w, double h,
                          Output *y)
{
    mat3 C_SN = mean_attitude(b, end, BODY_S, h), C_TN = mean_attitude(b, end, BODY_T, h);
    vec3 none = vec(0, 0, 0); /* added to each load, so that a load of -0 becomes +0 */
    y->F_contact_S = add(none, mul(C_SN, w->F));
    y->M_contact_S = add(none, mul(C_SN, vec_of(&w->M, BODY_S)));
    y->F_T = sub(none, mul(C_TN, w->F));
    y->M_T = add(none, mul(C_TN, vec_of(&w->M, BODY_T)));
}

static void predict_load(const Parameters *p, State *x, TwoBodies b, double t, double h, Output *y)
{
    const Context c = {&p->port, &x->now.entry, port_geometry(p),
                       two_masses(p->mass_S, p->J_S, p->mass_T, p->J_T)};
    if (p->latency) {
        const HeldLoad before = {c.m, x->wrench};
        propagate_under_load(&before, t, h, &b);
        normalise(&b);
        t += h;
    }
    Motion x_t = {.body = b};
    double n = ceiling_of(h / p->max_step - 1e-9), dt = h / n;
    x->now.F_inner = 0;
    for (double i = 0; i < n; i++) {
        integrate_motion(&c, t + i * dt, dt, &x_t);
        normalise(&x_t.body);
        record_contact(&c, x, &x_t.body, t + (i + 1) * dt);
    }
    PortState s = port_state_of(&c.port_geometry, &x_t.body);
    y->energy_elastic = port_load(&p->port, &x->now.entry, &s, t + h).U;
    x->wrench = balanced_wrench(&c.m, &b, &x_t, h);
    x->now.load_force = norm(x->wrench.F);
    x->now.load_moment = norm(scale(1 / h, x_t.couple));
    x->now.dissipated += x_t.dissipated;
    x->now.drive += x_t.drive;
    publish_loads(&b, &x_t.body, &x->wrench, h, y);
}

/* ---- outputs ---- */
static void publish_pose(const PortState *s, Output *y)
{
    y->tip_Q = s->e;
    y->dtip_Q = s->u;
    y->q_PQ = s->q_PQ;
    y->omega_PQ_Q = s->w;
    y->misalignment = misalignment(s);
    y->offset = offset(s->e);
}

static void publish(const State *x, Output *y)
{
    double phase = x->now.entry.phase;
    y->phase = phase;
    y->contact = phase == CONTACT;
    y->soft = phase == SOFT;
    y->hard = phase == HARD;
    y->broken = phase == BROKEN;
    y->missed = x->missed;
    y->contact_force_peak = x->peak;
    y->load_force = x->now.load_force;
    y->load_moment = x->now.load_moment;
    y->energy_dissipated = x->now.dissipated;
    y->energy_drive = x->now.drive;
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    PortGeometry of = port_geometry(p);
    TwoBodies b = relative_motion(u);
    PortState s = port_state_of(&of, &b);
    *x = (State){.now.entry = {.phase = FREE, .t_phase = t, .q_R = {1, 0, 0, 0}}};
    publish_pose(&s, y);
    publish(x, y);
}

static void clear_loads(State *x, Output *y)
{
    vec3 none = vec(0, 0, 0);
    x->wrench = (Wrench){.F = none};
    x->now.F_inner = x->now.load_force = x->now.load_moment = 0;
    y->F_contact_S = y->M_contact_S = y->F_T = y->M_T = none;
    y->energy_elastic = 0;
}

/* true if the tip is so far from mouth and material of the drogue that no load can act within
 * two steps */
static int is_far(const Parameters *p, const State *x, const PortState *s, double h)
{
    int idle = x->now.entry.phase == FREE || x->now.entry.phase == BROKEN;
    double r = sqrt(s->e.y * s->e.y + s->e.z * s->e.z), path = 4 * h * norm(s->u);
    return idle && larger(s->e.x, r - p->port.face_radius) > 0.1 + path;
}

/* length of a step: the multiple of max_step that equals h within the tolerance of the grid,
 * because masters accumulate rounding errors in time; h if there is no such multiple */
static double exact_step(double h, double max_step)
{
    double whole = grid_number(h, max_step);
    return whole > 0 ? whole * max_step : h; /* NaN, for an h off the grid, is not > 0 */
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    t = grid_time(t, p->max_step).t;
    h = exact_step(h, p->max_step);
    PortGeometry of = port_geometry(p);
    TwoBodies b = relative_motion(u);
    PortState s = port_state_of(&of, &b);
    update_phase(p, u->latch_enable > 0, u->release > 0, &x->now, &s, t);
    PortLoad now = port_load(&p->port, &x->now.entry, &s, t);
    if (now.too_deep) x->missed = 1;
    y->normal_force = now.normal;
    publish_pose(&s, y);
    if (is_far(p, x, &s, h)) clear_loads(x, y);
    else predict_load(p, x, b, t, h, y);
    publish(x, y);
}

FMU_MODEL("docking_mechanism", "Probe-drogue mechanism: contact, soft and hard capture, release, "
                               "with the mean load of the predicted motion");
