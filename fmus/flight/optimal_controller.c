/* optimal_controller.c - fuel-optimal translation with constraints by a fixed number of
 * iterations, and attitude by the law of adaptive_controller with constant estimates.
 *
 * Once a second (ten samples) a path to the goal, of 60 nodes (equal intervals of time), is
 * improved by `iterations` steps of ADMM (alternating direction method of multipliers,
 * optimal_problem.h), spread over nine samples, and becomes the plan in force if it is feasible.
 * The model of prediction is a double integrator in N axes with a known acceleration:
 *
 *   (1) rho'' = u + d,   d = d_hat + tide(way)      u = F/m, constant in a node; way: last path
 *   (3) d_hat += k_d (res - d_hat),   res = dv/dt - F/m - tide over the second before
 *
 * d_hat: estimated acceleration that is not modelled; tide: gravity at the servicer minus gravity
 * at the target, to first order. Goals: 1 a point on the line of holds, 2 the grasp axis at
 * constant range, 3 along the grasp axis; 0 inactive. Inputs L_goal and T_goal that are not 0
 * replace the parameters L_end and duration. The time of arrival is fixed. A plan ends at the
 * arrival, but not before T_min after its start.
 * Modes: 0 plan, 1 last feasible plan, 2 brake and hold, 3 no plan yet: the first one is being
 * computed, and the force is 0.
 * Equations, constants and figures: docs/models.md N. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "directions.h"
#include "earth.h"
#include "optimal_setup.h"
#include "rigid_body.h"

enum { SHOWN = 6 }; /* number of nodes of the plan whose positions are outputs */

typedef OptimalParameters Parameters;
typedef OptimalInput Input;
typedef OptimalState State;
typedef struct {
    vec3 F_cmd_S, M_cmd_S, wheel_accel_cmd;
    double mode, feasible, braking, dv_left, t_arrival;
    double residual_p, residual_u, change_p, change_u, miss;
    double count_box, count_cone, count_slab, plan_time, plan_step;
    vec3 plan_rho_N[SHOWN], d_hat_N;
} Output;
MODEL_STRUCT;

static const Model start = {
    .p = {.mu = MU_JGM3,
          .p_T = {1, 0, 0},
          .J_T = {{{100, 0, 0}, {0, 150, 0}, {0, 0, 90}}},
          .F_max = {1.9, 0.95, 0.95},
          .duration = {475, 203, 600},
          .L_end = {20, 19.5, 4.02},
          .line = {0, -1, 0},
          .keep_out = {12, 12.3},
          .cone = 0.14660765716752369,
          .cone_hold = 0.005235987755982988,
          .hold_lead = 5,
          .slab = {0.015, 0.015},
          .T_min = 120,
          .v_0 = 0.06,
          .v_slope = 0.0185,
          .iterations = 50,
          .iterations_first = 50,
          .kappa = 0.005,
          .k_d = 0.02,
          .tol = {0.05, 0.04},
          .bad_max = 5,
          .age_max = 20,
          .K_b = 0.01,
          .P_b = 0.2,
          .tumble_step = 5,
          .turn = {0, 1, 1},
          .omega_rest = 1e-6,
          .relax_time = 30,
          .arrive_radius = 0.3,
          .use_attitude = 1,
          .use_wheels = 1,
          .K_att = {2, 2, 2},
          .P_att = {10, 10, 10},
          .eta_hat_0 = {{{180, 0, 0, 240, 0, 160}}, {{14, 0, 0, 16, 0, 12}}},
          .sample_period = 0.1},
    .u = {.T = {.r = {7158140, 0, 0}, .v = {0, 7462.286, 0}, .q = {1, 0, 0, 0}},
          .S = {.r = {7158140, 20, 0}, .v = {-0.0208, 7462.286, 0}, .q = {1, 0, 0, 0}},
          .ref = {.rho = {0, 20, 0}, .q = {1, 0, 0, 0}},
          .mass = 95,
          .goal = ALONG_AXIS},
};

