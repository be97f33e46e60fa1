/* mission_ports.h - phases, parameters and inputs of the mission manager, and the relative state
 * by which the manager decides when to leave a phase. */
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
    double by_arm, momentum_max, mass_T; /* momentum_max: angular, of both bodies at mating */
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

#define MISSION_PARAMETERS                                                                        \
    NONNEGATIVE(mu, "m3/s2", "gravitational parameter of the planet; 0 = deep space"),            \
        PARAMETER(p_T, "1",                                                                       \
                  "grasp axis: unit vector from the target's centre of mass to the grasp point, " \
                  "target axes"),                                                                 \
        PARAMETER(line_angle, "rad",                                                              \
                  "angle of the line of hold points, from x (outward) to y (along track) of H"),  \
        POSITIVE(R_1, "m", "range of the first hold"),                                            \
        POSITIVE(R_2, "m",                                                                        \
                 "range of the second hold, and of the fly-around if budget = 0 (else R_around "  \
                 "to R_2)"),                                                                      \
        POSITIVE(                                                                                 \
            L_3, "m",                                                                             \
            "distance of the third hold from the target's centre of mass, along the grasp axis"), \
        POSITIVE(L_end, "m",                                                                      \
                 "commanded distance at the end of mating; set below the distance with the "      \
                 "probe seated"),                                                                 \
        NONNEGATIVE(                                                                              \
            tol_1, "m",                                                                           \
            "range tolerance about R_1 to begin hold 1; twice this to leave it for the closing"), \
        POSITIVE(v_1, "m/s", "largest speed to begin the first hold, as seen in H"),              \
        NONNEGATIVE(tol_2, "m",                                                                   \
                    "position tolerance at the second hold, range tolerance at the end of the "   \
                    "fly-around"),                                                                \
        POSITIVE(v_2, "m/s",                                                                      \
                 "largest speed at the second hold, seen in H, and at the end of the "            \
                 "fly-around, seen in T"),                                                        \
        NONNEGATIVE(angle_2, "rad",                                                               \
                    "largest angle off the grasp axis at the end of the fly-around"),             \
        NONNEGATIVE(tol_3, "m", "position tolerance at the third hold, along and off the axis"),  \
        POSITIVE(v_3, "m/s", "largest speed at the third hold, as seen in T"),                    \
        NONNEGATIVE(angle_3, "rad",                                                               \
                    "largest pointing error (angle from +X of S to -p_T) at the third hold"),     \
        NONNEGATIVE(rate_3, "rad/s", "largest rate relative to the target at the third hold"),    \
        POSITIVE(v_final, "m/s",                                                                  \
                 "peak speed of the final approach, and of backing off to the fly-around"),       \
        POSITIVE(v_mate, "m/s", "speed of mating"),                                               \
        NONNEGATIVE(ramp_mate, "s", "time to reach v_mate"),                                      \
        POSITIVE(v_back, "m/s",                                                                   \
                 "peak speed of backing off to hold 3, and of the change of range in the "        \
                 "fly-around"),                                                                   \
        NONNEGATIVE(capture_time, "s",                                                            \
                    "time from first contact after which an attempt has failed"),                 \
        NONNEGATIVE(settle_rate, "rad/s",                                                         \
                    "largest angular rate at which the stack counts as at rest"),                 \
        POSITIVE(v_retreat, "m/s", "speed of the retreat away from the target, as seen in H"),    \
        POSITIVE(                                                                                 \
            v_drift, "m/s",                                                                       \
            "speed of the retreat along +-y of H; the sign with the larger clearance is chosen"), \
        POSITIVE(F_retreat, "N", "magnitude of the force during the retreat"),                    \
        NONNEGATIVE(R_safe, "m", "the retreat is over beyond this range"),                        \
        NONNEGATIVE(drift_time, "s", "time for which the drift after a retreat is predicted"),    \
        POSITIVE(drift_step, "s", "step of the predicted drift"),                                 \
        NONNEGATIVE(dwell, "s",                                                                   \
                    "time for which the condition to leave a phase must hold; elements: "         \
                    "phases 0 to 14"),                                                            \
        NONNEGATIVE(time_out, "s",                                                                \
                    "time after which a retreat or back-off ends a phase; 0 = never; elements: "  \
                    "phases 0 to 14, used: 0 to 7, 11"),                                          \
        NONNEGATIVE(attempts, "1", "attempts to mate before the retreat"),                        \
        NONNEGATIVE(mass_dry, "kg", "mass of the servicer without propellant"),                   \
        NONNEGATIVE(reserve, "kg", "propellant below which the servicer retreats"),               \
        NONNEGATIVE(nav_far, "s",                                                                 \
                    "time without a valid state that leads to a retreat from phases 0 to 4"),     \
        NONNEGATIVE(nav_near, "s",                                                                \
                    "as nav_far, for phases 5 to 7 and 11, which are on the grasp axis"),         \
        NONNEGATIVE(d_abort, "m",                                                                 \
                    "largest distance off the grasp axis in phases 5 to 7, 11; elements: up to "  \
                    "L_3, rise per m beyond"),                                                    \
        NONNEGATIVE(angle_abort, "rad",                                                           \
                    "pointing error above which the servicer retreats from phases 5 to 7, 11, "   \
                    "and phase 4 does not end"),                                                  \
        NONNEGATIVE(error_dwell, "s",                                                             \
                    "time above d_abort or angle_abort that leads to a retreat"),                 \
        NONNEGATIVE(v_0, "m/s",                                                                   \
                    "speed limit at range 0, as seen in H; elements: phases 0 to 4; phases 5 to " \
                    "7 and 11"),                                                                  \
        NONNEGATIVE(v_slope, "1/s",                                                               \
                    "rise of the speed limit with range, elements as v_0; in phases 4 to 7, 11 "  \
                    "plus the tumble rate"),                                                      \
        NONNEGATIVE(tumble_max, "rad/s", "largest tumble rate that is added to v_slope"),         \
        NONNEGATIVE(speed_dwell, "s", "time above the speed limit that leads to a retreat"),      \
        SWITCH(by_arm,                                                                            \
               "1: mating is by the arm, which grasps from the third hold; 0: by the probe"),     \
        NONNEGATIVE(momentum_max, "N.m.s",                                                        \
                    "largest value of output momentum for mating, and, with budget > 0, of its "  \
                    "prediction at hold 2; 0 = no limit"),                                        \
        NONNEGATIVE(budget, "1",                                                                  \
                    "share (0 to 1) of F_axis and wheel_speed_max for turning with the target; "  \
                    "0: no limits, no wheel bias"),                                               \
        POSITIVE(F_axis, "N",                                                                     \
                 "available force on the servicer along its +X, which points to the target in "   \
                 "the fly-around"),                                                               \
        POSITIVE(R_around, "m", "least range of the fly-around (needs budget > 0)"),              \
        NONNEGATIVE(w_steer, "rad/s",                                                             \
                    "largest rate of steering about the target in the fly-around"),               \
        NONNEGATIVE(steer_least, "rad/s",                                                         \
                    "capture only if thrust permits this rate of steering about the target "      \
                    "(needs budget > 0)"),                                                        \
        NONNEGATIVE(rate_2, "rad/s",                                                              \
                    "largest angular rate relative to the target at the end of the fly-around; "  \
                    "0: no limit"),                                                               \
        NONNEGATIVE(rate_probe, "rad/s",                                                          \
                    "largest tumble rate for mating by probe (needs budget > 0); 0 = no limit"),  \
        POSITIVE(Isp, "s", "specific impulse of the thrusters"),                                  \
        MATRIX(A_w, "kg.m2",                                                                      \
               "wheel inertia matrix: wheel speeds to wheel momentum in servicer axes"),          \
        POSITIVE(wheel_speed_max, "rad/s", "largest wheel speed, per wheel"),                     \
        NONNEGATIVE(bias_max, "1",                                                                \
                    "largest wheel bias as a share of wheel_speed_max; should be below "          \
                    "unload_on of command_selector"),                                             \
        NONNEGATIVE(bias_tol, "1",                                                                \
                    "largest deviation of a wheel from its bias before the fly-around, as a "     \
                    "share of wheel_speed_max"),                                                  \
        NONNEGATIVE(mass_T, "kg", "mass of the target as known to the software"),                 \
        MATRIX(J_T, "kg.m2", "inertia of the target as known to the software, target axes"),      \
        MATRIX(J_S, "kg.m2",                                                                      \
               "inertia of the servicer with wheels, as known to the software, servicer axes"),   \
        NONNEGATIVE(await_axis, "rad",                                                            \
                    "turning with T begins when the grasp axis is within this of its least "      \
                    "angle to the servicer; 0: at once"),                                         \
        POSITIVE(                                                                                 \
            spin_time, "s",                                                                       \
            "duration of the change from turning with H to turning with T, as in sync_guidance"), \
        NONNEGATIVE(spin_accel, "rad/s2",                                                         \
                    "largest acceleration of the change to turning with T; 0: no limit"),         \
        SWITCH(use_optimal,                                                                       \
               "1: the fuel-optimal law commands the force in phases far to hold 2, and in "      \
               "fly-around to hold 3 if the range of the fly-around is R_2"),                     \
        POSITIVE(far_time, "s", "duration of the fuel-optimal far approach, at most 1200 s"),     \
        SWITCH(abort_relative,                                                                    \
               "1: the retreat is planned with the last valid state propagated to now, along "    \
               "the grasp axis up to axis_radius; 0: state not propagated, axis not used"),       \
        NONNEGATIVE(                                                                              \
            axis_radius, "m",                                                                     \
            "range up to which a retreat from phases 5 to 7 or 11 follows the grasp axis"),       \
        NONNEGATIVE(aim_radius, "m",                                                              \
                    "the closing aims along a tangent of a sphere of this radius about the "      \
                    "target until R_2 + 1 m; 0: at hold 2"),                                      \
        SWITCH(monitor_stack, "value of monitor_valid in phases 8 to 10; 1: the monitor may "     \
                              "abort, which ends none of them, but its force acts"),              \
        GRID(sample_period, "sample period of the software")

