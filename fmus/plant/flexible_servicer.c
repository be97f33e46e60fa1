/* flexible_servicer.c - servicer with hinged solar panels and sloshing propellant.
 *
 *   [ U    V ] [ A     ]   [ F_S - omega x (omega x s) - N_F - sum g p                          ]
 *   [ V^T  W ] [ alpha ] = [ M - omega x (I omega + A_w Omega) - A_w dOmega/dt - N_M - sum g l ]
 *   U = m 1 - sum p p^T/M,   V = -s~ - sum p l^T/M,   W = I - sum l l^T/M
 *   dv/dt = f + C_SN^T A,   domega/dt = alpha,   q_k'' = g_k - (p_k.A + l_k.alpha)/M_k
 *
 * Up to four panels, each hinged to the hub with spring and damper, and up to four masses that
 * slosh along a line. Each of these parts k has a coordinate q_k. m, s, I: mass, first moment and
 * inertia about S; (5), (6) of docs/models.md L.2 give N_F, N_M and the M, p, l, g of each
 * coordinate. S is the point of the hub where the centre of mass C of the undeformed vehicle lies:
 * a force through S turns a deformed vehicle. f: gravity and disturbance at C, the same for all
 * parts; the gravity gradient acts on every part. Before t_att the attitude of the hub is held,
 * while the coordinates move. Without panels and slosh the model equals `servicer`. Classical
 * Runge-Kutta on the grid of max_step/n, n from (12). Equation numbers: docs/models.md L. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "flexible_rules.h"
#include "rk4.h"

typedef FlexibleParameters Parameters;
typedef struct { BaseInput base; } Input;
typedef struct {
    BaseState base;
    double q[PARTS], dq[PARTS]; /* angles of the panels, displacements of the slosh masses */
    double dissipated[2];       /* energy dissipated by the dampers of panels, of slosh masses */
} Motion;
typedef struct {
    Motion now;
    /* vehicle: constants of hub and parts; substeps: n of (12) in docs/models.md L; both depend on
     * parameters only */
    Vehicle vehicle;
    double substeps;
} State;
typedef struct {
    BaseOutput base;
    double panel_angle[PANELS], panel_rate[PANELS];
    double slosh_displacement[SLOSHES], slosh_rate[SLOSHES], slosh_mass[SLOSHES], hub_mass;
    vec3 r_CS_S, r_CN_N, v_CN_N, h_N;
    double kinetic_energy, elastic_energy, dissipated_energy, slosh_beyond_travel[SLOSHES];
} Output;
MODEL_STRUCT;

#define QUARTER_HERTZ   1.5707963267948966
#define TWENTIETH_HERTZ 0.3141592653589793

static const Model start = {
    .p = {.base = BASE_START,
          .panel = {.mass = {8, 8},
                    .hinge_S = {{0, 0.5, 0}, {0, -0.5, 0}, {0, 0.5, 0}, {0, -0.5, 0}},
                    .arm_S = {{0, 0.75, 0}, {0, -0.75, 0}, {0, 0.75, 0}, {0, -0.75, 0}},
                    .axis_S = {{0, 0, 1}, {0, 0, 1}, {0, 0, 1}, {0, 0, 1}},
                    .inertia = {{0.43, 1.31, 1.73},
                                {0.43, 1.31, 1.73},
                                {0.43, 1.31, 1.73},
                                {0.43, 1.31, 1.73}},
                    .frequency = {QUARTER_HERTZ, QUARTER_HERTZ, QUARTER_HERTZ, QUARTER_HERTZ},
                    .damping_ratio = {0.003, 0.003, 0.003, 0.003}},
          .slosh = {.mass_0 = {3, 3},
                    .position_S = {{0, 0, 0.25}, {0, 0, -0.25}},
                    .axis_S = {{1, 0, 0}, {0, 1, 0}, {1, 0, 0}, {0, 1, 0}},
                    .frequency = {TWENTIETH_HERTZ, TWENTIETH_HERTZ, TWENTIETH_HERTZ,
                                  TWENTIETH_HERTZ},
                    .damping_ratio = {0.02, 0.02, 0.02, 0.02},
                    .travel = {0.15, 0.15, 0.15, 0.15}}},
};

/* parameter with three elements per panel or slosh mass */
#define TRIPLES(name, member, unit, text) \
    ROW_AS(PARAMETER_ROW, p, name, member, 3, unit, text, ANY_VALUE)

