/* arm_servicer.c - servicer with an arm of up to seven joints: orbit, attitude, wheels, propellant,
 * joints with friction, torque limits and locks, loads on base and end effector.
 *
 *   u = [v; w; dq],   H du/dt + b = Q,   du/dt = [A; dw; ddq],   dv_S/dt = f + C_SN^T A
 *   Q = [F_S + F_contact_S;
 *        M_S + M_contact_S + M_dist_S - w x A_w Omega - A_w dOmega;
 *        joint_torque - joint_damping dq - joint_friction dq/sqrt(dq^2 + friction_rate^2)]
 *       + J_E^T [R_E F_contact_E; R_E M_contact_E] + Q_gg
 *   Q_gg = sum_k Jw_k^T 3 g a x (I_k a) + Jv_k^T g m_k (3 a (a.x_k) - x_k),   g = mu/|r_C|^3
 *
 * S is the base body, r_SN_N its centre of mass: sensors, thrusters and wheels are bolted to it. C
 * is the centre of mass of the whole, c = r_CS_S, x_k = c_k - c, a = C_SN r_C/|r_C|. f: gravity
 * with J2, a_dist and the unphysical option of `servicer`, at C. The field acts on all bodies alike
 * and excites no joint; its gradient does. A locked joint leaves the system; one that moves when
 * its lock closes stops at once and hands its momentum over to base and free joints. Before t_att
 * the base does not turn, the joints move. joints = 0 is `servicer`.
 * Equations: docs/models.md K.1, K.2. Classical Runge-Kutta on the grid k * max_step. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "arm_rows.h"
#include "body_rows.h"
#include "rk4.h"
#include "servicer_base.h"

typedef struct {
    BaseParameters base;
    Arm arm;
    Joints joint;
    double joint_angle_0[ARM_JOINTS], joint_rate_0[ARM_JOINTS];
} Parameters;
typedef struct {
    BaseInput base;
    double joint_torque[ARM_JOINTS], joint_lock[ARM_JOINTS];
    vec3 F_contact_E, M_contact_E;
} Input;
typedef struct {
    BaseState base; /* its mass: of the base body */
    double joint_angle[ARM_JOINTS], joint_rate[ARM_JOINTS];
} State;
typedef struct {
    BaseOutput base;
    double joint_angle[ARM_JOINTS], joint_rate[ARM_JOINTS], joint_accel[ARM_JOINTS],
        lock_torque[ARM_JOINTS];
    Body E;
    vec3 r_CS_S, v_CN_N, h_N;
    double kinetic_energy;
} Output;
MODEL_STRUCT;

static const Model start = {
    .p = {.base = BASE_START,
          .arm = ARM_START,
          .joint = {.friction_rate = 0.005},
          .joint_angle_0 = ARM_STOWED},
    .u = {.joint_lock = {1, 1, 1, 1, 1, 1, 1}},
};

static const Variable variables[] = {
    BASE_PARAMETERS,
    ARM_PARAMETERS,
    JOINTS_PARAMETERS,
    PARAMETER(joint_angle_0, "rad", "joint angles at the start"),
    PARAMETER(joint_rate_0, "rad/s", "joint rates at the start"),

    BASE_INPUTS,
    OPTIONAL_INPUT(joint_torque, "N.m",
                   "torque at the joints, on the outboard body about the axis; without effect on a "
                   "locked joint"),
    OPTIONAL_SWITCH(joint_lock, "1: the joint is locked"),
    OPTIONAL_INPUT(F_contact_E, "N", "force at the origin of the end effector, its axes"),
    OPTIONAL_INPUT(M_contact_E, "N.m", "torque on the end effector about its origin, its axes"),

    BASE_OUTPUTS,
    OUTPUT(joint_angle, "rad", "joint angles"),
    OUTPUT(joint_rate, "rad/s", "joint rates"),
    OUTPUT(joint_accel, "rad/s2", "joint accelerations"),
    OUTPUT(lock_torque, "N.m",
           "torque with which the lock holds the joint, on the outboard body; 0 when free"),
    BODY_OUTPUTS("E", E, "end effector"),
    OUTPUT(r_CS_S, "m", "centre of mass of the whole vehicle from S, body axes"),
    OUTPUT(v_CN_N, "m/s", "velocity of the centre of mass, N axes"),
    OUTPUT(h_N, "N.m.s", "angular momentum about the centre of mass with the wheels, N axes"),
    OUTPUT(kinetic_energy, "J",
           "kinetic energy of the motion about the centre of mass, wheels locked, rotors of the "
           "joints included"),
};

static void check(const Parameters *p, Problems *problems)
{
    check_base(problems, &p->base);
    check_joints(problems, &p->joint, check_arm(problems, &p->arm));
}

