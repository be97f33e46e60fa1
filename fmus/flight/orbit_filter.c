/* orbit_filter.c - extended Kalman filter: position and velocity of the servicer from fixes,
 * which are measurements of both.
 *
 *   dr/dt = v,   dv/dt = gravity with J2 + C_SN^T F_cmd_S/mass_hat,   white acceleration sigma_a
 *
 * The input F_cmd_S at a sample is the command that was held since the previous sample; it is
 * applied with the attitude at the previous sample. A late fix is propagated to the present by one
 * step without thrust. Equations: docs/models.md F.5. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "covariance.h"
#include "measurements.h"
#include "orbit_rows.h"
#include "rk4.h"

enum { R_AT = 0, V_AT = 3, STATES = 6 };

typedef struct {
    Orbit orbit;
    vec3 r_0_N, v_0_N, rho_0_H, drho_0_H;
    double sample_period, use_J2, mass_hat, sigma_a, sigma_fix_r, sigma_fix_v, sigma_r_0, sigma_v_0;
    GateParameters gate;
} Parameters;
typedef struct {
    vec3 r_fix_N, v_fix_N;
    double fix_time, fix_valid;
    quat q_SN;
    vec3 F_cmd_S;
} Input;
typedef struct {
    PosVel s;
    double P[STATES * STATES];
} Estimate;
typedef struct {
    Estimate hat;
    double started, index; /* index: number of the last sample */
    quat q;                /* q_SN at the last sample */
    Track fix;
} State;
typedef struct {
    vec3 r_SN_N, v_SN_N, sigma_r_N, sigma_v_N;
    double fix_nis, fix_rejected, fix_age, orbit_valid;
} Output;
MODEL_STRUCT;

static const Model start = {
    .p = {.orbit = START_ORBIT,
          .sample_period = 0.1,
          .use_J2 = 1,
          .mass_hat = 95,
          .sigma_a = 1e-4,
          .sigma_fix_r = 5,
          .sigma_fix_v = 0.05,
          .sigma_r_0 = 100,
          .sigma_v_0 = 0.1,
          .gate = {.gate = 22.46, .reset_after = 10, .age_max = 100, .acquire = 1}},
    .u = {.fix_time = -1, .q_SN = {1, 0, 0, 0}},
};

static const Variable variables[] = {
    ORBIT_ROWS(orbit),
    PARAMETER(r_0_N, "m", "position at the start in N axes, used if parameter a = 0"),
    PARAMETER(v_0_N, "m/s", "velocity at the start in N axes, used if parameter a = 0"),
    PARAMETER(rho_0_H, "m",
              "start position relative to the start point of the orbit, Hill axes, used if "
              "parameter a > 0"),
    PARAMETER(drho_0_H, "m/s",
              "start velocity relative to the start point of the orbit, as seen in H, used if "
              "parameter a > 0"),
    GRID(sample_period, "sample period of the software"),
    SWITCH(use_J2, "1: the software models the oblateness of the planet"),
    POSITIVE(mass_hat, "kg", "mass of the servicer as known to the software"),
    NONNEGATIVE(sigma_a, "1", "density of white acceleration noise, per axis, in m/s^1.5"),
    NONNEGATIVE(sigma_fix_r, "m", "standard deviation of the position noise of a fix, per axis"),
    NONNEGATIVE(sigma_fix_v, "m/s", "standard deviation of the velocity noise of a fix, per axis"),
    NONNEGATIVE(sigma_r_0, "m", "standard deviation of the position at the start, per axis"),
    NONNEGATIVE(sigma_v_0, "m/s", "standard deviation of the velocity at the start, per axis"),
    GATE_ROWS(gate),

    INPUT(r_fix_N, "m", "measured position of the servicer, N axes"),
    INPUT(v_fix_N, "m/s", "measured velocity of the servicer, N axes"),
    INPUT(fix_time, "s", "time at which the fix was taken"),
    INPUT(fix_valid, "1", "1: a fix was taken at fix_time"),
    INPUT(q_SN, "1", "estimated attitude of the servicer relative to N, scalar first"),
    INPUT(F_cmd_S, "N", "force commanded from the previous sample to this one, body axes"),

    OUTPUT(r_SN_N, "m", "position of the servicer, N axes"),
    OUTPUT(v_SN_N, "m/s", "velocity of the servicer, N axes"),
    NONNEGATIVE_OUTPUT(sigma_r_N, "m", "standard deviation of the position, N axes"),
    NONNEGATIVE_OUTPUT(sigma_v_N, "m/s", "standard deviation of the velocity, N axes"),
    NONNEGATIVE_OUTPUT(fix_nis, "1", "normalised innovation squared of the last fix"),
    NONNEGATIVE_OUTPUT(fix_rejected, "1", "fixes rejected since the start"),
    OUTPUT(fix_age, "s", "time since fix_time of the last fix used; before the first: t + 1 s"),
    FLAG(orbit_valid, "1: acquired, a fix has been used, and fix_age is at most age_max"),
};

/* F.5-7 */
static void check(const Parameters *p, Problems *problems)
{
    check_orbit(problems, &p->orbit, p->r_0_N);
}

/* ---- propagation ---- */
typedef struct {
    const Parameters *p;
    vec3 thrust_N; /* acceleration by thrust [m/s2] */
} Dynamics;

static void derivative(const Dynamics *f, double t, const PosVel *s, PosVel *ds)
{
    (void)t;
    *ds = (PosVel){s->v, add(gravity(&f->p->orbit, f->p->use_J2, s->r), f->thrust_N)};
}

