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
 * S is the base body, r_SN_N its centre of mass: sensors, thrusters and wheels are fixed to S. u:
 * velocity v and angular velocity w of S in base axes, joint rates dq; H: mass matrix, b: velocity
 * terms. Body k has the mass m_k, inertia I_k and centre of mass c_k; Jw_k, Jv_k: derivatives of
 * its angular velocity and velocity by u; J_E: the same for the end effector, R_E: end effector to
 * base axes.
 *
 * C is the centre of mass of base and arm, c = r_CS_S, x_k = c_k - c, a = C_SN r_C/|r_C|. f:
 * gravity with J2 at C, a_dist and, with velocity_follows_attitude = 1 as in `servicer`, (C_SN^T w)
 * x v_C. f accelerates all bodies alike and excites no joint; the gravity gradient does. A locked
 * joint is removed from the system of equations; a joint that moves when it is locked stops at
 * once, and its momentum is transferred to base and free joints. Before t_att the base does not
 * turn, while the joints move. With joints = 0 the model equals `servicer`. Equations:
 * docs/models.md K.1, K.2. Classical Runge-Kutta on the grid k * max_step. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "arm_dynamics.h"
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
    BaseState base; /* mass: of the base body alone */
    double joint_angle[ARM_JOINTS], joint_rate[ARM_JOINTS];
} Motion;
typedef struct {
    Tree tree;
    Composite base;
    mat3 C_SN;
    Speeds u; /* velocities relative to the point S, so that u.v = 0 */
    Wrench momentum;
    vec3 c;   /* centre of mass of base and arm, from S, base axes */
    PosVel C; /* motion of the centre of mass, N axes */
    Forces b; /* b - Q_gg */
} Vehicle;
typedef struct {
    Motion now;
    Vehicle vehicle; /* evaluated for the motion `now`, used at the start of the next step */
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
    OPTIONAL_INPUT(
        joint_torque, "N.m",
        "torque at the joints, on the outboard body about the axis; no effect on a locked joint"),
    OPTIONAL_SWITCH(joint_lock, "1: the joint is locked; per joint"),
    OPTIONAL_INPUT(F_contact_E, "N", "force at the origin of the end effector, end-effector axes"),
    OPTIONAL_INPUT(M_contact_E, "N.m",
                   "torque on the end effector about its origin, end-effector axes"),

    BASE_OUTPUTS,
    OUTPUT(joint_angle, "rad", "joint angles"),
    OUTPUT(joint_rate, "rad/s", "joint rates"),
    OUTPUT(joint_accel, "rad/s2", "joint accelerations"),
    OUTPUT(lock_torque, "N.m", "torque of the lock on the outboard body; 0 when the joint is free"),
    BODY_OUTPUTS("E", E, "end effector"),
    OUTPUT(r_CS_S, "m", "centre of mass of the whole vehicle from S, body axes"),
    OUTPUT(v_CN_N, "m/s", "velocity of the centre of mass, N axes"),
    OUTPUT(h_N, "N.m.s", "angular momentum about the centre of mass, wheels included, N axes"),
    OUTPUT(kinetic_energy, "J",
           "kinetic energy of the motion about the centre of mass, wheels counted as locked, "
           "rotors of the joints included"),
};

static void check(const Parameters *p, Problems *problems)
{
    check_rigid_base(problems, &p->base);
    check_joints(problems, &p->joint, check_arm(problems, &p->arm));
}

/* ---- quantities that are constant over an internal step ---- */
typedef struct {
    const Parameters *p;
    const Input *u;
    const Chain *arm;
    const Vehicle *begin;
    const Tree *rigid; /* the arm as part of the base if all joints are locked, else NULL */
    Composite base;    /* without the mass of the base body, which set_vehicle() adds at S */
    Wrench tip;        /* load on the end effector, axes of the last link */
    DegreesOfFreedom moving;
    vec3 wheel_accel, wheel_torque; /* A_w dOmega */
    double step_start;              /* start time of the internal step [s] */
} Context;

static int locked(const Input *u, int i) { return u->joint_lock[i] != 0; }

