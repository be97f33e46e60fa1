/* pursuit_guidance.c - pursuit of a drifting target with a body-fixed thrust axis X: required
 * direction and velocity.
 *
 *   d      required direction of X: line of sight dr = r_T - r_S,
 *           or +- the velocity error before and during a burn
 *   L      transition quaternion S -> D: two turns (att 0) or the shortest arc (att 1)
 *   omega  = 2 k_q [L1 L2 L3], at most omega_max: required rate, along the axis of L,
 *           so the same in S and D components
 *   law 0  v_req = 2, 0.5 or 1 times |v_T| by range, along X
 *           drho_ref = v_req X - v_T
 *   law 1  s = clip(k_r (range - zeta1), -|v_T|, 2 |v_T|),  e_v = v_T + s dr/range - v_S
 *           drho_ref = s dr/range
 *          and the modes COAST (thrust off), ALIGN (turn X or -X to e_v), BURN (thrust on)
 *          v_close > 0:  s = clip(k_r (range - zeta1), -v_close/2, v_close)
 *
 * zeta1: required range; rho_ref, drho_ref: reference position and velocity of the servicer
 * relative to the target; v_close > 0 replaces the first s of law 1 by the last line. A sample with
 * active = 0 resets the state and permits no thrust.
 * The controller needs only (v_T + drho_ref - v_S) . X from drho_ref. |v_T| is relative to the
 * frame of the law: N in deep space, else a frame that moves with a point on a circular orbit.
 * rho_ref is the hold point on the line of sight, not the integral of drho_ref, and omega is a
 * command, not the rate of the attitude q_DN.
 * Source: Kozlova & Fomichev 2023 as corrected in docs/models.md B.8; law 1 and att 1: B.4. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "body_rows.h"
#include "reference_rows.h"
#include "time_grid.h"

typedef enum { COAST, ALIGN, BURN } Mode;

typedef struct {
    double law, att, k_q, omega_max;
    double zeta1, zeta2, zhys, text_speed;
    double v_close, k_r, rho1, rho2, alpha_fire, omega_fire, t_burn_min, main_thrust, brake_thrust;
    double mu, frame_radius, sample_period;
} Parameters;
typedef struct {
    Body T, S;
    vec3 F_S;
    double translation_firing, active;
} Input;
typedef struct {
    double started, far, mode, t_burn;
    vec3 d_burn;
} State; /* d_burn: direction of the burn, N axes */
typedef struct {
    Reference ref;
    double translate, mode, range;
    quat q_DS;
    vec3 e_v_N;
    double v_req, pointing_angle;
} Output;
MODEL_STRUCT;

static const Model start = {
    .p = {.law = 1,
          .att = 1,
          .k_q = 0.02,
          .omega_max = 0.004,
          .zeta1 = 50,
          .zeta2 = 10,
          .k_r = 2e-3,
          .rho1 = 4e-3,
          .rho2 = 5e-3,
          .alpha_fire = 0.17453292519943295,
          .omega_fire = 2e-3,
          .t_burn_min = 0.5,
          .main_thrust = 5,
          .brake_thrust = 4},
    .u = {.T = {.r = {500, -100, 0}, .v = {0, 0.008, 0.006}, .q = {1, 0, 0, 0}},
          .S = {.q = {1, 0, 0, 0}},
          .active = 1},
};

