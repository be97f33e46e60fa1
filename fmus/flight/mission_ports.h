/* mission_ports.h - phases, parameters and inputs of the mission manager, and the relative state
 * that its conditions refer to. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef MISSION_PORTS_H
#define MISSION_PORTS_H

#include "body_rows.h"
#include "directions.h"
#include "orbit.h"
#include "rigid_body.h"
#include "time_grid.h"

enum {
    FAR,
    HOLD_1,
    CLOSING,
    HOLD_2,
    FLYAROUND,
    FINAL,
    HOLD_3,
    MATING,
    RIGIDISE,
    DETUMBLE,
    STACK,
    BACKOFF,
    RETREAT,
    SAFE,
    ABORTED,
    PHASES
};

typedef struct {
    double mu;
    vec3 p_T;
    double line_angle;
    double R_1, R_2, L_3, L_end;
    double tol_1, v_1, tol_2, v_2, angle_2, tol_3, v_3, angle_3, rate_3;
    double v_final, v_mate, ramp_mate, v_back, capture_time, settle_rate;
    double v_retreat, v_drift, F_retreat, R_safe, drift_time, drift_step;
    double dwell[PHASES], time_out[PHASES];
    double attempts, mass_dry, reserve, nav_far, nav_near;
    double d_abort[2], angle_abort, error_dwell, v_0[2], v_slope[2], tumble_max, speed_dwell;
    double budget, F_axis, R_around, w_steer, steer_least, rate_2, rate_probe, Isp;
    mat3 A_w;
    double wheel_speed_max, bias_max, bias_tol;
    double await_axis, spin_time, spin_accel, use_optimal, far_time;
    double by_arm, momentum_max, mass_T; /* momentum_max: limit at the grasp [N m s] */
    mat3 J_T, J_S;
    double abort_relative, axis_radius, aim_radius, monitor_stack;
    double sample_period;
} MissionParameters;
typedef struct {
    Body T, S;
    double mass, relative_valid, abort, retreat, resume, go_1, go_2, go_3;
    double contact, soft, hard, done;
    vec3 wheel_speed;
} MissionInput;