static Context context_at(const Parameters *p, const Input *u, const Chain *arm, const State *x,
                          double t, double h)
{
    mat3 C_EA = dcm_of_quat(p->arm.q_EA);
    Context c = {.p = p,
                 .u = u,
                 .arm = arm,
                 .begin = &x->vehicle,
                 .base = body_at_S(0, p->base.J_S),
                 .tip = {tmul(C_EA, u->F_contact_E), tmul(C_EA, u->M_contact_E)},
                 .moving = {.turns = reached(t, p->base.t_att)},
                 .wheel_accel =
                     wheel_accels(&p->base, u->base.wheel_accel_cmd, x->now.base.wheel_speed, h),
                 .step_start = t};
    for (int i = 0; i < arm->joints; i++) {
        c.moving.moves[i] = !locked(u, i);
        c.moving.joints += !locked(u, i);
    }
    c.wheel_torque = mul(p->base.A_w, c.wheel_accel);
    return c;
}

/* ---- the vehicle at an instant ---- */
static TidalField tidal_field(const Parameters *p, const Vehicle *now)
{
    if (!p->base.use_gravity_gradient || p->base.orbit.mu == 0)
        return tidal_field_about(now->c, 0, vec(0, 0, 0));
    double r = norm(now->C.r);
    return tidal_field_about(now->c, p->base.orbit.mu / (r * r * r),
                             scale(1 / r, mul(now->C_SN, now->C.r)));
}

static void place_links_of_arm(Tree *t, Links *k, const Chain *arm, const Motion *x)
{
    place_links(t, k, arm, x->joint_angle);
    set_link_inertias(k, arm);
}

/* sets `now` for the motion x; now->tree and the links k must already contain the positions of the
 * links; turns: 0 before t_att, when the base does not turn */
static void set_vehicle(Vehicle *now, const Links *k, const Parameters *p, const Composite *base,
                        int turns, const Motion *x)
{
    now->base = *base;
    now->base.m += x->base.mass;
    set_mass_matrix(&now->tree, k, &now->base);
    now->C_SN = dcm_of_mrp(x->base.sigma);
    now->u = (Speeds){.w = turns ? x->base.omega : vec(0, 0, 0)};
    memcpy(now->u.joint, x->joint_rate, sizeof x->joint_rate);
    now->momentum = base_rows(&now->tree, &now->u);
    now->c = centre_of(&now->tree.whole);
    vec3 v_c = scale(1 / now->tree.whole.m, now->momentum.F);
    now->C =
        (PosVel){add(x->base.r, tmul(now->C_SN, now->c)), add(x->base.v, tmul(now->C_SN, v_c))};
    TidalField tidal = tidal_field(p, now);
    now->b = velocity_forces(&now->tree, k, &now->base, &now->u, &tidal);
}

/* evaluates x->vehicle for the motion x->now at time t */
static void update_vehicle(const Parameters *p, const Chain *arm, State *x, double t)
{
    Links links;
    Composite base = body_at_S(0, p->base.J_S);
    place_links_of_arm(&x->vehicle.tree, &links, arm, &x->now);
    set_vehicle(&x->vehicle, &links, p, &base, reached(t, p->base.t_att), &x->now);
}

/* ---- loads ---- */
static Wrench actuator_load(const Context *c, double t, const BaseState *x, vec3 w)
{
    const BaseParameters *p = &c->p->base;
    vec3 wheels = add(cross(w, mul(p->A_w, x->wheel_speed)), c->wheel_torque);
    vec3 torque = add(torque_S(&c->u->base), sinusoid(&p->M_dist_S, c->step_start, t));
    return (Wrench){force_S(&c->u->base), sub(torque, wheels)};
}

/* load on the end effector, converted to a wrench at S in base axes */
static Wrench tip_load(const Context *c, const Tree *t)
{
    return wrench_at(t->p_E, mul(t->R_A, c->tip.F), mul(t->R_A, c->tip.M));
}