static const Variable variables[] = {
    NONNEGATIVE(mu, "m3/s2", "gravitational parameter of the planet; 0 = deep space"),
    PARAMETER(p_T, "1", "grasp axis, target axes, unit vector"),
    MATRIX(J_T, "kg.m2", "inertia of the target as known to the software, target axes"),
    NONNEGATIVE(F_max, "N", "largest force per servicer axis"),
    POSITIVE(duration, "s",
             "time from the start of a goal to the arrival at its end point, per goal"),
    POSITIVE(L_end, "m", "range at the end of a goal, per goal"),
    PARAMETER(line, "1", "line of holds, Hill axes of the target, unit vector (goal 1)"),
    POSITIVE(keep_out, "m", "least range on the way (goals 1 and 2)"),
    POSITIVE(
        cone, "rad",
        "half angle of the cone about the grasp axis before arrival, apex at the target's centre "
        "of mass (goal 3)"),
    POSITIVE(cone_hold, "rad",
             "half angle of the cone about the grasp axis after arrival (goal 3)"),
    NONNEGATIVE(hold_lead, "s", "time before arrival from which cone_hold replaces cone"),
    NONNEGATIVE(slab, "m",
                "goal 3: range on the axis >= L_end - slab[1], after arrival <= L_end + slab[2]"),
    POSITIVE(T_min, "s", "shortest horizon of the plan"),
    SWITCH(speed_limit, "1: the speed as seen in the Hill frame is limited"),
    NONNEGATIVE(v_0, "m/s", "limit of the speed at range 0"),
    NONNEGATIVE(v_slope, "1/s", "rise of the limit of the speed with the range"),
    POSITIVE(iterations, "1", "ADMM iterations per plan (ten samples), a whole number, 9 to 60"),
    POSITIVE(iterations_first, "1",
             "iterations for the first plan to a new goal: 1, 2, .. 20 times parameter iterations"),
    POSITIVE(
        kappa, "1",
        "ADMM: force taken off per iteration and axis, as a share of the largest F_max; does not "
        "change the optimum"),
    NONNEGATIVE(k_d, "1",
                "gain of d_hat_N: share of its measured error that is corrected every ten samples"),
    POSITIVE(tol, "1",
             "a plan is feasible if residual_p and miss <= tol[1] (m) + tol[2] times the range"),
    POSITIVE(bad_max, "1",
             "infeasible plans in a row after which a solve starts from zero force, and after "
             "which the servicer brakes if it never had a plan"),
    NONNEGATIVE(age_max, "s", "time since its start up to which the last feasible plan is used"),
    NONNEGATIVE(K_b, "1/s2", "position gain of braking"),
    NONNEGATIVE(P_b, "1/s", "velocity gain of braking"),
    POSITIVE(tumble_step, "s", "longest step of the prediction of the tumble, at least 5 s"),
    ROW_AS(PARAMETER_ROW, p, "turn", turn, 1, "1",
           "1: the servicer is predicted to turn with the target, per goal", SWITCH_VALUE),
    NONNEGATIVE(omega_rest, "rad/s",
                "servicer rate below which the attitude is predicted as constant"),
    POSITIVE(relax_time, "s",
             "time in which a plan returns into constraints that the state violates"),
    POSITIVE(arrive_radius, "m",
             "largest distance from the end point after arrival (goals 1 and 2)"),
    SWITCH(use_attitude, "1: the attitude law is used; 0: no torque is commanded"),
    SWITCH(use_wheels, "1: torque by wheels (wheel_accel_cmd), 0: by thrusters (M_cmd_S)"),
    PARAMETER(t_att, "s", "attitude control starts at this time"),
    NONNEGATIVE(
        K_att, "N.m",
        "attitude gain, per body axis; torque is -K_att/16 times the error angle if this is small"),
    NONNEGATIVE(P_att, "N.m.s", "rate gain, per body axis"),
    PARAMETER(eta_hat_0, "kg.m2",
              "inertia J of the servicer, wheels locked, and A of the wheels (momentum A "
              "wheel_speed): J11 J12 J13 J22 J23 J33 A11 A12 A13 A22 A23 A33"),
    GRID_AS("sample_period", sample_period,
            "sample period of the software, a tenth of the time between plans"),

    BODY_INPUTS("T", T, "target"),
    BODY_INPUTS("S", S, "servicer"),
    OPTIONAL_INPUT(wheel_speed, "rad/s",
                   "wheel speeds relative to the body; used if use_attitude = 1"),
    OPTIONAL_INPUT_AS("q_DN", ref.q, "1", "reference attitude relative to N, scalar first"),
    OPTIONAL_INPUT_AS("omega_DN_D", ref.omega, "rad/s",
                      "reference angular velocity relative to N, reference body axes"),
    OPTIONAL_INPUT_AS("alpha_DN_D", ref.alpha, "rad/s2",
                      "reference angular acceleration, derivative of omega_DN_D"),
    ROW(INPUT_ROW, u, "mass", mass, 1, "kg", "mass of the servicer as known to the software",
        NONNEGATIVE_VALUE, OPTIONAL_ROW),
    OPTIONAL_MODE(goal, "goal of the path",
                  "inactive|point on the line of holds|grasp axis at constant range|along the "
                  "grasp axis"),
    OPTIONAL_INPUT(L_goal, "m",
                   "range at the end of the goal; a new value restarts the goal; 0: L_end applies"),
    OPTIONAL_INPUT(
        T_goal, "s",
        "time from start to arrival of the present goal, at most 1200; 0: duration applies"),

    OUTPUT(F_cmd_S, "N", "commanded force, servicer axes"),
    OUTPUT(M_cmd_S, "N.m", "commanded torque, servicer axes (0 with use_wheels)"),
    OUTPUT(wheel_accel_cmd, "rad/s2",
           "commanded wheel acceleration relative to the body (0 without use_wheels)"),
    MODE(mode,
         "origin of the force (3 also if goal = 0; -1: invalid goal or mass of 0, the step fails)",
         "plan|last plan|brake and hold|first plan being computed"),
    FLAG(feasible, "1: the last solve gave a feasible plan"),
    ALARM(braking, "1: no plan, the servicer brakes and holds"),
    NONNEGATIVE_OUTPUT(dv_left, "m/s",
                       "velocity increment of the last solve, sum over axes and nodes"),
    OUTPUT(t_arrival, "s",
           "time at which the path of the last solve arrives; 0: not within the horizon"),
    NONNEGATIVE_OUTPUT(
        residual_p, "m",
        "bound of the violation of position constraints by the path (ADMM residual)"),
    NONNEGATIVE_OUTPUT(
        residual_u, "m/s2",
        "bound of the violation of force limits by the accelerations (ADMM residual)"),
    NONNEGATIVE_OUTPUT(change_p, "m", "largest change of a position by the last iteration"),
    NONNEGATIVE_OUTPUT(change_u, "m/s2", "largest change of an acceleration by the last iteration"),
    NONNEGATIVE_OUTPUT(miss, "m", "distance of the end of the path from the point of the goal"),
    NONNEGATIVE_OUTPUT(count_box, "1", "nodes in which a force is at its limit"),
    NONNEGATIVE_OUTPUT(count_cone, "1", "nodes whose end is on the cone"),
    NONNEGATIVE_OUTPUT(count_slab, "1",
                       "nodes whose end is at the limit slab, keep_out or arrive_radius"),
    OUTPUT(plan_time, "s", "start of the plan in force"),
    NONNEGATIVE_OUTPUT(plan_step, "s", "duration of a node (interval) of the plan in force"),
    ROW_AS(
        OUTPUT_ROW, y, "plan_rho_N", plan_rho_N, 3, "m",
        "relative position at ends of nodes 10, 20, .. 60 of the plan in force, N axes, a row each",
        ANY_VALUE),
    OUTPUT(d_hat_N, "m/s2", "estimated acceleration that is not modelled, N axes"),
};