static const Variable variables[] = {
    SWITCH(law,
           "speed law: 0 scalar along X (deep space only), 1 vector with coast, align and burn"),
    SWITCH(att, "required attitude: 0 its Z axis is normal to X of N, 1 shortest arc from "
                "the present"),
    POSITIVE(k_q, "1/s", "gain of the required rate, which is 2 k_q times the vector part of q_DS"),
    NONNEGATIVE(omega_max, "rad/s", "largest magnitude of the required rate vector; 0 = no limit"),
    NONNEGATIVE(zeta1, "m",
                "required range; if law = 0, the required speed beyond it is twice the target's"),
    NONNEGATIVE(zeta2, "m", "if law = 0: range up to which the required speed is the target's"),
    NONNEGATIVE(zhys, "m", "if law = 0: half width of the hysteresis about range zeta1"),
    SWITCH(text_speed, "if law = 0, range zeta2 to zeta1: 0 half the target's speed (paper's "
                       "formula), 1 full (its text)"),
    NONNEGATIVE(v_close, "m/s",
                "if law = 1: limit of the closing speed (half to move away); 0: twice the "
                "target's speed (once to move away)"),
    NONNEGATIVE(k_r, "1/s", "if law = 1: gain from range error to closing speed"),
    NONNEGATIVE(rho1, "m/s", "if law = 1: velocity error below which mode align returns to coast"),
    POSITIVE(rho2, "m/s", "if law = 1: velocity error from which mode coast changes to align"),
    POSITIVE(alpha_fire, "rad", "if law = 1: largest pointing error at ignition"),
    POSITIVE(omega_fire, "rad/s", "if law = 1: ignition below this angular rate of the servicer"),
    NONNEGATIVE(t_burn_min, "s", "if law = 1: a burn lasts longer than this time"),
    POSITIVE(
        main_thrust, "N",
        "if law = 1: nominal thrust along +X; a burn is detected from F_S along X above 1 % of "
        "this"),
    POSITIVE(brake_thrust, "N",
             "if law = 1: nominal thrust of all brakes; a burn is detected from F_S along -X above "
             "1 % of this"),
    NONNEGATIVE(mu, "m3/s2", "gravitational parameter of the planet; 0 = deep space"),
    NONNEGATIVE(frame_radius, "m",
                "if mu > 0, the target's speed is relative to a point on a circular orbit "
                "of this radius in the xy plane of N, on +x at t = 0"),
    SAMPLE_PERIOD,

    BODY_INPUTS("T", T, "target"),
    BODY_INPUTS("S", S, "servicer"),
    INPUT(F_S, "N", "force of the thrusters, body axes"),
    INPUT(translation_firing, "1", "1: a translational engine is commanded"),
    OPTIONAL_SWITCH(active, ACTIVE_TEXT),

    REFERENCE_ROWS(OUTPUT_ROW, y, ref),
    FLAG(translate, "1: translational thrust permitted"),
    MODE(mode, "mode of the thrust; always burn if law = 0", "coast|align|burn"),
    NONNEGATIVE_OUTPUT(range, "m", "distance between the centres of mass"),
    OUTPUT(q_DS, "1",
           "transition quaternion from the present to the required attitude, scalar first"),
    OUTPUT(e_v_N, "m/s", "required minus present velocity, N axes"),
    OUTPUT(v_req, "m/s",
           "required speed along X (if law = 0); required closing speed (if law = 1)"),
    ANGLE_OUTPUT(pointing_angle,
                 "angle between the X axis of the servicer and the direction to the target"),
};

/* B.4-8 */
static void check(const Parameters *p, Problems *problems)
{
    if (p->rho1 >= p->rho2) reject(problems, "rho1", p->rho1, "must be below rho2");
    if (p->zeta2 >= p->zeta1) reject(problems, "zeta2", p->zeta2, "must be below zeta1");
    if (p->zhys > p->zeta1) reject(problems, "zhys", p->zhys, "must not be above zeta1");
    if (p->alpha_fire >= 1.5)
        reject(problems, "alpha_fire", p->alpha_fire, "must be below 1.5 rad");
    if (p->mu > 0 && p->law == 0) reject(problems, "law", p->law, "must be 1 when mu > 0");
    if (p->mu > 0 && p->frame_radius == 0 && p->v_close == 0)
        reject(problems, "frame_radius", 0, "must be > 0 when mu > 0 and v_close = 0");
}