#define MISSION_INPUTS                                                                           \
    BODY_INPUTS("T", T, "target"), BODY_INPUTS("S", S, "servicer"),                              \
        NONNEGATIVE_INPUT(mass, "kg", "mass of the servicer, as measured"),                      \
        INPUT(relative_valid, "1", "1: the states of target and servicer are valid"),            \
        INPUT(abort, "1", "1: the safety monitor has ordered an abort"),                         \
        INPUT(retreat, "1", "1: ground orders the retreat"),                                     \
        INPUT(resume, "1", "1: ground permits a new far approach from phase safe"),              \
        INPUT(go_1, "1", "1: go for the closing"), INPUT(go_2, "1", "1: go for the fly-around"), \
        INPUT(go_3, "1", "1: go for mating"),                                                    \
        INPUT(contact, "1", "1: the docking mechanism has contact"),                             \
        INPUT(soft, "1", "1: soft capture"), INPUT(hard, "1", "1: hard capture"),                \
        INPUT(done, "1", "1: the guidance of the stack has finished its profile"),               \
        OPTIONAL_INPUT(wheel_speed, "rad/s",                                                     \
                       "wheel speeds relative to the body; used if budget > 0")

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
    vec3 rho_H, drho_H; /* drho: time derivative of rho as seen in H */
    /* range; distances along and off the grasp axis a; angle from a to rho; speed as seen in T;
     * angle from X_S to -a; relative rate */
    double R, l, d, los, v_rel, pointing, w_rel;
    double momentum; /* angular momentum of both bodies about their centre of mass, wheels locked */
    double tumble;   /* |w_T| */
    vec3 w_mean_S;   /* mean of w_T over a nutation, servicer axes */
    vec3 w_T, a;     /* rate of the target and grasp axis, N axes */
    vec3 rho;        /* N axes */
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