static const Variable variables[] = {
    BASE_PARAMETERS,
    NONNEGATIVE_AS("panel_mass", panel.mass, "kg", "mass of the panels; 0 = no such panel"),
    TRIPLES("panel_hinge_S", panel.hinge_S, "m",
            "positions of the hinges of the panels from S, one row each"),
    TRIPLES("panel_arm_S", panel.arm_S, "m",
            "from the hinge to the centre of mass of the panel at angle 0, one row each"),
    TRIPLES("panel_axis_S", panel.axis_S, "1",
            "hinge axes, perpendicular to the arms, any length, one row each"),
    TRIPLES("panel_inertia", panel.inertia, "kg.m2",
            "moments of inertia of the panels about their centres of mass along arm, axis, and "
            "arm x axis, one row each"),
    PARAMETER_AS("panel_frequency", panel.frequency, "rad/s",
                 "natural frequency of the panels on a fixed hub; 0 = free hinge"),
    PARAMETER_AS("panel_damping_ratio", panel.damping_ratio, "1",
                 "damping ratio of the panels on a fixed hub"),
    PARAMETER_AS("panel_angle_0", panel.angle_0, "rad", "angles of the panels at the start"),
    PARAMETER_AS("panel_rate_0", panel.rate_0, "rad/s", "rates of the panels at the start"),
    NONNEGATIVE_AS("slosh_mass_0", slosh.mass_0, "kg", "sloshing masses at the start; 0 = none"),
    TRIPLES("slosh_position_S", slosh.position_S, "m",
            "positions of the sloshing masses at rest from S, one row each"),
    TRIPLES("slosh_axis_S", slosh.axis_S, "1",
            "directions in which the masses slosh, any length, one row each"),
    PARAMETER_AS("slosh_frequency", slosh.frequency, "rad/s",
                 "natural frequency of the sloshing masses in a fixed hub"),
    PARAMETER_AS("slosh_damping_ratio", slosh.damping_ratio, "1",
                 "damping ratio of the sloshing masses in a fixed hub"),
    PARAMETER_AS("slosh_displacement_0", slosh.displacement_0, "m",
                 "displacements of the sloshing masses at the start"),
    PARAMETER_AS("slosh_rate_0", slosh.rate_0, "m/s", "rates of the sloshing masses at the start"),
    PARAMETER_AS(
        "slosh_travel", slosh.travel, "m",
        "largest displacement in the tank, checked by slosh_beyond_travel only; 0 = no limit"),
    PARAMETER_AS("slosh_draw", slosh.draw, "1",
                 "share of the propellant consumption that each sloshing mass loses"),

    BASE_INPUTS,

    BASE_OUTPUTS,
    OUTPUT(panel_angle, "rad", "angles of the panels"),
    OUTPUT(panel_rate, "rad/s", "rates of the panels"),
    OUTPUT(slosh_displacement, "m", "displacements of the sloshing masses along their axes"),
    OUTPUT(slosh_rate, "m/s", "rates of the sloshing masses along their axes"),
    NONNEGATIVE_OUTPUT(slosh_mass, "kg",
                       "present sloshing masses, reduced by the propellant consumption"),
    ROW_AS(OUTPUT_ROW, y, "hub_mass", hub_mass, 1, "kg",
           "present mass of the hub with its propellant, without panels and sloshing masses",
           POSITIVE_VALUE),
    OUTPUT(r_CS_S, "m", "present centre of mass of the vehicle from S, body axes"),
    OUTPUT(r_CN_N, "m", "position of the centre of mass, N axes"),
    OUTPUT(v_CN_N, "m/s", "velocity of the centre of mass, N axes"),
    OUTPUT(h_N, "N.m.s", "angular momentum about the centre of mass, wheels included, N axes"),
    OUTPUT(kinetic_energy, "J",
           "kinetic energy of the motion about the centre of mass, wheels counted as locked"),
    OUTPUT(elastic_energy, "J", "energy in the springs of panels and sloshing masses"),
    OUTPUT(dissipated_energy, "J",
           "energy dissipated by panels and sloshing masses since the start"),
    ALARM(slosh_beyond_travel, "1: the sloshing mass is beyond slosh_travel, outside its tank"),
};