/* Q - b of the equations of motion */
static Forces loads_on(const Context *c, double t, const Motion *x, const Vehicle *now)
{
    const Tree *tree = &now->tree;
    int joints = (int)tree->joints;
    Wrench tip = tip_load(c, tree), base = actuator_load(c, t, &x->base, now->u.w);
    Forces Q = {.base = plus_wrench(plus_wrench(base, 1, tip), -1, now->b.base)};
    for (int i = 0; i < COLUMNS; i++) Q.joint[i] = power(screw_at(tree, i), tip) - now->b.joint[i];
    for (int i = 0; i < joints; i++) {
        double torque = limited(c->u->joint_torque[i], c->p->joint.torque_max[i]);
        Q.joint[i] +=
            (locked(c->u, i) ? 0 : torque) - friction_torque(&c->p->joint, i, x->joint_rate[i]);
    }
    return Q;
}

/* ---- motion ---- */
static void derivative(const Context *c, double t, const Motion *x, Motion *dx)
{
    const BaseParameters *p = &c->p->base;
    Vehicle computed;
    Links links;
    const Vehicle *now = c->begin;
    if (t > c->step_start) {
        if (c->rigid) computed.tree = *c->rigid;
        else place_links_of_arm(&computed.tree, &links, c->arm, x);
        set_vehicle(&computed, &links, c->p, &c->base, c->moving.turns, x);
        now = &computed;
    }
    Forces y = loads_on(c, t, x, now);
    Speeds du = solve_for_speeds(&now->tree, &c->moving, &y);
    vec3 field_acceleration = add(free_fall_N(p, &now->C.r, &now->C.v, c->step_start, t),
                                  velocity_turning_N(p, c->moving.turns, &x->base, now->C.v));

    *dx = (Motion){.base = {.r = x->base.v,
                            .v = add(field_acceleration, tmul(now->C_SN, du.v)),
                            .mass = -c->u->base.mdot}};
    memcpy(dx->joint_angle, x->joint_rate, sizeof x->joint_rate);
    memcpy(dx->joint_rate, du.joint, sizeof x->joint_rate);
    if (!c->moving.turns) return;
    dx->base.sigma = mrp_rate(x->base.sigma, x->base.omega);
    dx->base.omega = du.w;
    dx->base.wheel_speed = c->wheel_accel;
}

RK4(integrate, derivative, Context, Motion)

/* u_f += H_ff^-1 H_fl dq_l, then dq_l = 0: locked joints l stop, the momenta of f, base and free
 * joints, are conserved */
static void stop_joints(const Context *c, const Vehicle *now, Motion *x)
{
    Speeds stopped = {.joint = {0}};
    int joints = c->arm->joints;
    for (int i = 0; i < joints; i++) stopped.joint[i] = locked(c->u, i) ? x->joint_rate[i] : 0;
    Forces transferred = {.base = base_rows(&now->tree, &stopped)};
    set_joint_rows(transferred.joint, &now->tree, &stopped);
    Speeds change = solve_for_speeds(&now->tree, &c->moving, &transferred);

    x->base.v = add(x->base.v, tmul(now->C_SN, change.v));
    x->base.omega = add(x->base.omega, change.w);
    for (int i = 0; i < joints; i++)
        x->joint_rate[i] = locked(c->u, i) ? 0 : x->joint_rate[i] + change.joint[i];
}

static void apply_locks(const Context *c, State *x)
{
    int moving = 0;
    for (int i = 0; i < ARM_JOINTS; i++)
        moving = moving || (locked(c->u, i) && x->now.joint_rate[i] != 0);
    if (!moving) return;
    stop_joints(c, &x->vehicle, &x->now);
    update_vehicle(c->p, c->arm, x, c->step_start);
}

/* ---- outputs ---- */
static void publish_tip(const Parameters *p, const State *x, Output *y)
{
    const Vehicle *now = &x->vehicle;
    const Tree *t = &now->tree;
    const BaseState *base = &x->now.base;
    quat q_ES = tip_attitude(&p->arm, t);
    Twist motion = tip_twist(t, &now->u);
    y->E = (Body){add(base->r, tmul(now->C_SN, t->p_E)),
                  add(base->v, tmul(now->C_SN, velocity_at(motion, t->p_E))),
                  canonical(product(y->base.q_SN, q_ES)), mul(dcm_of_quat(q_ES), motion.w)};
}