/* ---- the vehicle at an instant ---- */
typedef struct {
    Tree tree;
    Composite outboard; /* the arm */
    Matrix H;
    Column u; /* speeds, S at rest */
    mat3 C_SN;
    double mass;
    vec3 c, v_c; /* centre of mass and its velocity, from S, base axes */
} Vehicle;

static vec3 base_rate(const State *x, int released)
{
    return released ? x->base.omega : vec(0, 0, 0);
}

/* what the joint angles alone decide */
static void place_arm(Vehicle *now, const Parameters *p, const State *x)
{
    memset(&now->H, 0, sizeof now->H);
    now->tree = tree_in(&p->arm, x->base.mass, p->base.J_S, x->joint_angle);
    now->outboard = set_joint_rows(&now->H, &p->arm, &now->tree);
}

typedef struct {
    const Parameters *p;
    const Input *u;
    const Vehicle *locked; /* with its arm in place, where all joints are locked; else 0 */
    vec3 wheel_accel;
    double since; /* start of the internal step */
    int released;
} Context;

static void find_vehicle(Vehicle *now, const Context *c, const State *x)
{
    double v[3];
    if (c->locked) {
        now->tree = c->locked->tree;
        now->outboard = c->locked->outboard;
        now->H = c->locked->H;
    } else {
        place_arm(now, c->p, x);
    }
    now->tree.m_0 = x->base.mass;
    add_base(&now->H, &now->outboard, &now->tree);
    now->C_SN = dcm_of_mrp(x->base.sigma);
    set_vector(now->u.at, vec(0, 0, 0));
    set_vector(now->u.at + 3, base_rate(x, c->released));
    memcpy(now->u.at + 6, x->joint_rate, sizeof x->joint_rate);

    /* H_00 = [m 1, -h~; h~, I] */
    double m = now->H.at[0][0];
    vec3 h = vec(now->H.at[1][5], now->H.at[2][3], now->H.at[0][4]);
    for (int i = 0; i < 3; i++) v[i] = row_times(now->H.at[i], now->u.at, ARM_SPEEDS) / m;
    now->mass = m;
    now->c = scale(1 / m, h);
    now->v_c = vector_at(v);
}

static PosVel centre_of_mass(const Vehicle *now, const BaseState *x)
{
    return (PosVel){add(x->r, tmul(now->C_SN, now->c)), add(x->v, tmul(now->C_SN, now->v_c))};
}

static Context context_at(const Parameters *p, const Input *u, const Vehicle *locked,
                          const State *x, double t, double h)
{
    vec3 wheels = wheel_accels(&p->base, u->base.wheel_accel_cmd, x->base.wheel_speed, h);
    return (Context){p, u, locked, wheels, t, reached(t, p->base.t_att)};
}

/* ---- loads ---- */
/* one body's share: g m (3 a (a.x) - x) and 3 g a x (I a), as a wrench at S */
static Wrench gradient_on(double g, vec3 a, vec3 c, double m, vec3 c_k, mat3 I)
{
    vec3 x = sub(c_k, c);
    vec3 force = scale(g * m, sub(scale(3 * dot(a, x), a), x));
    return wrench_at(c_k, force, scale(3 * g, cross(a, mul(I, a))));
}

static Loads gradient_loads(const Parameters *p, const Vehicle *now, vec3 r_C)
{
    Loads loads = {{{0, 0, 0}, {0, 0, 0}}, {{{0, 0, 0}, {0, 0, 0}}}};
    if (!p->base.use_gravity_gradient || p->base.orbit.mu == 0) return loads;
    const Tree *t = &now->tree;
    double r = norm(r_C), g = p->base.orbit.mu / (r * r * r);
    vec3 a = scale(1 / r, mul(now->C_SN, r_C));
    loads.base = gradient_on(g, a, now->c, t->m_0, vec(0, 0, 0), t->J_S);
    for (int i = 0; i < t->joints; i++) {
        const Link *k = &t->link[i];
        loads.link[i] = gradient_on(g, a, now->c, k->m, k->c, k->I);
    }
    return loads;
}

static Wrench actuator_load(const Context *c, double t, const BaseState *x, vec3 w)
{
    const BaseParameters *p = &c->p->base;
    vec3 wheels = add(cross(w, mul(p->A_w, x->wheel_speed)), mul(p->A_w, c->wheel_accel));
    vec3 torque = add(torque_S(&c->u->base), sinusoid(&p->M_dist_S, c->since, t));
    return (Wrench){force_S(&c->u->base), sub(torque, wheels)};
}