/* ---- rules of the parameters ---- */
static int is_whole(double value, double low, double high)
{
    return value == nearest_whole(value) && value >= low && value <= high;
}

static void check_goals(const Parameters *p, Problems *problems)
{
    for (int i = 0; i < GOALS - 1; i++)
        if (p->duration[i] > LONGEST_DURATION)
            reject(problems, "duration", p->duration[i], "must be <= 1200");
    for (int i = 0; i < 2; i++)
        if (p->L_end[i] < p->keep_out[i])
            reject(problems, "L_end", p->L_end[i], "must not be below keep_out");
    if (p->T_min < 20) reject(problems, "T_min", p->T_min, "must be >= 20");
    if (p->tumble_step < 5)
        reject(problems, "tumble_step", p->tumble_step,
               "must be >= 5 s, so that a node of 20 s has at most four steps");
    if (p->cone <= p->cone_hold) reject(problems, "cone", p->cone, "must be above cone_hold");
    if (p->cone >= 1.5) reject(problems, "cone", p->cone, "must be below 1.5 rad");
}

/* N.4-8 */
static void check(const Parameters *p, Problems *problems)
{
    check_unit_vector(problems, "p_T", p->p_T);
    check_unit_vector(problems, "line", p->line);
    check_inertia(problems, "J_T", p->J_T);
    check_goals(p, problems);
    double least = smaller(p->F_max.x, smaller(p->F_max.y, p->F_max.z));
    if (least == 0) reject(problems, "F_max", least, "must be > 0 on every axis");
    if (!is_whole(p->iterations, 9, 60))
        reject(problems, "iterations", p->iterations, "must be a whole number in 9..60");
    if (!is_whole(p->iterations_first / p->iterations, 1, MOST_SECONDS))
        reject(problems, "iterations_first", p->iterations_first,
               "must be a whole multiple (1 to 20) of iterations");
    if (!is_whole(p->bad_max, 1, 1e6))
        reject(problems, "bad_max", p->bad_max, "must be a whole number in 1..1e6");
    double A_det = determinant(full_matrix(p->eta_hat_0.A));
    if (p->use_wheels && A_det <= 0)
        reject(problems, "eta_hat_0", A_det,
               "the wheel inertia must have a positive determinant (use_wheels = 1)");
}

