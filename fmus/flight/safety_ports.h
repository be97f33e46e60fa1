/* safety_ports.h - parameters and inputs of the safety monitor: rules, abort manoeuvre, states,
 * command. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef SAFETY_PORTS_H
#define SAFETY_PORTS_H

#include "directions.h"
#include "safety_rules.h"
#include "tracking.h"

enum { KEEP_OUT, CORRIDOR, SPEED, PASSIVE, PLUME, NAVIGATION, ESCAPE, RULES };
enum { HILL_AXES, TARGET_AXES };

typedef struct {
    double mu, R_E, J2, use_J2;
    double keep_out_shape, keep_out_axes, keep_out_opens;
    vec3 keep_out_half;
    double use_corridor, corridor_axes, corridor_half_angle, corridor_length;
    vec3 corridor_axis, corridor_apex;
    double use_speed_limit, speed_at_zero, speed_slope, speed_tumble, tumble_max;
    double passive_time, passive_step, passive_period, passive_opens;
    double use_plume, plume_half_angle, plume_range, plume_force_min;
    double lost_time, t_armed;
    double use_range, range_at_zero, range_slope, range_patience, range_tau, range_alone;
    double abort_on[RULES];
    double act, mass, abort_force, abort_speed;
    vec3 abort_dv_H;
    double abort_relative, axis_radius, abort_time;
    double escape_time, escape_period, escape_radius[2], escape_reserve[2];
    double e_r, e_v, k_p, k_n, r_max, e_model;
    double sample_period;
} SafetyParameters;
typedef struct {
    Body T, S;
    vec3 F_cmd_S;
    double approaching, relative_valid;
    double range_meas, range_time, range_valid;
} SafetyInput;

#define SAFETY_PARAMETERS                                                                          \
    NONNEGATIVE(mu, "m3/s2", "gravitational parameter of the planet; 0 = deep space"),             \
        NONNEGATIVE(R_E, "m", "equatorial radius of the planet"),                                  \
        NONNEGATIVE(J2, "1", "second zonal harmonic of the planet"),                               \
        SWITCH(use_J2, "1: the oblateness acts on the predicted drift without thrust"),            \
        PARAMETER(keep_out_shape, "1", "keep-out zone: 0 = none, 1 = ellipsoid, 2 = box"),         \
        SWITCH(keep_out_axes, "axes of the keep-out zone: 0 = Hill, 1 = target (rule passive "     \
                              "then uses the sphere around the zone)"),                            \
        SWITCH(keep_out_opens,                                                                     \
               "1: the keep-out zone does not apply while approaching (berthing)"),                \
        POSITIVE(keep_out_half, "m", "half axes of the keep-out zone: of an ellipsoid or a box"),  \
        SWITCH(use_corridor, "1: the approach corridor applies while approaching"),                \
        SWITCH(corridor_axes, "axes of the corridor: 0 = Hill, 1 = target"),                       \
        POSITIVE(corridor_half_angle, "rad", "half angle of the cone, below pi/2"),                \
        NONNEGATIVE(corridor_length, "m",                                                          \
                    "distance from the apex along the axis beyond which the corridor sets no "     \
                    "limit; 0 = no end"),                                                          \
        PARAMETER(corridor_axis, "1", "axis of the corridor: unit vector from the apex outwards"), \
        PARAMETER(corridor_apex, "m", "apex of the cone, from the target's centre of mass"),       \
        SWITCH(use_speed_limit, "1: the speed limit applies while approaching"),                   \
        NONNEGATIVE(speed_at_zero, "m/s", "speed limit at range 0, as seen in the Hill frame"),    \
        NONNEGATIVE(speed_slope, "1/s", "rise of the speed limit with the range"),                 \
        SWITCH(speed_tumble, "1: the tumble rate of the target is added to speed_slope"),          \
        NONNEGATIVE(tumble_max, "rad/s", "largest tumble rate that is added by speed_tumble"),     \
        NONNEGATIVE(passive_time, "s",                                                             \
                    "time for which a drift without thrust must stay outside the zone; 0 = "       \
                    "rule off"),                                                                   \
        POSITIVE(passive_step, "s", "integration step of the drift"),                              \
        NONNEGATIVE(passive_period, "s",                                                           \
                    "time between predictions of the drift; 0 = at every sample"),                 \
        SWITCH(passive_opens, "1: the drift is not evaluated while approaching (berthing)"),       \
        SWITCH(use_plume, "1: the exhaust, a cone opposite to F_cmd_S, must not meet the "         \
                          "target's centre of mass"),                                              \
        POSITIVE(plume_half_angle, "rad", "half angle of the exhaust, below pi/2"),                \
        POSITIVE(plume_range, "m", "distance beyond which the exhaust does no harm"),              \
        NONNEGATIVE(plume_force_min, "N", "force below which there is no plume"),                  \
        NONNEGATIVE(lost_time, "s", "longest time without a valid relative state; 0 = rule off"),  \
        NONNEGATIVE(t_armed, "s",                                                                  \
                    "no rule is evaluated before this time (filters settle); 0 = from the "        \
                    "start"),                                                                      \
        SWITCH(abort_on, "1: a violation aborts; elements: keep-out, corridor, speed, passive, "   \
                         "plume, navigation, escape"),                                             \
        SWITCH(act, "1: after the abort, F_safe_S is the abort manoeuvre; 0: it remains F_cmd_S"), \
        POSITIVE(mass, "kg", "mass of the servicer as assumed for the abort manoeuvre"),           \
        NONNEGATIVE(abort_force, "N", "force of the abort manoeuvre; 0: free drift"),              \
        NONNEGATIVE(abort_speed, "m/s",                                                            \
                    "abort_relative = 1: speed away from the target after the abort, seen in H; "  \
                    "0: increment along corridor_axis"),                                           \
        PARAMETER(abort_dv_H, "m/s",                                                               \
                  "fixed velocity increment of the abort, Hill axes; zero: abort_speed "           \
                  "applies"),                                                                      \
        SWITCH(abort_relative, "1: the abort leads to abort_speed away from the target; 0: it "    \
                               "adds abort_speed along corridor_axis"),                            \
        NONNEGATIVE(axis_radius, "m",                                                              \
                    "range up to which an abort in the corridor follows its axis, and rule "       \
                    "escape is off while approaching"),                                            \
        NONNEGATIVE(abort_time, "s",                                                               \
                    "an abort is ordered at this time, as a rehearsal; 1e30: never"),              \
        NONNEGATIVE(escape_time, "s",                                                              \
                    "time for which the drift after an abort must stay outside escape_radius; "    \
                    "0 = off"),                                                                    \
        NONNEGATIVE(escape_period, "s",                                                            \
                    "time between predictions of an abort; 0 = at every sample"),                  \
        NONNEGATIVE(escape_radius, "m",                                                            \
                    "radius an abort must not enter; elements: not approaching, approaching; "     \
                    "0: rule off"),                                                                \
        NONNEGATIVE(escape_reserve, "m",                                                           \
                    "margin below which rule escape is violated; elements: not approaching, "      \
                    "approaching"),                                                                \
        NONNEGATIVE(e_r, "m", "bound on the error of the relative position, per axis"),            \
        NONNEGATIVE(e_v, "m/s", "bound on the error of the relative velocity, per axis"),          \
        NONNEGATIVE(k_p, "1",                                                                      \
                    "bound on the error of the abort burn along its velocity increment, share of " \
                    "the increment"),                                                              \
        NONNEGATIVE(                                                                               \
            k_n, "1",                                                                              \
            "bound on the error of the abort burn normal to its velocity increment, share "        \
            "of the increment"),                                                                   \
        NONNEGATIVE(r_max, "m",                                                                    \
                    "largest range at which rule escape bounds the path between two instants of "  \
                    "the prediction"),                                                             \
        NONNEGATIVE(e_model, "m/s2", "largest acceleration that the equations of drift neglect"),  \
        SAMPLE_PERIOD,                                                                             \
        SWITCH(use_range,                                                                          \
               "1: an estimate that disagrees with the independent range is no valid state"),      \
        NONNEGATIVE(range_at_zero, "m", "disagreement allowed at range 0"),                        \
        NONNEGATIVE(range_slope, "1", "rise of the allowed disagreement with the range"),          \
        NONNEGATIVE(range_patience, "s",                                                           \
                    "time of disagreement after which the estimate is invalid"),                   \
        POSITIVE(range_tau, "s",                                                                   \
                 "time constant with which dead reckoning by the estimated velocity follows "      \
                 "the range"),                                                                     \
        SWITCH(range_alone,                                                                        \
               "1: rule navigation counts a state as lost only if it is flagged valid but "        \
               "disagrees with the range")

#define SAFETY_INPUTS                                                                           \
    BODY_INPUTS("T", T, "target"), BODY_INPUTS("S", S, "servicer"),                             \
        INPUT(F_cmd_S, "N", "commanded force, servicer axes"),                                  \
        INPUT(approaching, "1",                                                                 \
              "1: corridor and speed limit apply; 0: they do not, for example after the "       \
              "approach was given up"),                                                         \
        INPUT(relative_valid, "1", "1: the states of target and servicer are valid"),           \
        OPTIONAL_INPUT(range_meas, "m", "independent range, used if use_range = 1"),            \
        OPTIONAL_INPUT(range_time, "s", "time at which the range was measured; -1 = none yet"), \
        OPTIONAL_SWITCH(range_valid, "1: a range was measured at range_time")

static inline void check_acute(Problems *problems, const char *name, double angle)
{
    if (angle >= PI / 2) reject(problems, name, angle, "must be below pi/2");
}

#define MOST_STEPS 1e5 /* largest number of steps of one drift */

static inline void check_safety(const SafetyParameters *p, Problems *problems)
{
    double shape = p->keep_out_shape;
    if (shape != NO_ZONE && shape != ELLIPSOID && shape != BOX)
        reject(problems, "keep_out_shape", shape, "must be 0, 1 or 2");
    check_unit_vector(problems, "corridor_axis", p->corridor_axis);
    if (p->passive_time > 0 && shape == NO_ZONE)
        reject(problems, "passive_time", p->passive_time, "needs keep_out_shape = 1 or 2");
    if (p->passive_time > MOST_STEPS * p->passive_step)
        reject(problems, "passive_step", p->passive_step, "must not be below passive_time / 1e5");
    if (p->use_range && p->lost_time == 0)
        reject(problems, "use_range", p->use_range, "needs lost_time > 0 (rule navigation)");
    check_acute(problems, "corridor_half_angle", p->corridor_half_angle);
    check_acute(problems, "plume_half_angle", p->plume_half_angle);
}

#endif