static void check(const Parameters *p, Problems *problems) { check_flexible(problems, p); }

/* ---- motion ---- */
typedef struct {
    const Parameters *p;
    const Vehicle *v;
    Interval held;
    vec3 F, M; /* load of actuators, contact and wheels, constant in an internal step */
} Context;

static Context context(const Parameters *p, const State *x, const Input *u, const Substep *s)
{
    Context c = {.p = p, .v = &x->vehicle, .held = interval(&p->base, &u->base, &x->now.base, s)};
    c.F = force_S(&u->base);
    c.M = sub(torque_S(&u->base), mul(p->base.A_w, c.held.wheel_accel));
    return c;
}

static vec3 hub_rate(int released, const BaseState *x)
{
    return released ? x->omega : vec(0, 0, 0);
}

static void place_vehicle(Placement *at, const Vehicle *v, const Motion *x)
{
    place_parts(at, v, v->mass_0 - x->base.mass, x->q, x->dq);
}

/* (8): position and velocity of the centre of mass, N axes */
static PosVel centre_of_mass(const Placement *at, const BaseState *x, const mat3 *C_SN, vec3 omega)
{
    return (PosVel){add(x->r, tmul(*C_SN, at->c)),
                    add(x->v, tmul(*C_SN, add(cross(omega, at->c), at->dc)))};
}

static TidalField tidal_field(const BaseParameters *p, const mat3 *C_SN, vec3 r_CN_N)
{
    if (!p->use_gravity_gradient || p->orbit.mu == 0) return (TidalField){0, {0, 0, 0}};
    double r = norm(r_CN_N);
    return (TidalField){p->orbit.mu / (r * r * r), scale(1 / r, mul(*C_SN, r_CN_N))};
}

/* (7), then (6): time derivatives of the motion */
static void flexible_rates(const Context *c, double t, const Motion *x, Motion *dx)
{
    const BaseParameters *p = &c->p->base;
    const Interval *held = &c->held;
    vec3 w = hub_rate(held->released, &x->base);
    mat3 C_SN = dcm_of_mrp(x->base.sigma);
    Placement at;
    EffectiveInertia effective;
    place_vehicle(&at, c->v, x);
    set_effective_inertia(&effective, c->v, &at);
    PosVel C = centre_of_mass(&at, &x->base, &C_SN, w);
    TidalField field = tidal_field(p, &C_SN, C.r);
    BiasTerms bias;
    set_bias_terms(&bias, &at, w, &field);

    vec3 momentum = add(sym_mul(effective.I, w), mul(p->A_w, x->base.wheel_speed));
    vec3 F = sub(sub(c->F, cross(w, cross(w, at.s))), bias.F);
    vec3 M = add(c->M, sinusoid(&p->M_dist_S, held->step_start, t));
    if (field.g != 0) M = add(M, tidal_torque(&field, &at, &effective.I));
    M = sub(sub(M, cross(w, momentum)), bias.M);

    Acceleration a = acceleration(&effective, F, M, !held->released);
    vec3 f = add(free_fall_N(p, &C.r, &C.v, held->step_start, t),
                 velocity_turning_N(p, held->released, &x->base, C.v));
    *dx = (Motion){.dissipated = {0}};
    dx->base.r = x->base.v;
    dx->base.v = add(f, tmul(C_SN, a.A));
    dx->base.sigma = mrp_rate(x->base.sigma, w);
    dx->base.omega = a.alpha;
    dx->base.mass = -held->u->mdot;
    if (held->released) dx->base.wheel_speed = held->wheel_accel;
    for (int i = 0; i < at.count; i++) {
        const PlacedPart *b = &at.part[i];
        dx->q[b->k] = b->rate;
        dx->dq[b->k] = bias.g[i] - b->part->P_size * dot(b->t, a.A) - dot(b->L, a.alpha);
        dx->dissipated[b->k >= PANELS] += b->part->damping * b->M * b->rate * b->rate;
    }
}

static void derivative(const Context *c, double t, const Motion *x, Motion *dx)
{
    if (c->v->count > 0) flexible_rates(c, t, x, dx);
    else *dx = (Motion){.base = rigid_rates(&c->held, t, &x->base)};
}

RK4(integrate, derivative, Context, Motion)

