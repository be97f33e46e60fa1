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
    Tree own;
    const Tree *tree;
    Composite base;
    MassMatrix H;
    mat3 C_SN;
    Speeds u;    /* S at rest */
    vec3 c, v_c; /* centre of mass and its velocity, from S, base axes */
} Vehicle;

/* what holds over an internal step */
typedef struct {
    const Parameters *p;
    const Input *u;
    const Tree *placed; /* the arm where it does not move, else 0 */
    Composite base;     /* without its mass, which is at S */
    Wrench tip;         /* load on the end effector, axes of the last link */
    Moving moving;
    vec3 wheel_accel;
    double since; /* its start */
} Context;

static int locked(const Input *u, int i) { return u->joint_lock[i] != 0; }

static Context context_at(const Parameters *p, const Input *u, const State *x, double t, double h)
{
    mat3 C_EA = dcm_of_quat(p->arm.q_EA);
    Context c = {.p = p,
                 .u = u,
                 .base = body_at_S(0, p->base.J_S),
                 .tip = {tmul(C_EA, u->F_contact_E), tmul(C_EA, u->M_contact_E)},
                 .moving = {.turns = reached(t, p->base.t_att)},
                 .wheel_accel =
                     wheel_accels(&p->base, u->base.wheel_accel_cmd, x->base.wheel_speed, h),
                 .since = t};
    for (int i = 0; i < (int)p->arm.joints; i++)
        if (!locked(u, i)) c.moving.joint[c.moving.joints++] = i;
    return c;
}

static void place_arm(Tree *t, const Parameters *p, const State *x)
{
    place(t, &p->arm, x->joint_angle);
    weigh(t, &p->arm);
}

static void find_vehicle(Vehicle *now, const Context *c, const State *x)
{
    now->tree = c->placed;
    if (!now->tree) {
        place_arm(&now->own, c->p, x);
        now->tree = &now->own;
    }
    now->base = c->base;
    now->base.m += x->base.mass;
    set_mass_matrix(&now->H, &c->p->arm, now->tree, &now->base);
    now->C_SN = dcm_of_mrp(x->base.sigma);
    now->u = (Speeds){.w = c->moving.turns ? x->base.omega : vec(0, 0, 0)};
    memcpy(now->u.joint, x->joint_rate, sizeof x->joint_rate);
    now->c = centre_of(&now->H.whole);
    now->v_c = velocity_of_centre(&now->H, &now->u);
}

static PosVel centre_of_mass(const Vehicle *now, const BaseState *x)
{
    return (PosVel){add(x->r, tmul(now->C_SN, now->c)), add(x->v, tmul(now->C_SN, now->v_c))};
}

/* ---- loads ---- */
static Tide tide_on(const Parameters *p, const Vehicle *now, vec3 r_C)
{
    if (!p->base.use_gravity_gradient || p->base.orbit.mu == 0)
        return tide_about(now->c, 0, vec(0, 0, 0));
    double r = norm(r_C);
    return tide_about(now->c, p->base.orbit.mu / (r * r * r), scale(1 / r, mul(now->C_SN, r_C)));
}

static Wrench actuator_load(const Context *c, double t, const BaseState *x, vec3 w)
{
    const BaseParameters *p = &c->p->base;
    vec3 wheels = add(cross(w, mul(p->A_w, x->wheel_speed)), mul(p->A_w, c->wheel_accel));
    vec3 torque = add(torque_S(&c->u->base), sinusoid(&p->M_dist_S, c->since, t));
    return (Wrench){force_S(&c->u->base), sub(torque, wheels)};
}

/* base axes, at S */
static Wrench tip_load(const Context *c, const Tree *t)
{
    return wrench_at(t->p_E, mul(t->R_A, c->tip.F), mul(t->R_A, c->tip.M));
}

/* Q - b */
static Forces loads_on(const Context *c, double t, const State *x, const Vehicle *now)
{
    const Tree *tree = now->tree;
    int joints = tree->joints;
    Loads loads;
    Tide tide = tide_on(c->p, now, centre_of_mass(now, &x->base).r);
    set_velocity_loads(&loads, tree, &now->base, now->u.w, x->joint_rate, &tide);
    Wrench *last = joints > 0 ? &loads.link[joints - 1] : &loads.base;
    *last = plus_wrench(*last, -1, tip_load(c, tree));
    Forces b = projected(tree, &loads); /* less Q_gg and J_E^T of the load on the tip */
    Forces Q = {.base = plus_wrench(actuator_load(c, t, &x->base, now->u.w), -1, b.base)};
    for (int i = 0; i < joints; i++) {
        double torque = limited(c->u->joint_torque[i], c->p->joint.torque_max[i]);
        Q.joint[i] = locked(c->u, i) ? 0 : torque;
        Q.joint[i] -= friction_torque(&c->p->joint, i, x->joint_rate[i]) + b.joint[i];
    }
    return Q;
}

/* ---- motion ---- */
static void derivative(const Context *c, double t, const State *x, State *dx)
{
    const BaseParameters *p = &c->p->base;
    Vehicle now;
    find_vehicle(&now, c, x);
    PosVel C = centre_of_mass(&now, &x->base);
    Forces y = loads_on(c, t, x, &now);
    Speeds du = solved(&now.H, &c->moving, &y);
    vec3 field = add(free_fall_N(p, &C.r, &C.v, c->since, t),
                     velocity_turning_N(p, c->moving.turns, &x->base, C.v));

    *dx = (State){
        .base = {.r = x->base.v, .v = add(field, tmul(now.C_SN, du.v)), .mass = -c->u->base.mdot}};
    memcpy(dx->joint_angle, x->joint_rate, sizeof x->joint_rate);
    memcpy(dx->joint_rate, du.joint, sizeof x->joint_rate);
    if (!c->moving.turns) return;
    dx->base.sigma = mrp_rate(x->base.sigma, x->base.omega);
    dx->base.omega = du.w;
    dx->base.wheel_speed = c->wheel_accel;
}