#define MISSION_PARAMETERS                                                                         \
    NONNEGATIVE(mu, "m3/s2", "gravitational parameter of the planet; 0 = deep space"),             \
        PARAMETER(p_T, "1", "unit vector from the target to the grasp point, target axes"),        \
        PARAMETER(line_angle, "rad",                                                               \
                  "line of the hold points, from x (outward) towards y (along track) of H"),       \
        POSITIVE(R_1, "m", "range of the first hold"),                                             \
        POSITIVE(R_2, "m", "range of the second hold and of the fly-around"),                      \
        POSITIVE(L_3, "m", "third hold, on the grasp axis"),                                       \
        POSITIVE(L_end, "m", "distance at the end of mating, behind the seat"),                    \
        NONNEGATIVE(tol_1, "m", "tolerance of R_1; in the first hold twice as much"),              \
        POSITIVE(v_1, "m/s", "largest speed at R_1, as seen in H"),                                \
        NONNEGATIVE(tol_2, "m", "tolerance at R_2"),                                               \
        POSITIVE(v_2, "m/s", "largest speed at R_2: as seen in H, after the fly-around in T"),     \
        NONNEGATIVE(angle_2, "rad", "the fly-around ends this close to the grasp axis"),           \
        NONNEGATIVE(tol_3, "m", "tolerance at L_3, along and off the axis"),                       \
        POSITIVE(v_3, "m/s", "largest speed at L_3, as seen in T"),                                \
        NONNEGATIVE(angle_3, "rad", "largest pointing error at L_3"),                              \
        NONNEGATIVE(rate_3, "rad/s", "largest relative rate at L_3"),                              \
        POSITIVE(v_final, "m/s", "peak speed of the final approach"),                              \
        POSITIVE(v_mate, "m/s", "speed of mating"),                                                \
        NONNEGATIVE(ramp_mate, "s", "time to reach v_mate"),                                       \
        POSITIVE(v_back, "m/s",                                                                    \
                 "peak speed of backing off, and of the change of range in the fly-around"),       \
        NONNEGATIVE(capture_time, "s", "an attempt has failed this long after its first contact"), \
        NONNEGATIVE(settle_rate, "rad/s", "largest rate of a stack at rest"),                      \
        POSITIVE(v_retreat, "m/s", "speed of the retreat outwards"),                               \
        POSITIVE(v_drift, "m/s", "speed of the retreat along the track"),                          \
        POSITIVE(F_retreat, "N", "force of the retreat"),                                          \
        NONNEGATIVE(R_safe, "m", "the retreat is over beyond this range"),                         \
        NONNEGATIVE(drift_time, "s", "time for which the drift after a retreat is predicted"),     \
        POSITIVE(drift_step, "s", "step of the predicted drift"),                                  \
        NONNEGATIVE(dwell, "s", "time that the condition of a phase must hold; phases 0 to 14"),   \
        NONNEGATIVE(time_out, "s", "longest duration of a phase; 0 = none; phases 0 to 14"),       \
        NONNEGATIVE(attempts, "1", "attempts to mate before the retreat"),                         \
        NONNEGATIVE(mass_dry, "kg", "mass of the servicer without propellant"),                    \
        NONNEGATIVE(reserve, "kg", "propellant below which the servicer retreats"),                \
        NONNEGATIVE(nav_far, "s", "longest time without a valid state, phases 0 to 4"),            \
        NONNEGATIVE(nav_near, "s", "longest time without a valid state, phases 5, 6, 7, 11"),      \
        NONNEGATIVE(d_abort, "m",                                                                  \
                    "largest distance off the grasp axis, phases 5, 6, 7, 11: at L_3 (m), and "    \
                    "its rise with the distance beyond L_3 (m/m)"),                                \
        NONNEGATIVE(angle_abort, "rad", "largest pointing error, phase 4 (end), 5, 6, 7, 11"),     \
        NONNEGATIVE(error_dwell, "s", "time above d_abort or angle_abort until a retreat"),        \
        NONNEGATIVE(v_0, "m/s", "speed limit at range 0: phases 0 to 4; phases 5, 6, 7, 11"),      \
        NONNEGATIVE(v_slope, "1/s",                                                                \
                    "rise of the speed limit with the range, as v_0; in phases 4, 5, 6, 7, 11 "    \
                    "the tumble rate is added"),                                                   \
        NONNEGATIVE(tumble_max, "rad/s", "largest tumble rate that is added to v_slope"),          \
        NONNEGATIVE(speed_dwell, "s", "time above the speed limit until a retreat"),               \
        SWITCH(by_arm, "1: mating is by the arm, which grasps from L_3; 0: by the probe"),         \
        NONNEGATIVE(momentum_max, "N.m.s",                                                         \
                    "largest angular momentum of both bodies for the mating; 0 = no limit"),       \
        NONNEGATIVE(budget, "1",                                                                   \
                    "share of force and of wheels that turning with the target may take; 0: "      \
                    "nothing is planned"),                                                         \
        POSITIVE(F_axis, "N", "thrust along +X, towards the target in the fly-around"),            \
        POSITIVE(R_around, "m", "least range of the fly-around, with budget"),                     \
        NONNEGATIVE(w_steer, "rad/s", "largest rate of the steering of the fly-around"),           \
        NONNEGATIVE(steer_least, "rad/s",                                                          \
                    "least steering that the force must permit for a capture"),                    \
        NONNEGATIVE(rate_2, "rad/s", "largest relative rate after the fly-around; 0: any"),        \
        NONNEGATIVE(rate_probe, "rad/s",                                                           \
                    "largest tumble rate at which the probe mates; 0 = no limit"),                 \
        POSITIVE(Isp, "s", "specific impulse of the thrusters"),                                   \
        MATRIX(A_w, "kg.m2", "inertia of the wheels about their axes, servicer axes"),             \
        POSITIVE(wheel_speed_max, "rad/s", "largest wheel speed, per wheel"),                      \
        NONNEGATIVE(bias_max, "1",                                                                 \
                    "largest bias of the wheels before the fly-around, share of "                  \
                    "wheel_speed_max; below the level at which they are unloaded"),                \
        NONNEGATIVE(bias_tol, "1",                                                                 \
                    "the fly-around begins with the wheels this close to their bias, share of "    \
                    "wheel_speed_max"),                                                            \
        NONNEGATIVE(mass_T, "kg", "mass of the target as known to the software"),                  \
        MATRIX(J_T, "kg.m2", "inertia of the target as known to the software, target axes"),       \
        MATRIX(J_S, "kg.m2", "inertia of the servicer as known to the software, servicer axes"),   \
        NONNEGATIVE(await_axis, "rad",                                                             \
                    "the servicer begins to turn with the target when its angle from the grasp "   \
                    "axis is above the least one by at most this; 0: at once"),                    \
        POSITIVE(spin_time, "s", "time to turn with the target instead of H, as in guidance"),     \
        NONNEGATIVE(spin_accel, "rad/s2", "largest acceleration, extends spin_time; 0: no limit"), \
        SWITCH(use_optimal, "1: the fuel-optimal law commands the force from far to hold 3"),      \
        POSITIVE(far_time, "s", "duration of the fuel-optimal far approach, at most 1200 s"),      \
        SWITCH(abort_relative,                                                                     \
               "1: the retreat leaves from the last valid state after its drift until now, and "   \
               "along the grasp axis near the target; 0: from the last valid state, outwards"),    \
        NONNEGATIVE(                                                                               \
            axis_radius, "m",                                                                      \
            "within this range, in phases 5, 6, 7, 11, the retreat leaves along the axis"),        \
        NONNEGATIVE(aim_radius, "m",                                                               \
                    "the closing aims along a tangent of this sphere until it is near R_2; 0: at " \
                    "the hold"),                                                                   \
        SWITCH(monitor_stack,                                                                      \
               "1: the safety monitor uses the state from soft capture on, too; 0: not in phases " \
               "8 to 10, where its abort is not obeyed"),                                          \
        GRID(sample_period, "sample period of the software")

