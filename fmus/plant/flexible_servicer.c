/* flexible_servicer.c - servicer whose solar panels swing and whose propellant sloshes.
 *
 *   [ U    V ] [ A     ]   [ F_S - omega x (omega x s) - N_F - sum g p                          ]
 *   [ V^T  W ] [ alpha ] = [ M - omega x (I omega + A_w Omega) - A_w dOmega/dt - N_M - sum g l ]
 *   U = m 1 - sum p p^T/M,   V = -s~ - sum p l^T/M,   W = I - sum l l^T/M
 *   dv/dt = f + C_SN^T A,   domega/dt = alpha,   q_k'' = g_k - (p_k.A + l_k.alpha)/M_k
 *
 * Up to four panels, each hinged to the hub with spring and damper, and up to four masses that
 * slosh along a line; moving_parts.h has M, p, l, g of a coordinate. S is a point of the hub, where
 * the centre of mass C of the undeformed vehicle lies: a force through S turns a deformed vehicle.
 * f: gravity and disturbance at C, the same for all parts; gravity gradient acts on every part. The
 * hub is held before t_att, the coordinates move from the start on. Without panels and slosh it is
 * servicer. Classical Runge-Kutta on the grid k * max_step/n, n of (12) of docs/models.md L. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "moving_parts.h"
#include "rk4.h"
#include "servicer_base.h"

typedef struct {
    BaseParameters base;
    Panels panel;
    Sloshes slosh;
} Parameters;
typedef struct { BaseInput base; } Input;
typedef struct {
    BaseState base;
    double q[PARTS], dq[PARTS]; /* angles of the panels, displacements of the slosh masses */
    double dissipated_energy;
} Motion;
typedef struct {
    Motion now;
    double substeps; /* n, of the parameters alone */
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

/* a vector for each panel or mass */
#define TRIPLES(name, member, unit, text) \
    ROW_AS(PARAMETER_ROW, p, name, member, 3, unit, text, ANY_VALUE)

static const Variable variables[] = {
    BASE_PARAMETERS,
    NONNEGATIVE_AS("panel_mass", panel.mass, "kg", "mass of the panels; 0 = no such panel"),
    TRIPLES("panel_hinge_S", panel.hinge_S, "m", "hinges of the panels, from S, one row each"),
    TRIPLES("panel_arm_S", panel.arm_S, "m",
            "from the hinge to the centre of mass of the panel at angle 0, one row each"),
    TRIPLES("panel_axis_S", panel.axis_S, "1",
            "hinge axes, perpendicular to the arms, any length, one row each"),
    TRIPLES("panel_inertia", panel.inertia, "kg.m2",
            "moments of inertia of the panels about their centres of mass along arm, axis, and "
            "arm x axis, one row each"),
    PARAMETER_AS("panel_frequency", panel.frequency, "rad/s",
                 "frequency of the panels on a hub that is held still; 0 = free hinge"),
    PARAMETER_AS("panel_damping_ratio", panel.damping_ratio, "1",
                 "damping of the panels on a hub that is held still, share of critical"),
    PARAMETER_AS("panel_angle_0", panel.angle_0, "rad", "angles of the panels at the start"),
    PARAMETER_AS("panel_rate_0", panel.rate_0, "rad/s", "rates of these angles at the start"),
    NONNEGATIVE_AS("slosh_mass_0", slosh.mass_0, "kg",
                   "sloshing masses at the start; 0 = no such mass"),
    TRIPLES("slosh_position_S", slosh.position_S, "m",
            "places of the sloshing masses at rest, from S, one row each"),
    TRIPLES("slosh_axis_S", slosh.axis_S, "1",
            "directions in which they slosh, any length, one row each"),
    PARAMETER_AS("slosh_frequency", slosh.frequency, "rad/s",
                 "frequency of the sloshing masses in a hub that is held still"),
    PARAMETER_AS("slosh_damping_ratio", slosh.damping_ratio, "1",
                 "damping of the sloshing masses in a hub that is held still, share of critical"),
    PARAMETER_AS("slosh_displacement_0", slosh.displacement_0, "m",
                 "displacements of the sloshing masses at the start"),
    PARAMETER_AS("slosh_rate_0", slosh.rate_0, "m/s", "rates of these displacements at the start"),
    PARAMETER_AS("slosh_travel", slosh.travel, "m",
                 "largest displacement that the tank allows, for the alarm; 0 = no limit"),
    PARAMETER_AS("slosh_draw", slosh.draw, "1",
                 "share of the propellant consumption that a sloshing mass gives"),

    BASE_INPUTS,

    BASE_OUTPUTS,
    OUTPUT(panel_angle, "rad", "angles of the panels"),
    OUTPUT(panel_rate, "rad/s", "rates of these angles"),
    OUTPUT(slosh_displacement, "m", "displacements of the sloshing masses along their axes"),
    OUTPUT(slosh_rate, "m/s", "rates of these displacements"),
    NONNEGATIVE_OUTPUT(slosh_mass, "kg", "sloshing masses with the propellant left"),
    ROW_AS(OUTPUT_ROW, y, "hub_mass", hub_mass, 1, "kg",
           "mass of the hub with the propellant left, without panels and slosh", POSITIVE_VALUE),
    OUTPUT(r_CS_S, "m", "centre of mass of the vehicle as it is, from S, body axes"),
    OUTPUT(r_CN_N, "m", "position of the centre of mass, N axes"),
    OUTPUT(v_CN_N, "m/s", "velocity of the centre of mass, N axes"),
    OUTPUT(h_N, "N.m.s", "angular momentum about the centre of mass, wheels included, N axes"),
    OUTPUT(kinetic_energy, "J",
           "kinetic energy of the motion about the centre of mass, wheels counted as locked"),
    OUTPUT(elastic_energy, "J", "energy in the springs of panels and sloshing masses"),
    OUTPUT(dissipated_energy, "J", "energy that their dampers have taken since the start"),
    ALARM(slosh_beyond_travel, "1: the sloshing mass is beyond slosh_travel, outside its tank"),
};

/* ---- rules ---- */
static void refuse_entry(Problems *problems, const char *list, int i, double value,
                         const char *rule)
{
    char name[40];
    snprintf(name, sizeof name, "%s[%d]", list, i + 1);
    refuse(problems, name, value, rule);
}

static void check_ratio(Problems *problems, const char *list, int i, double value)
{
    if (value < 0 || value > 1) refuse_entry(problems, list, i, value, "must be in [0, 1]");
}
static void check_nonnegative(Problems *problems, const char *list, int i, double value)
{
    if (value < 0) refuse_entry(problems, list, i, value, "must be >= 0");
}
static void check_length(Problems *problems, const char *matrix, int i, vec3 row)
{
    if (norm(row) == 0) refuse_entry(problems, matrix, i, 0, "must not have zero length");
}

static void check_panel(const Panels *p, int i, Problems *problems)
{
    vec3 I = p->inertia[i];
    double least = smaller(I.x, smaller(I.y, I.z)), most = larger(I.x, larger(I.y, I.z));
    double across = dot(unit(p->axis_S[i]), unit(p->arm_S[i]));
    check_length(problems, "panel_arm_S", i, p->arm_S[i]);
    check_length(problems, "panel_axis_S", i, p->axis_S[i]);
    if (fabs(across) > 1e-9)
        refuse_entry(problems, "panel_axis_S", i, across,
                     "must be perpendicular to panel_arm_S (cosine of the angle between them)");
    if (least <= 0) refuse_entry(problems, "panel_inertia", i, least, "must be > 0");
    else if (!keeps_triangle_rule(diagonal(I.x, I.y, I.z)))
        refuse_entry(problems, "panel_inertia", i, most,
                     "must keep the triangle rule (no moment above the sum of the other two)");
    check_nonnegative(problems, "panel_frequency", i, p->frequency[i]);
    check_ratio(problems, "panel_damping_ratio", i, p->damping_ratio[i]);
}

static void check_slosh(const Sloshes *p, int j, Problems *problems)
{
    check_length(problems, "slosh_axis_S", j, p->axis_S[j]);
    check_nonnegative(problems, "slosh_frequency", j, p->frequency[j]);
    check_ratio(problems, "slosh_damping_ratio", j, p->damping_ratio[j]);
    check_nonnegative(problems, "slosh_travel", j, p->travel[j]);
    check_nonnegative(problems, "slosh_draw", j, p->draw[j]);
}

#define PARTS_OF_J_S \
    "J_S, panel_mass, panel_inertia, panel_hinge_S, panel_arm_S, slosh_mass_0, slosh_position_S"
#define TOO_MUCH_INERTIA                                                                  \
    " (the panels take more inertia than J_S has: enlarge J_S or shorten panel_hinge_S, " \
    "panel_arm_S)"

static Vehicle vehicle(const Parameters *p)
{
    return vehicle_of(p->base.mass_0, p->base.J_S, &p->panel, &p->slosh);
}

/* n: the smallest whole number with (max_step/n) omega_top <= 0.3; (12) */
static double substeps(const Parameters *p, const Vehicle *v)
{
    return larger(1, ceiling_of(p->base.max_step * highest_mode(v) / 0.3 * (1 - 1e-12)));
}

/* the hub about its own centre of mass, I_hc = I_h0 - (h.h 1 - h h^T)/m_h, needs mass and inertia,
 * without the wheels too */
static void check_hub_left(const Parameters *p, Problems *problems)
{
    Vehicle v = vehicle(p);
    if (v.mass <= 0) {
        refuse(problems, "m_h of mass_0, panel_mass, slosh_mass_0", v.mass,
               "must be > 0 (the panels and slosh masses are more than mass_0)");
        return;
    }
    mat3 I_hc = minus(v.inertia, point_inertia(1 / v.mass, v.first_moment));
    vec3 diagonal_I = vec(I_hc.row[0].x, I_hc.row[1].y, I_hc.row[2].z);
    double least = smaller(diagonal_I.x, smaller(diagonal_I.y, diagonal_I.z)),
           most = larger(diagonal_I.x, larger(diagonal_I.y, diagonal_I.z));
    if (!is_positive_definite(I_hc))
        refuse(problems, "I_hc of " PARTS_OF_J_S, least,
               "must be positive definite" TOO_MUCH_INERTIA);
    else if (!keeps_triangle_rule(I_hc))
        refuse(problems, "I_hc of " PARTS_OF_J_S, most,
               "must keep the triangle rule" TOO_MUCH_INERTIA);
    else if (!is_positive_definite(minus(I_hc, p->base.A_w)))
        refuse(problems, "I_hc - A_w of A_w, " PARTS_OF_J_S, least,
               "must be positive definite" TOO_MUCH_INERTIA);
    else if (substeps(p, &v) > 1000)
        refuse(problems, "sub-steps of max_step, panel_frequency, slosh_frequency", substeps(p, &v),
               "must be at most 1000 (shorten max_step)");
}

static void check(const Parameters *p, Problems *problems)
{
    double draw = 0;
    check_whole(problems, &p->base);
    for (int i = 0; i < PANELS; i++)
        if (p->panel.mass[i] > 0) check_panel(&p->panel, i, problems);
    for (int j = 0; j < SLOSHES; j++)
        if (p->slosh.mass_0[j] > 0) {
            check_slosh(&p->slosh, j, problems);
            draw += p->slosh.draw[j];
        }
    if (draw > 1)
        refuse(problems, "sum of slosh_draw", draw, "must be at most 1 over the existing masses");
    if (problems->count == 0) check_hub_left(p, problems); /* it is made of good numbers only */
}

/* ---- motion ---- */
typedef struct {
    const Parameters *p;
    const Vehicle *v;
    Interval held;
} Context;

static vec3 hub_rate(int released, const BaseState *x)
{
    return released ? x->omega : vec(0, 0, 0);
}

static Placement placement(const Vehicle *v, const Motion *x)
{
    return place_parts(v, v->mass_0 - x->base.mass, x->q, x->dq);
}

/* (8): the centre of mass in N */
static PosVel centre_of_mass(const Placement *at, const BaseState *x, vec3 omega)
{
    mat3 C_SN = dcm_of_mrp(x->sigma);
    return (PosVel){add(x->r, tmul(C_SN, at->c)),
                    add(x->v, tmul(C_SN, add(cross(omega, at->c), at->dc)))};
}

static Tide tide_at(const BaseParameters *p, const BaseState *x, vec3 r_CN_N)
{
    if (!p->use_gravity_gradient || p->orbit.mu == 0) return (Tide){0, {0, 0, 0}};
    double r = norm(r_CN_N);
    return (Tide){p->orbit.mu / (r * r * r), scale(1 / r, mul(dcm_of_mrp(x->sigma), r_CN_N))};
}

/* M_gg = 3 g n x (I_C n),   I_C = I - m (c.c 1 - c c^T) */
static vec3 tidal_torque(const Tide *f, const Placement *at)
{
    mat3 I_C = minus(at->I, point_inertia(at->m, at->c));
    return scale(3 * f->g, cross(f->n, mul(I_C, f->n)));
}

/* sum of 2 z w M q'^2 */
static double damper_power(const Vehicle *v, const Placement *at)
{
    double sum = 0;
    for (int i = 0; i < at->count; i++) {
        const Placed *b = &at->part[i];
        sum += v->part[at->coordinate[i]].damping * b->M * b->rate * b->rate;
    }
    return sum;
}

/* (7) and, from it, (6) */
static void flexible_rates(const Context *c, double t, const Motion *x, Motion *dx)
{
    const BaseParameters *p = &c->p->base;
    const Interval *held = &c->held;
    vec3 w = hub_rate(held->released, &x->base);
    Placement at = placement(c->v, x);
    PosVel C = centre_of_mass(&at, &x->base, w);
    Tide field = tide_at(p, &x->base, C.r);
    Drift own = drift(c->v, &at, x->q, w, &field);

    vec3 momentum = add(mul(at.I, w), mul(p->A_w, x->base.wheel_speed));
    vec3 F = sub(sub(force_S(held->u), cross(w, cross(w, at.s))), own.F);
    vec3 M = add(add(torque_S(held->u), sinusoid(&p->M_dist_S, held->since, t)),
                 tidal_torque(&field, &at));
    M = sub(sub(sub(M, cross(w, momentum)), mul(p->A_w, held->wheel_accel)), own.M);

    Inertia felt = felt_inertia(&at);
    Acceleration a = acceleration(&felt, F, M, !held->released);
    vec3 f = add(free_fall_N(p, &C.r, &C.v, held->since, t),
                 velocity_turning_N(p, held->released, &x->base, C.v));
    *dx = (Motion){.base = {.r = x->base.v,
                            .v = add(f, tmul(dcm_of_mrp(x->base.sigma), a.A)),
                            .sigma = mrp_rate(x->base.sigma, w),
                            .omega = a.alpha,
                            .mass = -held->u->mdot},
                   .dissipated_energy = damper_power(c->v, &at)};
    if (held->released) dx->base.wheel_speed = held->wheel_accel;
    for (int i = 0; i < at.count; i++) {
        int k = at.coordinate[i];
        dx->q[k] = x->dq[k];
        dx->dq[k] = own.g[k] - dot(at.part[i].p_M, a.A) - dot(at.part[i].l_M, a.alpha);
    }
}

static void derivative(const Context *c, double t, const Motion *x, Motion *dx)
{
    if (has_parts(c->v)) flexible_rates(c, t, x, dx);
    else *dx = (Motion){.base = rigid_rates(&c->held, t, &x->base)};
}

RK4(integrate, derivative, Context, Motion)

/* ---- outputs ---- */
/* (11), velocities relative to S */
static void publish_momentum(const Parameters *p, const Vehicle *v, const Placement *at,
                             const Motion *x, Output *y)
{
    vec3 w = y->base.omega_SN_S, v_c = add(cross(w, at->c), at->dc), h = mul(v->inertia, w);
    double twice_T = dot(w, h) - at->m * dot(v_c, v_c), twice_V = 0;
    h = sub(add(h, mul(p->base.A_w, y->base.wheel_speed)), scale(at->m, cross(at->c, v_c)));
    for (int i = 0; i < at->count; i++) {
        const Placed *b = &at->part[i];
        int k = at->coordinate[i];
        vec3 v_r = add(cross(w, b->r), b->dr), w_i = add(w, b->spin), h_i = mul(b->inertia, w_i);
        h = sum3(h, h_i, scale(b->mass, cross(b->r, v_r)));
        twice_T += dot(w_i, h_i) + b->mass * dot(v_r, v_r);
        twice_V += b->M * v->part[k].stiffness * x->q[k] * x->q[k];
    }
    y->h_N = tmul(dcm_of_mrp(x->base.sigma), h);
    y->kinetic_energy = twice_T / 2;
    y->elastic_energy = twice_V / 2;
    y->dissipated_energy = x->dissipated_energy;
}

static void publish_coordinates(const Parameters *p, const Vehicle *v, const Motion *x, Output *y)
{
    double used = v->mass_0 - x->base.mass;
    for (int i = 0; i < PANELS; i++) {
        y->panel_angle[i] = x->q[i];
        y->panel_rate[i] = x->dq[i];
    }
    for (int j = 0; j < SLOSHES; j++) {
        const Part *b = &v->part[PANELS + j];
        double displacement = x->q[PANELS + j], travel = p->slosh.travel[j];
        y->slosh_displacement[j] = displacement;
        y->slosh_rate[j] = x->dq[PANELS + j];
        y->slosh_mass[j] = b->mass - b->draw * used;
        y->slosh_beyond_travel[j] = b->mass > 0 && travel > 0 && fabs(displacement) > travel;
    }
}

static void publish(const Parameters *p, const Vehicle *v, const Motion *x, Output *y, double t)
{
    Placement at = placement(v, x);
    publish_base(&p->base, &x->base, &y->base, t);
    PosVel C = centre_of_mass(&at, &x->base, y->base.omega_SN_S);
    y->hub_mass = at.hub_mass;
    y->r_CS_S = at.c;
    y->r_CN_N = C.r;
    y->v_CN_N = C.v;
    publish_coordinates(p, v, x, y);
    publish_momentum(p, v, &at, x, y);
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    Vehicle v = vehicle(p);
    (void)u;
    *x = (State){.now.base = base_at_start(&p->base), .substeps = substeps(p, &v)};
    for (int k = 0; k < PARTS; k++) {
        int j = k - PANELS, panel = k < PANELS;
        if (!(v.part[k].mass > 0)) continue;
        x->now.q[k] = panel ? p->panel.angle_0[k] : p->slosh.displacement_0[j];
        x->now.dq[k] = panel ? p->panel.rate_0[k] : p->slosh.rate_0[j];
    }
    publish(p, &v, &x->now, y, t);
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    Vehicle v = vehicle(p);
    double grid = p->base.max_step / x->substeps;
    for (Substep s = first_substep(t, h, grid); s.h > 0; s = next_substep(s)) {
        const Context context = {p, &v, interval(&p->base, &u->base, &x->now.base, &s)};
        integrate(&context, s.t, s.h, &x->now);
        x->now.base.sigma = mrp_inside(x->now.base.sigma);
    }
    publish(p, &v, &x->now, y, t + h);
}

FMU_MODEL("flexible_servicer",
          "Servicer spacecraft with hinged solar panels and sloshing propellant: orbit with J2, "
          "attitude with momentum wheels, propellant consumption");