RK4(integrate, derivative, Context, State)

/* u_f += H_ff^-1 H_fl dq_l,  dq_l = 0: the joints stop, the momenta of base and free joints stay */
static void stop_joints(const Context *c, State *x)
{
    Vehicle now;
    find_vehicle(&now, c, x);
    Speeds lost = {.joint = {0}};
    int joints = now.tree->joints;
    for (int i = 0; i < joints; i++) lost.joint[i] = locked(c->u, i) ? x->joint_rate[i] : 0;
    Forces handed = {.base = base_rows(&now.H, &lost)};
    set_joint_rows(handed.joint, &now.H, &lost);
    Speeds gain = solved(&now.H, &c->moving, &handed);

    x->base.v = add(x->base.v, tmul(now.C_SN, gain.v));
    x->base.omega = add(x->base.omega, gain.w);
    for (int i = 0; i < joints; i++)
        x->joint_rate[i] = locked(c->u, i) ? 0 : x->joint_rate[i] + gain.joint[i];
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
    const Tree *t = now->tree;
    quat q_ES = tip_attitude(&p->arm, t);
    Twist motion = tip_twist(t, now->u.w, x->joint_rate);
    y->E = (Body){add(x->base.r, tmul(now->C_SN, t->p_E)),
                  add(x->base.v, tmul(now->C_SN, velocity_at(motion, t->p_E))),
                  canonical(product(y->base.q_SN, q_ES)), mul(dcm_of_quat(q_ES), motion.w)};
}

/* about C: h = L_S - c x p, T = u.H u/2 - m v_c^2/2 */
static void publish_momentum(const Parameters *p, const Vehicle *now, Output *y)
{
    int joints = now->tree->joints;
    Wrench momentum = base_rows(&now->H, &now->u);
    double twice = dot(now->u.w, momentum.M) - now->H.whole.m * dot(now->v_c, now->v_c);
    double row[ARM_JOINTS];
    set_joint_rows(row, &now->H, &now->u);
    for (int i = 0; i < joints; i++) twice += now->u.joint[i] * row[i];
    vec3 wheels = mul(p->base.A_w, y->base.wheel_speed);
    vec3 h = sub(momentum.M, cross(now->c, momentum.F));
    y->h_N = tmul(now->C_SN, add(h, wheels));
    y->kinetic_energy = twice / 2;
}

static void publish_joints(const Context *c, double t, const State *x, const Vehicle *now,
                           Output *y)
{
    int joints = now->tree->joints;
    Forces Q = loads_on(c, t, x, now);
    Speeds du = solved(&now->H, &c->moving, &Q);
    memcpy(y->joint_angle, x->joint_angle, sizeof y->joint_angle);
    memcpy(y->joint_rate, x->joint_rate, sizeof y->joint_rate);
    memcpy(y->joint_accel, du.joint, sizeof y->joint_accel);
    double row[ARM_JOINTS] = {0};
    if (c->moving.joints < joints) set_joint_rows(row, &now->H, &du);
    for (int i = 0; i < ARM_JOINTS; i++)
        y->lock_torque[i] = i < joints && locked(c->u, i) ? row[i] - Q.joint[i] : 0;
}

static void publish(const Parameters *p, const Input *u, const Tree *placed, const State *x,
                    Output *y, double t)
{
    Context c = context_at(p, u, x, t, p->base.max_step);
    c.placed = placed;
    Vehicle now;
    find_vehicle(&now, &c, x);
    publish_base(&p->base, &x->base, &y->base, t);
    if (x->base.mass >= 0) y->base.mass = now.H.whole.m;
    publish_joints(&c, t, x, &now, y);
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
    Context c = context_at(p, u, x, t, p->base.max_step);
    obey_locks(&c, x);
    publish(p, u, NULL, x, y, t);
}

/* all joints locked: the arm is where it is for the whole step, and part of the base */
static void hold_arm(Context *c, const Tree *arm, const Tree *none)
{
    MassMatrix H;
    set_mass_matrix(&H, &c->p->arm, arm, &c->base);
    c->base = H.whole;
    c->placed = none;
}

static int all_locked(const Parameters *p, const Input *u)
{
    int moving = 0;
    for (int i = 0; i < (int)p->arm.joints; i++) moving += !locked(u, i);
    return !moving;
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    Tree arm, none;
    int held = all_locked(p, u);
    if (held) {
        place_arm(&arm, p, x);
        none = (Tree){.R_A = arm.R_A, .p_E = arm.p_E};
    }
    for (Substep s = first_substep(t, h, p->base.max_step); s.h > 0; s = next_substep(s)) {
        Context c = context_at(p, u, x, s.t, s.h);
        obey_locks(&c, x);
        if (held) hold_arm(&c, &arm, &none);
        integrate(&c, s.t, s.h, x);
        x->base.sigma = mrp_inside(x->base.sigma);
        if (rate_margin(&p->base, &x->base, s.t + s.h) < 0) break; /* refused: nothing to follow */
    }
    publish(p, u, held ? &arm : NULL, x, y, t + h);
}

FMU_MODEL("arm_servicer", "Servicer with an arm of up to seven joints and its locks");
