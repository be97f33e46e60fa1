/* filter_ports.h - parameters and inputs of the safety filter. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef FILTER_PORTS_H
#define FILTER_PORTS_H

#include "body_rows.h"
#include "directions.h"
#include "half_spaces.h"

enum { NO_FILTER, SIMPLEX_EXPLICIT, SIMPLEX_IMPLICIT, ASIF, FILTERS };
enum { PASSES, FILTERED, BACKUP, RELAXED, NO_STATE };
enum { NO_RULE, KEEP_OUT, CORRIDOR, SPEED, DRIFT, PLUME, BOX, BARRIERS = PLUME };
enum { MOST_POINTS = 32 };

typedef struct {
    double filter, mu, mass, mass_error;
    vec3 F_max;
    double a_dist, position_error, velocity_error, attitude_error, rate_error, reaction;
    double keep_out_radius, brake_keep_out, keep_out_opens;
    double use_corridor, corridor_half_angle, corridor_length, brake_corridor, alpha_T_max;
    vec3 corridor_axis, corridor_apex;
    double use_speed_limit, speed_at_zero, speed_slope, speed_max;
    double passive_time, passive_points, passive_margin;
    double plume_range, plume_force;
    double recover_speed, dwell, sample_period;
} FilterParameters;
typedef struct {
    Body T, S;
    vec3 F_cmd_S;
    double approaching, relative_valid;
} FilterInput;

#define FILTER_PARAMETERS                                                                        \
    PARAMETER(filter, "1",                                                                       \
              "0 none; 1, 2: F_cmd_S or a braking backup (explicit, implicit simplex); 3: "      \
              "least change of F_cmd_S"),                                                        \
        NONNEGATIVE(mu, "m3/s2", "gravitational parameter of the planet; 0 = deep space"),       \
        POSITIVE(mass, "kg", "mass of the servicer, as known to the filter"),                    \
        NONNEGATIVE(mass_error, "1", "true mass may differ from mass by this share, below 1"),   \
        POSITIVE(F_max, "N",                                                                     \
                 "force limit per body axis, both directions; must always be available"),        \
        NONNEGATIVE(a_dist, "m/s2", "bound on every acceleration that is not modelled"),         \
        NONNEGATIVE(position_error, "m",                                                         \
                    "bound on the magnitude of the error of the relative position"),             \
        NONNEGATIVE(velocity_error, "m/s",                                                       \
                    "bound on the magnitude of the error of the relative velocity"),             \
        NONNEGATIVE(attitude_error, "rad", "bound on the error of the target's attitude"),       \
        NONNEGATIVE(rate_error, "rad/s", "bound on the error of the target's rate"),             \
        NONNEGATIVE(reaction, "s", "delay of the force plus the time constant of its lag"),      \
        NONNEGATIVE(keep_out_radius, "m", "radius of the keep-out sphere; 0 = rule off"),        \
        POSITIVE(brake_keep_out, "m/s2", "deceleration planned before the keep-out sphere"),     \
        SWITCH(keep_out_opens, "1: keep-out and drift rules off if approaching = 1 (berthing)"), \
        SWITCH(use_corridor, "1: corridor rule applies if approaching = 1"),                     \
        POSITIVE(corridor_half_angle, "rad", "half angle of the cone, below pi/2"),              \
        PARAMETER(corridor_axis, "1", "unit vector from the apex outwards, target axes"),        \
        PARAMETER(corridor_apex, "m", "apex, from the target's centre of mass, target axes"),    \
        NONNEGATIVE(corridor_length, "m",                                                        \
                    "distance from the apex of an end plane that must not be crossed outwards; " \
                    "0 = none"),                                                                 \
        POSITIVE(brake_corridor, "m/s2", "deceleration planned before the corridor's faces"),    \
        NONNEGATIVE(alpha_T_max, "rad/s2", "bound on the target's angular acceleration"),        \
        SWITCH(use_speed_limit, "1: speed limit applies if approaching = 1"),                    \
        POSITIVE(speed_at_zero, "m/s", "speed limit at range 0, as seen in the Hill frame"),     \
        NONNEGATIVE(speed_slope, "1/s", "rise of the speed limit with the range"),               \
        NONNEGATIVE(speed_max, "m/s", "largest value of the speed limit, at any range"),         \
        NONNEGATIVE(passive_time, "s",                                                           \
                    "time for which free drift must miss the keep-out sphere; 0 = rule off"),    \
        PARAMETER(passive_points, "1", "number of intervals of the predicted drift, 2 to 32"),   \
        NONNEGATIVE(passive_margin, "m", "least distance of drift from the keep-out sphere"),    \
        NONNEGATIVE(plume_range, "m", "range below which plume_force applies; 0 = rule off"),    \
        NONNEGATIVE(plume_force, "N",                                                            \
                    "largest force on the servicer away from the target within plume_range"),    \
        POSITIVE(recover_speed, "m/s", "speed of return where a rule is violated"),              \
        NONNEGATIVE(dwell, "s",                                                                  \
                    "filter = 1, 2: a command passes again after it was safe for this time"),    \
        SAMPLE_PERIOD

#define FILTER_INPUTS                                                 \
    BODY_INPUTS("T", T, "target"), BODY_INPUTS("S", S, "servicer"),   \
        INPUT(F_cmd_S, "N", "commanded force, servicer axes"),        \
        INPUT(approaching, "1", "1: corridor and speed limit apply"), \
        INPUT(relative_valid, "1",                                    \
              "1: the estimates of target and servicer are valid; 0: F_cmd_S passes unchanged")

static inline void check_points(const FilterParameters *p, Problems *problems)
{
    double K = p->passive_points;
    if (!(K >= 2 && K <= MOST_POINTS && K == nearest_whole(K)))
        reject(problems, "passive_points", K, "must be a whole number from 2 to 32");
    if (p->passive_time > 0 && p->keep_out_radius == 0)
        reject(problems, "passive_time", p->passive_time, "needs keep_out_radius > 0");
}

static inline void check_filter(const FilterParameters *p, Problems *problems)
{
    if (!(p->filter >= 0 && p->filter < FILTERS && p->filter == nearest_whole(p->filter)))
        reject(problems, "filter", p->filter, "must be 0, 1, 2 or 3");
    if (p->mass_error >= 1) reject(problems, "mass_error", p->mass_error, "must be below 1");
    if (p->corridor_half_angle >= PI / 2)
        reject(problems, "corridor_half_angle", p->corridor_half_angle, "must be below pi/2");
    check_unit_vector(problems, "corridor_axis", p->corridor_axis);
    double impulse = p->sample_period * norm(p->F_max);
    if (p->use_speed_limit && impulse >= p->speed_at_zero * p->mass * (1 - p->mass_error))
        reject(problems, "speed_at_zero", p->speed_at_zero,
               "must be above sample_period |F_max| / (mass (1 - mass_error))");
    check_points(p, problems);
}

#endif