/* velocity of the frame of the law: n R [-sin nt, cos nt, 0], n^2 = mu/R^3, R = frame_radius; 0 if
 * mu or R is 0 */
static vec3 frame_velocity(const Parameters *p, double t)
{
    if (p->mu == 0 || p->frame_radius == 0) return vec(0, 0, 0);
    double v = sqrt(p->mu / p->frame_radius);
    SineCosine nt = sine_and_cosine(v / p->frame_radius * t);
    return vec(-v * nt.s, v * nt.c, 0);
}

static vec3 direction(vec3 a, vec3 otherwise) /* unit vector of a; `otherwise` if a is 0 */
{
    double n = norm(a);
    return n > 0 ? scale(1 / n, a) : otherwise;
}

/* ---- attitude ---- */

/* B.4.1: quaternion from S to the required attitude D. The rows of A are the axes of D in N
 * components. q = sin g, with the angle g from x of N to d; cb, sb: cosine and sine of the angle b
 * from the xy plane of N to the plane of x and d. */
static quat two_turns(quat q_SN, vec3 d)
{
    double q = sqrt(d.y * d.y + d.z * d.z), cb = q > 0 ? d.y / q : 1, sb = q > 0 ? d.z / q : 0;
    mat3 A = rows(d, vec(-q, d.x * cb, d.x * sb), vec(0, -sb, cb));
    return canonical(product(conjugate(q_SN), quat_of_dcm(A))); /* half a turn: L1 >= 0 */
}

/* B.4.2: quaternion [c, 0, -b3/(2c), b2/(2c)], c = sqrt((1 + b1)/2), of the rotation that turns X
 * to d; b: d in S components. If b is -X, it is half a turn about Y. Because 1 + b1 loses digits
 * near b1 = -1, c = s/(2k) if b1 < 0, with the sine k of half the angle and s = |(b2, b3)|. */
/* B.4-1 */
static quat shortest_arc(quat q_SN, vec3 d)
{
    vec3 b = mul(dcm_of_quat(q_SN), d);
    double s = sqrt(b.y * b.y + b.z * b.z), k = sqrt((1 - b.x) / 2),
           c = sqrt(larger(0, 1 + b.x) / 2);
    if (b.x >= 0) return canonical((quat){c, 0, -b.z / (2 * c), b.y / (2 * c)});
    return s > 0 ? canonical((quat){s / (2 * k), 0, -b.z / s * k, b.y / s * k})
                 : (quat){0, 0, 1, 0};
}

/* B.4.3: required rate along the axis of L, limited to omega_max */
/* B.4-2 */
static vec3 required_rate(const Parameters *p, quat L)
{
    vec3 omega = scale(2 * p->k_q, vector_part(L));
    double size = norm(omega);
    if (p->omega_max > 0 && size > p->omega_max) return scale(p->omega_max / size, omega);
    return omega;
}

static void publish_pointing(const Parameters *p, quat q_SN, vec3 d, Output *y)
{
    y->q_DS = p->att ? shortest_arc(q_SN, d) : two_turns(q_SN, d);
    y->ref.q = canonical(product(q_SN, y->q_DS));
    y->ref.omega = required_rate(p, y->q_DS);
    y->ref.alpha = vec(0, 0, 0);
}

/* ---- velocity ---- */

/* B.4.4: required speed by range; the state `far` changes at range zeta1 in the first sample, later
 * at zeta1 + zhys or zeta1 - zhys */
/* B.4-3 */
static double scalar_speed(const Parameters *p, State *x, double range, double v_T)
{
    double width = x->started ? p->zhys : 0;
    if (range > p->zeta1 + width) x->far = 1;
    else if (range <= p->zeta1 - width) x->far = 0;
    if (x->far) return 2 * v_T;
    return range <= p->zeta2 || p->text_speed ? v_T : 0.5 * v_T;
}