/* the load on the end effector, base axes, at S */
static Wrench tip_load(const Context *c, const Tree *t)
{
    mat3 R_E = matmul_t(t->R_A, dcm_of_quat(c->p->arm.q_EA));
    return wrench_at(t->p_E, mul(R_E, c->u->F_contact_E), mul(R_E, c->u->M_contact_E));
}

static int locked(const Input *u, int i) { return u->joint_lock[i] != 0; }

static Column loads_on(const Context *c, double t, const State *x, const Vehicle *now)
{
    const Tree *tree = &now->tree;
    vec3 w = vector_at(now->u.at + 3);
    Loads loads = gradient_loads(c->p, now, centre_of_mass(now, &x->base).r);
    Wrench *last = tree->joints > 0 ? &loads.link[tree->joints - 1] : &loads.base;

    loads.base = plus_wrench(loads.base, actuator_load(c, t, &x->base, w));
    *last = plus_wrench(*last, tip_load(c, tree));
    Column Q = projected(tree, &loads);
    for (int i = 0; i < tree->joints; i++) {
        double torque = limited(c->u->joint_torque[i], c->p->joint.torque_max[i]);
        Q.at[6 + i] += locked(c->u, i) ? 0 : torque;
        Q.at[6 + i] -= friction_torque(&c->p->joint, i, x->joint_rate[i]);
    }
    return Q;
}

/* ---- motion ---- */
/* x of H x = y; the rows of w before t_att and those of locked joints leave the system: 0. NaN where
 * H is not positive definite */
static Column solved_free(const Input *u, const Vehicle *now, int released, const Column *y)
{
    int row[ARM_SPEEDS], n = 0;
    for (int k = 0; k < 6 + now->tree.joints; k++)
        if (k < 6 ? k < 3 || released : !locked(u, k - 6)) row[n++] = k;

    double L[ARM_SPEEDS][ARM_SPEEDS], part[ARM_SPEEDS];
    for (int i = 0; i < n; i++) {
        part[i] = y->at[row[i]];
        for (int j = 0; j <= i; j++) L[i][j] = now->H.at[row[i]][row[j]];
    }
    int good = cholesky(&L[0][0], n, ARM_SPEEDS);
    if (good) cholesky_solve(&L[0][0], n, ARM_SPEEDS, part);
    Column found = {{0}};
    for (int i = 0; i < n; i++) found.at[row[i]] = good ? part[i] : NAN;
    return found;
}

typedef struct {
    Column du;
    double lock_torque[ARM_JOINTS];
} Acceleration;

static Acceleration accelerate(const Context *c, double t, const State *x, const Vehicle *now)
{
    int n = now->tree.joints;
    Column y = loads_on(c, t, x, now);
    Column b = velocity_terms(&now->tree, vector_at(now->u.at + 3), x->joint_rate);
    for (int i = 0; i < 6 + n; i++) y.at[i] -= b.at[i];

    Acceleration found = {.du = solved_free(c->u, now, c->released, &y)};
    for (int i = 0; i < n; i++)
        if (locked(c->u, i))
            found.lock_torque[i] =
                row_times(now->H.at[6 + i], found.du.at, ARM_SPEEDS) - y.at[6 + i];
    return found;
}

static void derivative(const Context *c, double t, const State *x, State *dx)
{
    const BaseParameters *p = &c->p->base;
    Vehicle now;
    find_vehicle(&now, c, x);
    PosVel C = centre_of_mass(&now, &x->base);
    Column du = accelerate(c, t, x, &now).du;
    vec3 field = add(free_fall_N(p, &C.r, &C.v, c->since, t),
                     velocity_turning_N(p, c->released, &x->base, C.v));

    *dx = (State){.base = {.r = x->base.v,
                           .v = add(field, tmul(now.C_SN, vector_at(du.at))),
                           .mass = -c->u->base.mdot}};
    memcpy(dx->joint_angle, x->joint_rate, sizeof x->joint_rate);
    memcpy(dx->joint_rate, du.at + 6, sizeof x->joint_rate);
    if (!c->released) return;
    dx->base.sigma = mrp_rate(x->base.sigma, x->base.omega);
    dx->base.omega = vector_at(du.at + 3);
    dx->base.wheel_speed = c->wheel_accel;
}

RK4(integrate, derivative, Context, State)