/* ---- outputs ---- */
/* (11): sets the outputs of momentum and energy about C. From the terms of the motion about S,
 * h = I w + sum l q' and 2 T = w.(I w) + 2 w.sum l q' + sum M q'^2, the terms of a mass m that
 * moves with C are subtracted. */
static void publish_momentum(const Parameters *p, const Vehicle *v, const Placement *at,
                             const mat3 *C_SN, Output *y)
{
    vec3 w = y->base.omega_SN_S, v_c = add(cross(w, at->c), at->dc), of_parts = vec(0, 0, 0);
    vec3 Iw = sym_mul(inertia_about_S(v, at), w), wheels = mul(p->base.A_w, y->base.wheel_speed);
    double twice_T = 0, twice_V = 0;
    for (int i = 0; i < at->count; i++) {
        const PlacedPart *b = &at->part[i];
        of_parts = add(of_parts, scale(b->M * b->rate, b->L));
        twice_T += b->M * b->rate * b->rate;
        twice_V += b->M * b->part->stiffness * b->q * b->q;
    }
    twice_T += dot(w, Iw) + 2 * dot(w, of_parts) - at->m * dot(v_c, v_c);
    vec3 of_C = scale(at->m, cross(at->c, v_c));
    y->h_N = tmul(*C_SN, sub(sum3(Iw, wheels, of_parts), of_C));
    y->kinetic_energy = twice_T / 2;
    y->elastic_energy = twice_V / 2;
}

static void publish_coordinates(const Parameters *p, const Vehicle *v, const Motion *x, Output *y)
{
    double used = v->mass_0 - x->base.mass;
    for (int i = 0; i < PANELS; i++) {
        y->panel_angle[i] = x->q[i];
        y->panel_rate[i] = x->dq[i];
    }
    for (int j = 0; j < SLOSHES; j++) {
        double mass = p->slosh.mass_0[j], travel = p->slosh.travel[j];
        double displacement = x->q[PANELS + j];
        y->slosh_displacement[j] = displacement;
        y->slosh_rate[j] = x->dq[PANELS + j];
        y->slosh_mass[j] = mass > 0 ? mass - p->slosh.draw[j] * used : 0;
        y->slosh_beyond_travel[j] = mass > 0 && travel > 0 && fabs(displacement) > travel;
    }
}

static void publish(const Parameters *p, const State *x, Output *y, double t)
{
    const Motion *now = &x->now;
    mat3 C_SN = dcm_of_mrp(now->base.sigma);
    Placement at;
    place_vehicle(&at, &x->vehicle, now);
    publish_base(&p->base, &now->base, &y->base, t);
    PosVel C = centre_of_mass(&at, &now->base, &C_SN, y->base.omega_SN_S);
    y->hub_mass = at.hub_mass;
    y->r_CS_S = at.c;
    y->r_CN_N = C.r;
    y->v_CN_N = C.v;
    y->dissipated_energy = now->dissipated[0] + now->dissipated[1];
    publish_coordinates(p, &x->vehicle, now, y);
    publish_momentum(p, &x->vehicle, &at, &C_SN, y);
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    Vehicle v = vehicle(p);
    (void)u;
    *x = (State){.now.base = base_at_start(&p->base), .vehicle = v, .substeps = substeps(p, &v)};
    for (int i = 0; i < v.count; i++) {
        int k = (int)v.part[i].k, j = k - PANELS, panel = k < PANELS;
        x->now.q[k] = panel ? p->panel.angle_0[k] : p->slosh.displacement_0[j];
        x->now.dq[k] = panel ? p->panel.rate_0[k] : p->slosh.rate_0[j];
    }
    publish(p, x, y, t);
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    double grid = p->base.max_step / x->substeps;
    for (Substep s = first_substep(t, h, grid); s.h > 0; s = next_substep(s)) {
        const Context constant = context(p, x, u, &s);
        integrate(&constant, s.t, s.h, &x->now);
        x->now.base.sigma = mrp_inside(x->now.base.sigma);
        if (rate_margin(&p->base, &x->now.base, s.t + s.h) < 0)
            break; /* the FMI adapter rejects the step for this negative rate_margin */
    }
    publish(p, x, y, t + h);
}

FMU_MODEL("flexible_servicer",
          "Servicer spacecraft with hinged solar panels and sloshing propellant: orbit with J2, "
          "attitude with momentum wheels, propellant consumption");