/* ---- evaluation of a solve, N.4 ---- */
static double horizon_of(const State *x) { return x->grid.dt * NODES; }

static void publish_progress(const State *x, Output *y)
{
    const Progress *f = &x->progress;
    double T2 = horizon_of(x) * horizon_of(x);
    y->residual_p = sqrt(f->residual_p) * T2;
    y->residual_u = sqrt(f->residual_u);
    y->change_p = sqrt(f->change_p) * T2;
    y->change_u = sqrt(f->change_u);
    y->miss = norm(sub(x->it.p[NODES - 1], x->problem.p_end)) * T2;
    y->count_box = f->count_box;
    y->count_cone = f->count_cone;
    y->count_slab = f->count_slab;
}

static double sum_of_sizes(vec3 a) { return fabs(a.x) + fabs(a.y) + fabs(a.z); }

static void publish_path(const Parameters *p, const State *x, Output *y)
{
    double T2 = horizon_of(x) * horizon_of(x), sum = 0;
    y->t_arrival = 0;
    for (int k = NODES - 1; k >= 0; k--) {
        const Node *node = &x->problem.node[k];
        double left = norm(sub(x->it.p[k], node->place)) * T2;
        if (left <= 0.1 + p->arrive_radius) y->t_arrival = x->grid.t + (k + 1) * x->grid.dt;
        sum += sum_of_sizes(mul(node->C, x->it.u[k].z));
    }
    y->dv_left = sum * x->grid.dt;
}

static void accept_plan(State *x, Output *y)
{
    double T2 = horizon_of(x) * horizon_of(x);
    x->plan.grid = x->grid;
    for (int k = 0; k < NODES; k++) x->plan.u[k] = x->it.u[k].z;
    for (int i = 0; i < SHOWN; i++)
        y->plan_rho_N[i] = scale(T2, x->it.p[NODES / SHOWN * (i + 1) - 1]);
    y->plan_time = x->grid.t;
    y->plan_step = x->grid.dt;
    x->has_plan = 1;
    x->mode = PLAN;
    x->bad = 0;
}

/* N.4-3 */
static void begin_braking(const Parameters *p, const Input *u, State *x, double t)
{
    Carried now = carried_now(u, t);
    OrbitNow o = orbit_of(p, u);
    x->hold.in_target = x->goal == ALONG_AXIS;
    x->hold.rho = mul(hold_axes(&x->hold, &o, &now), now.rho);
}

/* N.4-1 */
static void reject_plan(const Parameters *p, const Input *u, State *x, double t)
{
    double mode;
    x->bad += 1;
    if (x->has_plan) mode = t - x->plan.grid.t <= p->age_max ? LAST_PLAN : BRAKE;
    else mode = x->bad < p->bad_max ? FIRST_PLAN : BRAKE;
    if (mode == BRAKE && x->mode != BRAKE) begin_braking(p, u, x, t);
    x->mode = mode;
    double times_cold = x->bad / p->bad_max;
    if (times_cold == floor_of(times_cold)) x->has_iterates = 0;
}

/* (22) */
static void evaluate_solve(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    double most = p->tol[0] + p->tol[1] * x->range;
    publish_progress(x, y);
    publish_path(p, x, y);
    y->feasible = isfinite(y->dv_left) && y->residual_p <= most && y->miss <= most;
    if (y->feasible) accept_plan(x, y);
    else reject_plan(p, u, x, t);
}

/* ---- a second, N.4 ---- */

/* (3) */
static void learn_disturbance(const Parameters *p, const Input *u, Disturbance *d, double t)
{
    Carried now = carried_now(u, t);
    OrbitNow o = orbit_of(p, u);
    if (d->known) {
        vec3 mean = scale(1.0 / SAMPLES / u->mass, d->F_sum);
        vec3 middle = scale(0.5, add(now.rho, d->rho));
        vec3 res = sub(sub(scale(1 / second_of(p), sub(now.v, d->v)), mean), tide(&o, 0, middle));
        d->d_hat = add(d->d_hat, scale(p->k_d, sub(res, d->d_hat)));
    }
    d->rho = now.rho;
    d->v = now.v;
    d->F_sum = vec(0, 0, 0);
    d->known = 1;
}