#define MISSION_INPUTS                                                                           \
    BODY_INPUTS("T", T, "target"), BODY_INPUTS("S", S, "servicer"),                              \
        NONNEGATIVE_INPUT(mass, "kg", "mass of the servicer, as measured"),                      \
        INPUT(relative_valid, "1", "1: the states can be relied on"),                            \
        INPUT(abort, "1", "1: the safety monitor has taken over"),                               \
        INPUT(retreat, "1", "1: ground orders the retreat"),                                     \
        INPUT(resume, "1", "1: ground lets a servicer that drifts safely resume"),               \
        INPUT(go_1, "1", "1: go for the closing"), INPUT(go_2, "1", "1: go for the fly-around"), \
        INPUT(go_3, "1", "1: go for mating"),                                                    \
        INPUT(contact, "1", "1: the mechanism feels contact"),                                   \
        INPUT(soft, "1", "1: soft capture"), INPUT(hard, "1", "1: hard capture"),                \
        INPUT(done, "1", "1: the guidance of the stack has come to its end"),                    \
        OPTIONAL_INPUT(wheel_speed, "rad/s", "wheel speeds relative to the body, with budget")

/* ---- checks of parameters ---- */
static inline void check_below(Problems *problems, const char *name, double value, double limit,
                               const char *rule)
{
    if (!(value < limit)) reject(problems, name, value, rule);
}