/* B.4.5: true if the controller commands a translational engine, or the force of the thrusters
 * along X or -X is above 1 % of the nominal thrust */
/* B.4-5 */
static int is_burning(const Parameters *p, const Input *u)
{
    return u->translation_firing > 0 || u->F_S.x > 0.01 * p->main_thrust ||
           -u->F_S.x > 0.01 * p->brake_thrust;
}

/* B.4.5: changes the mode and returns the required direction of X. The tests follow one another, so
 * that the mode can change several times in one sample. */
/* B.4-4 */
static vec3 advance_mode(const Parameters *p, const Input *u, State *x, vec3 sight, vec3 e_v,
                         vec3 X, double t)
{
    vec3 d = sight;
    double error = norm(e_v);
    if (x->mode == COAST && error >= p->rho2) x->mode = ALIGN;
    if (x->mode == ALIGN && error < p->rho1) x->mode = COAST;
    if (x->mode == ALIGN) {
        d = direction(e_v, X);
        if (dot(d, X) < -0.01) d = neg(d); /* the brakes push along -X */
        if (dot(d, X) > cosine(p->alpha_fire) && norm(u->S.omega) < p->omega_fire) {
            x->mode = BURN;
            x->t_burn = t;
            x->d_burn = d;
        }
    }
    if (x->mode == BURN) {
        d = x->d_burn;
        if (!reached(x->t_burn + p->t_burn_min, t) && !is_burning(p, u) &&
            fabs(dot(e_v, X)) < p->rho2) {
            x->mode = COAST;
            d = sight;
        }
    }
    return d;
}

/* required closing speed s of law 1 */
/* B.4-6 */
static double closing_speed(const Parameters *p, double range, double v_T)
{
    double wanted = p->k_r * (range - p->zeta1);
    if (p->v_close > 0) return clamp(wanted, -p->v_close / 2, p->v_close);
    return clamp(wanted, -v_T, 2 * v_T);
}

/* sets the required velocity v_S = v_T + drho_ref: along X only (law 0), or in all three axes
 * (law 1); returns the required direction of X */
static vec3 require_velocity(const Parameters *p, const Input *u, State *x, Output *y, vec3 sight,
                             vec3 X, double t)
{
    double v_T = norm(sub(u->T.v, frame_velocity(p, t)));
    y->v_req = p->law ? closing_speed(p, y->range, v_T) : scalar_speed(p, x, y->range, v_T);
    y->ref.drho = p->law ? scale(y->v_req, sight) : sub(scale(y->v_req, X), u->T.v);
    y->e_v_N = add(sub(u->T.v, u->S.v), y->ref.drho);
    if (p->law) return advance_mode(p, u, x, sight, y->e_v_N, X, t);
    x->mode = BURN;
    return sight;
}

/* B.4-7 */
static void guide(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    quat q_SN = canonical(u->S.q);
    vec3 dr = sub(u->T.r, u->S.r), X = dcm_of_quat(q_SN).row[0], sight = direction(dr, X);
    y->range = norm(dr);
    y->pointing_angle = angle(X, dr);
    y->ref.rho = scale(-p->zeta1, sight);
    y->ref.ddrho = vec(0, 0, 0);
    publish_pointing(p, q_SN, require_velocity(p, u, x, y, sight, X, t), y);
    x->started = 1;
    y->mode = x->mode;
    y->translate = x->mode == BURN;
}

static const State none = {.mode = COAST};

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    State first = *x = none;
    guide(p, u, &first, y, t);
    if (!u->active) y->translate = 0;
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    for (Sample s = first_sample(t, h, p->sample_period); s.left > 0; s = next_sample(s)) {
        if (u->active) guide(p, u, x, y, s.t);
        else initialize(p, u, x, y, s.t);
    }
}

FMU_MODEL("pursuit_guidance",
          "Pursuit guidance for a body-fixed thrust axis: pointing, speed, coast, align and burn");