/* sets the outputs of angular momentum and energy about C: h = L_S - c x p + A_w Omega in N axes,
 * T = u.H u/2 - m v_c^2/2 with the wheels locked, from the momenta p, L_S about S and the velocity
 * v_c = p/m of C relative to S; Omega: wheel speeds */
static void publish_momentum(const Parameters *p, const Vehicle *now, Output *y)
{
    int joints = (int)now->tree.joints;
    Wrench momentum = now->momentum;
    double twice = dot(now->u.w, momentum.M) - dot(momentum.F, momentum.F) / now->tree.whole.m;
    double row[COLUMNS];
    set_joint_rows(row, &now->tree, &now->u);
    for (int i = 0; i < joints; i++) twice += now->u.joint[i] * row[i];
    vec3 wheels = mul(p->base.A_w, y->base.wheel_speed);
    vec3 h = sub(momentum.M, cross(now->c, momentum.F));
    y->h_N = tmul(now->C_SN, add(h, wheels));
    y->kinetic_energy = twice / 2;
}

static void publish_joints(const Context *c, double t, const Motion *x, const Vehicle *now,
                           Output *y)
{
    int joints = (int)now->tree.joints;
    Forces Q = loads_on(c, t, x, now);
    Speeds du = solve_for_speeds(&now->tree, &c->moving, &Q);
    memcpy(y->joint_angle, x->joint_angle, sizeof y->joint_angle);
    memcpy(y->joint_rate, x->joint_rate, sizeof y->joint_rate);
    memcpy(y->joint_accel, du.joint, sizeof y->joint_accel);
    double row[COLUMNS] = {0};
    if (c->moving.joints < joints) set_joint_rows(row, &now->tree, &du);
    for (int i = 0; i < ARM_JOINTS; i++)
        y->lock_torque[i] = i < joints && locked(c->u, i) ? row[i] - Q.joint[i] : 0;
}

static void publish(const Context *c, const State *x, Output *y, double t)
{
    const Parameters *p = c->p;
    const Vehicle *now = &x->vehicle;
    const BaseState *base = &x->now.base;
    publish_base(&p->base, base, &y->base, t);
    if (base->mass >= 0) y->base.mass = now->tree.whole.m;
    publish_joints(c, t, &x->now, now, y);
    publish_tip(p, x, y);
    y->r_CS_S = now->c;
    y->v_CN_N = now->C.v;
    publish_momentum(p, now, y);
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    Chain arm;
    set_chain(&arm, &p->arm);
    *x = (State){.now.base = base_at_start(&p->base)};
    for (int i = 0; i < arm.joints; i++) {
        x->now.joint_angle[i] = p->joint_angle_0[i];
        x->now.joint_rate[i] = p->joint_rate_0[i];
    }
    update_vehicle(p, &arm, x, t);
    Context c = context_at(p, u, &arm, x, t, p->base.max_step);
    apply_locks(&c, x);
    publish(&c, x, y, t);
}

/* makes the arm a part of the base for this step, in which all joints are locked */
static void merge_arm_with_base(Context *c, Tree *rigid)
{
    const Tree *arm = &c->begin->tree;
    *rigid = (Tree){.R_A = arm->R_A, .p_E = arm->p_E};
    c->base = combined(c->base, arm->links);
    c->rigid = rigid;
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    Chain arm;
    Tree rigid;
    set_chain(&arm, &p->arm);
    for (Substep s = first_substep(t, h, p->base.max_step); s.h > 0; s = next_substep(s)) {
        Context c = context_at(p, u, &arm, x, s.t, s.h);
        apply_locks(&c, x);
        if (c.moving.joints == 0) merge_arm_with_base(&c, &rigid);
        integrate(&c, s.t, s.h, &x->now);
        x->now.base.sigma = mrp_inside(x->now.base.sigma);
        update_vehicle(p, &arm, x, s.t + s.h);
        /* the FMI adapter rejects a negative output rate_margin, and the step fails */
        if (rate_margin(&p->base, &x->now.base, s.t + s.h) < 0) break;
    }
    Context c = context_at(p, u, &arm, x, t + h, p->base.max_step);
    publish(&c, x, y, t + h);
}

FMU_MODEL("arm_servicer", "Servicer with an arm of up to seven joints and its locks");