static void begin_second(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    int first = x->seconds == 0;
    learn_disturbance(p, u, &x->d, t);
    y->d_hat_N = x->d.d_hat;
    if (x->seconds > 1) { /* the first plan to a goal is still being computed */
        x->seconds -= 1;
        return;
    }
    if (!first) evaluate_solve(p, u, x, y, t);
    int seconds = first ? (int)(p->iterations_first / p->iterations) : 1;
    set_up(p, u, x, t, seconds, first);
}

/* does the iterations of this sample, at most seven, by equation (20) of docs/models.md N */
/* N.4-6 */
static void improve(const Parameters *p, State *x)
{
    vec3 q[NODES];
    int n = (int)p->iterations, c = (int)x->sample;
    int count = n * c / (SAMPLES - 1) - n * (c - 1) / (SAMPLES - 1);
    for (int i = 0; i < 7; i++)
        if (i < count) {
            Progress *last = c == SAMPLES - 1 && i == count - 1 ? &x->progress : NULL;
            iterate(&x->problem, &x->gains, NODES, &x->it, q, last);
        }
}

/* N.4-2 */
static void change_goal(const Input *u, State *x, double goal, double t)
{
    x->goal = goal;
    x->L_goal = u->L_goal;
    x->t_goal = t;
    x->sample = x->seconds = x->has_iterates = x->bad = x->d.known = 0;
}

/* N.4-5 */
static void command_force(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    OrbitNow o = orbit_of(p, u);
    Carried now = carried_now(u, t);
    mat3 C_SN = dcm_of_quat(canonical(u->S.q));
    vec3 F = mul(C_SN, scale(u->mass, acceleration(p, x, &o, &now)));
    y->F_cmd_S = limited3(F, p->F_max);
    x->d.F_sum = add(x->d.F_sum, tmul(C_SN, y->F_cmd_S));
}

/* attitude law (19) of docs/models.md A.5.2, with constant estimates */
static void command_attitude(const Parameters *p, const Input *u, Output *y, double t)
{
    vec3 none = vec(0, 0, 0);
    y->wheel_accel_cmd = y->M_cmd_S = none;
    if (!p->use_attitude || !reached(t, p->t_att)) return;
    AttitudeError e = attitude_error(u->S.q, u->S.omega, &u->ref);
    mat3 J_hat = full_matrix(p->eta_hat_0.J), A_hat = full_matrix(p->eta_hat_0.A);
    vec3 torque = wheel_torque(p->K_att, p->P_att, J_hat, A_hat, &e, u->wheel_speed);
    if (p->use_wheels) y->wheel_accel_cmd = solve(A_hat, torque);
    else y->M_cmd_S = neg(torque);
}

/* resets the state to its values before the first sample, except the gains, its first member, and
 * sets all outputs to 0, with the mode FIRST_PLAN */
/* N.4-4 */
static void stay_inactive(State *x, Output *y)
{
    Output none = {.mode = FIRST_PLAN};
    memset((char *)x + sizeof x->gains, 0, sizeof *x - sizeof x->gains);
    x->mode = FIRST_PLAN;
    *y = none;
}

/* number of the goal nearest to the input value; -1 if there is no such goal or if the mass is
 * 0: the rule of the output `mode` rejects -1 */
/* N.4-7 */
static int goal_of(const Input *u)
{
    for (int goal = INACTIVE; goal < GOALS; goal++)
        if (nearest_whole(u->goal) == goal && u->mass > 0) return goal;
    return -1;
}

static void sample(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    int goal = goal_of(u);
    if (goal < TO_POINT) {
        stay_inactive(x, y);
        if (goal < INACTIVE) y->mode = goal;
        return;
    }
    if (goal != x->goal || u->L_goal != x->L_goal) change_goal(u, x, goal, t);
    if (x->sample == 0) begin_second(p, u, x, y, t);
    else improve(p, x);
    command_force(p, u, x, y, t);
    command_attitude(p, u, y, t);
    x->sample = x->sample < SAMPLES - 1 ? x->sample + 1 : 0;
    y->mode = x->mode;
    y->braking = x->mode == BRAKE;
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    set_gains(&x->gains, NODES, p->speed_limit != 0);
    stay_inactive(x, y);
    if (goal_of(u) > INACTIVE) command_attitude(p, u, y, t);
    if (goal_of(u) < INACTIVE) y->mode = goal_of(u);
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    for (Sample s = first_sample(t, h, p->sample_period); s.left > 0; s = next_sample(s))
        sample(p, u, x, y, s.t);
}

FMU_MODEL("optimal_controller",
          "Fuel-optimal translation with constraints by a fixed number of iterations");