static inline void check_between(Problems *problems, const MissionParameters *p)
{
    if (p->budget == 0 || (p->R_around > p->L_3 && p->R_around <= p->R_2)) return;
    reject(problems, "R_around", p->R_around, "must be above L_3 and not above R_2");
}

static inline void check_mission(const MissionParameters *p, Problems *problems)
{
    check_unit_vector(problems, "p_T", p->p_T);
    check_inertia(problems, "J_T", p->J_T);
    check_inertia(problems, "J_S", p->J_S);
    check_below(problems, "R_2", p->R_2, p->R_1, "must be below R_1");
    check_below(problems, "L_3", p->L_3, p->R_2, "must be below R_2");
    check_between(problems, p);
    check_positive_definite(problems, "A_w", p->A_w);
    check_positive_definite(problems, "J_S - A_w", minus(p->J_S, p->A_w));
    if (p->budget > 1) reject(problems, "budget", p->budget, "must not be above 1");
    check_below(problems, "L_end", p->L_end, p->L_3, "must be below L_3");
    check_below(problems, "aim_radius", p->aim_radius, p->R_2, "must be below R_2");
    if (p->drift_time > 1e5 * p->drift_step)
        reject(problems, "drift_step", p->drift_step, "must not be below drift_time / 1e5");
}

/* ---- relative state ---- */
typedef struct {
    HillFrame H;
    mat3 C_SN;
    vec3 rho_H, drho_H; /* drho as seen in H */
    /* range; distances along and off the grasp axis a; angle from a to rho; speed as seen in T;
     * angle from X_S to -a; relative rate */
    double R, l, d, los, v_rel, pointing, w_rel;
    double
        momentum;  /* angular momentum of both bodies about their centre of mass, without wheels */
    double tumble; /* |w_T| */
    vec3 w_mean_S; /* mean of w_T over a nutation, servicer axes */
    vec3 w_T, a;   /* rate of the target and grasp axis, N axes */
    vec3 rho;      /* N axes */
} Geometry;

/* mean over a nutation of the rate w of a free body: its component along the constant angular
 * momentum h */
static inline vec3 mean_rate(vec3 w, vec3 h)
{
    double square = dot(h, h);
    return square > 0 ? scale(dot(w, h) / square, h) : h;
}

static inline Geometry geometry(const MissionParameters *p, const MissionInput *u)
{
    Geometry g = {.H = hill_frame(p->mu, u->T.r, u->T.v), .C_SN = dcm_of_quat(canonical(u->S.q))};
    mat3 C_TN = dcm_of_quat(canonical(u->T.q));
    vec3 rho = sub(u->S.r, u->T.r), v = sub(u->S.v, u->T.v), a = tmul(C_TN, p->p_T);
    vec3 w_T = tmul(C_TN, u->T.omega), w_S = tmul(g.C_SN, u->S.omega);

    g.rho_H = mul(g.H.C_HN, rho);
    g.drho_H = rate_in_frame(&g.H, g.rho_H, mul(g.H.C_HN, v));
    g.R = norm(rho);
    g.l = dot(rho, a);
    g.d = norm(sub(rho, scale(g.l, a)));
    g.los = angle(rho, a);
    g.v_rel = norm(sub(v, cross(w_T, rho)));
    g.pointing = angle(g.C_SN.row[0], neg(a));
    g.w_rel = norm(sub(w_S, w_T));
    g.tumble = norm(w_T);
    g.w_T = w_T;
    g.a = a;
    g.rho = rho;
    double reduced = u->mass > 0 ? u->mass * p->mass_T / (u->mass + p->mass_T) : 0;
    vec3 h_T = tmul(C_TN, mul(p->J_T, u->T.omega)), h_S = tmul(g.C_SN, mul(p->J_S, u->S.omega));
    g.w_mean_S = mul(g.C_SN, mean_rate(w_T, h_T));
    g.momentum = norm(sum3(h_T, h_S, scale(reduced, cross(rho, v))));
    return g;
}

#endif