RK4(integrate, derivative, Dynamics, PosVel)

static PosVel propagated(const Parameters *p, PosVel s, vec3 thrust_N, double h)
{
    const Dynamics context = {p, thrust_N};
    integrate(&context, 0, h, &s);
    return s;
}

/* Phi - I = A T + A^2 T^2/2,   A = [0 I; G 0] */
static void transition(const Parameters *p, vec3 r, double *F)
{
    double T = p->sample_period;
    mat3 G = gravity_gradient_matrix(p->orbit.mu, r);
    put_block(F, STATES, R_AT, R_AT, scaled(T * T / 2, G));
    put_block(F, STATES, R_AT, V_AT, identity(T));
    put_block(F, STATES, V_AT, R_AT, scaled(T, G));
    put_block(F, STATES, V_AT, V_AT, scaled(T * T / 2, G));
}

/* F.5-5 */
static void propagate(const Parameters *p, Estimate *hat, vec3 thrust_N)
{
    double F[STATES * STATES];
    transition(p, hat->s.r, F);
    hat->s = propagated(p, hat->s, thrust_N, p->sample_period);
    propagate_covariance(hat->P, F, STATES, STATES);
    add_white_acceleration(hat->P, STATES, R_AT, V_AT, p->sigma_a * p->sigma_a, p->sample_period);
    symmetrise(hat->P, STATES);
}

/* ---- fixes ---- */
static mat3 squared(double sigma) { return identity(sigma * sigma); }

static double update(Estimate *hat, size_t at, vec3 y, double sigma)
{
    double dx[STATES];
    Residual m = {.y = y, .R = squared(sigma), .count = 1};
    m.block[0].at = at;
    m.block[0].H = identity(1);
    double nis = update_covariance(hat->P, STATES, &m, dx);
    hat->s.r = add(hat->s.r, three(dx + R_AT));
    hat->s.v = add(hat->s.v, three(dx + V_AT));
    return nis;
}

/* F.5-2 */
static double update_both(const Parameters *p, Estimate *hat, PosVel fix)
{
    double nis = update(hat, R_AT, sub(fix.r, hat->s.r), p->sigma_fix_r);
    return nis + update(hat, V_AT, sub(fix.v, hat->s.v), p->sigma_fix_v);
}

static Estimate estimate_of(PosVel s, double sigma_r, double sigma_v)
{
    Estimate hat = {.s = s};
    put_block(hat.P, STATES, R_AT, R_AT, squared(sigma_r));
    put_block(hat.P, STATES, V_AT, V_AT, squared(sigma_v));
    return hat;
}

/* F.5-1, F.5-3 */
static void use_fix(const Parameters *p, const Input *u, State *x, double k)
{
    x->fix.last = u->fix_time;
    double late = k - nearest_whole(u->fix_time / p->sample_period);
    if (late < 0 || late >= HISTORY) return;
    PosVel fix = {u->r_fix_N, u->v_fix_N};
    if (late > 0) fix = propagated(p, fix, vec(0, 0, 0), late * p->sample_period);
    Estimate copy = x->hat;
    Decision verdict =
        x->fix.acquired ? decide(&p->gate, &x->fix, update_both(p, &copy, fix)) : ACQUISITION;
    if (verdict == REJECTED) return;
    note_used(&x->fix, u->fix_time);
    if (verdict == ACCEPTED) {
        x->hat = copy;
    } else {
        x->hat = estimate_of(fix, p->sigma_fix_r, p->sigma_fix_v);
        note_acquired(&x->fix);
    }
}

/* ---- sampling ---- */
static State start_state(const Parameters *p)
{
    PosVel s = p->orbit.a > 0 ? posvel_beside(&p->orbit, p->rho_0_H, p->drho_0_H)
                              : (PosVel){p->r_0_N, p->v_0_N};
    return (State){.q = {1, 0, 0, 0},
                   .fix = new_track(&p->gate, -1),
                   .hat = estimate_of(s, p->sigma_r_0, p->sigma_v_0)};
}

static void publish(const Parameters *p, const State *x, Output *y, double t)
{
    y->r_SN_N = x->hat.s.r;
    y->v_SN_N = x->hat.s.v;
    y->sigma_r_N = sigma_at(x->hat.P, STATES, R_AT);
    y->sigma_v_N = sigma_at(x->hat.P, STATES, V_AT);
    y->fix_nis = x->fix.nis;
    y->fix_rejected = x->fix.rejected;
    y->fix_age = age(&x->fix, t);
    y->orbit_valid = is_valid(&p->gate, &x->fix, t);
}

/* F.5-4 */
static void filter(const Parameters *p, const Input *u, State *x, Output *y, Sample s)
{
    if (!x->started) {
        *x = start_state(p);
        x->started = 1;
        x->index = s.index;
    }
    vec3 thrust_N = scale(1 / p->mass_hat, tmul(dcm_of_quat(x->q), u->F_cmd_S));
    for (; x->index < s.index; x->index++) propagate(p, &x->hat, thrust_N);
    x->q = canonical(u->q_SN);
    if (is_new(&x->fix, u->fix_time, u->fix_valid)) use_fix(p, u, x, s.index);
    publish(p, x, y, s.t);
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    (void)u;
    *x = start_state(p);
    publish(p, x, y, t);
}

/* F.5-6 */
static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    for (Sample s = first_sample(t, h, p->sample_period); s.left > 0; s = next_sample(s))
        filter(p, u, x, y, s);
}

FMU_MODEL("orbit_filter", "Position and velocity of the servicer by an extended Kalman filter");