/* u_f += H_ff^-1 H_fl dq_l,  dq_l = 0: the joints stop, the momenta of base and free joints stay */
static void stop_joints(const Context *c, State *x)
{
    Vehicle now;
    find_vehicle(&now, c, x);
    Column handed = {{0}};
    for (int i = 0; i < now.tree.joints; i++)
        for (int j = 0; j < ARM_SPEEDS && locked(c->u, i); j++)
            handed.at[j] += now.H.at[j][6 + i] * x->joint_rate[i];
    Column gain = solved_free(c->u, &now, c->released, &handed);

    x->base.v = add(x->base.v, tmul(now.C_SN, vector_at(gain.at)));
    x->base.omega = add(x->base.omega, vector_at(gain.at + 3));
    for (int i = 0; i < now.tree.joints; i++)
        x->joint_rate[i] = locked(c->u, i) ? 0 : x->joint_rate[i] + gain.at[6 + i];
}

static void obey_locks(const Context *c, State *x)
{
    int moving = 0;
    for (int i = 0; i < ARM_JOINTS; i++)
        moving = moving || (locked(c->u, i) && x->joint_rate[i] != 0);
    if (moving) stop_joints(c, x);
}

/* ---- outputs ---- */
static void publish_tip(const Parameters *p, const State *x, const Vehicle *now, Output *y)
{
    const Tree *t = &now->tree;
    quat q_ES = tip_attitude(&p->arm, t);
    Twist motion = tip_twist(t, vector_at(now->u.at + 3), x->joint_rate);
    y->E = (Body){add(x->base.r, tmul(now->C_SN, t->p_E)),
                  add(x->base.v, tmul(now->C_SN, velocity_at(motion, t->p_E))),
                  canonical(product(y->base.q_SN, q_ES)), mul(dcm_of_quat(q_ES), motion.w)};
}

/* about C: h = L_S - c x p, T = u.H u/2 - m v_c^2/2 */
static void publish_momentum(const Parameters *p, const Vehicle *now, Output *y)
{
    Column momentum = {{0}};
    for (int i = 0; i < ARM_SPEEDS; i++)
        momentum.at[i] = row_times(now->H.at[i], now->u.at, ARM_SPEEDS);
    vec3 wheels = mul(p->base.A_w, y->base.wheel_speed);
    vec3 h = sub(vector_at(momentum.at + 3), cross(now->c, vector_at(momentum.at)));
    y->h_N = tmul(now->C_SN, add(h, wheels));
    y->kinetic_energy =
        (row_times(now->u.at, momentum.at, ARM_SPEEDS) - now->mass * dot(now->v_c, now->v_c)) / 2;
}

static void publish(const Parameters *p, const Input *u, const Vehicle *locked, const State *x,
                    Output *y, double t)
{
    Context c = context_at(p, u, locked, x, t, p->base.max_step);
    Vehicle now;
    find_vehicle(&now, &c, x);
    Acceleration accel = accelerate(&c, t, x, &now);

    publish_base(&p->base, &x->base, &y->base, t);
    if (x->base.mass >= 0) y->base.mass = now.mass;
    memcpy(y->joint_angle, x->joint_angle, sizeof y->joint_angle);
    memcpy(y->joint_rate, x->joint_rate, sizeof y->joint_rate);
    memcpy(y->joint_accel, accel.du.at + 6, sizeof y->joint_accel);
    memcpy(y->lock_torque, accel.lock_torque, sizeof y->lock_torque);
    publish_tip(p, x, &now, y);
    y->r_CS_S = now.c;
    y->v_CN_N = centre_of_mass(&now, &x->base).v;
    publish_momentum(p, &now, y);
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    *x = (State){.base = base_at_start(&p->base)};
    for (int i = 0; i < (int)p->arm.joints; i++) {
        x->joint_angle[i] = p->joint_angle_0[i];
        x->joint_rate[i] = p->joint_rate_0[i];
    }
    Context c = context_at(p, u, NULL, x, t, p->base.max_step);
    obey_locks(&c, x);
    publish(p, u, NULL, x, y, t);
}

static int all_locked(const Parameters *p, const Input *u)
{
    int free = 0;
    for (int i = 0; i < (int)p->arm.joints; i++) free += !locked(u, i);
    return !free;
}

/* a locked arm is where it is for the whole step: it is placed once */
static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    Vehicle held;
    const Vehicle *rigid = all_locked(p, u) ? &held : NULL;
    if (rigid) place_arm(&held, p, x);
    for (Substep s = first_substep(t, h, p->base.max_step); s.h > 0; s = next_substep(s)) {
        Context c = context_at(p, u, rigid, x, s.t, s.h);
        obey_locks(&c, x);
        integrate(&c, s.t, s.h, x);
        x->base.sigma = mrp_inside(x->base.sigma);
        if (rate_margin(&p->base, &x->base, s.t + s.h) < 0) break; /* refused: nothing to follow */
    }
    publish(p, u, rigid, x, y, t + h);
}

FMU_MODEL("arm_servicer", "Servicer with an arm of up to seven joints and its locks");
