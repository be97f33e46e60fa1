/* docking_rows.h - parameters of the docking mechanism (bodies, ports, contact, latch) and their
 * rules. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef DOCKING_ROWS_H
#define DOCKING_ROWS_H

#include "docking_port.h"
#include "rigid_body.h"

typedef struct {
    double mass_S, mass_T;
    mat3 J_S, J_T;
    vec3 p_PS_S, p_QT_T;
    quat q_PS, q_QT;
    Port port;
    double latch_depth, latch_offset, latch_angle, latch_speed, latch_rate, latch_dwell, trip_force;
    double hard_distance, hard_angle, hard_speed, hard_rate, break_force, break_moment;
    double latency, max_step;
} DockingParameters;

#define DOCKING_START                                                       \
    {.mass_S = 100,                                                         \
     .J_S = {{{200, 0, 0}, {0, 250, 0}, {0, 0, 150}}},                      \
     .mass_T = 150,                                                         \
     .J_T = {{{100, 0, 0}, {0, 150, 0}, {0, 0, 90}}},                       \
     .p_PS_S = {1.1, 0, 0},                                                 \
     .q_PS = {1, 0, 0, 0},                                                  \
     .p_QT_T = {0.6, 0, 0},                                                 \
     .q_QT = {1, 0, 0, 0},                                                  \
     .port = {.mouth_radius = 0.08,                                         \
              .floor_radius = 0.01,                                         \
              .cone_depth = 0.12,                                           \
              .face_radius = 0.15,                                          \
              .depth_max = 0.02,                                            \
              .k_contact = 1e5,                                             \
              .n_contact = 1.5,                                             \
              .damping_contact = 40,                                        \
              .friction = 0.1,                                              \
              .friction_speed = 1e-3,                                       \
              .soft = {.k = 100, .c = 120, .k_rot = 40, .c_rot = 60},       \
              .hard = {.k = 20000, .c = 110, .k_rot = 20000, .c_rot = 140}, \
              .draw_delay = 10,                                             \
              .draw_time = 20,                                              \
              .k_sep = 60,                                                  \
              .stroke_sep = 0.05},                                          \
     .latch_depth = 0.11,                                                   \
     .latch_offset = 0.02,                                                  \
     .latch_angle = 0.0873,                                                 \
     .latch_speed = 0.06,                                                   \
     .latch_rate = 0.035,                                                   \
     .latch_dwell = 0.1,                                                    \
     .trip_force = 3,                                                       \
     .hard_distance = 0.002,                                                \
     .hard_angle = 0.01,                                                    \
     .hard_speed = 0.002,                                                   \
     .hard_rate = 0.002,                                                    \
     .break_force = 200,                                                    \
     .break_moment = 100,                                                   \
     .max_step = 1e-3}

#define PORT_POSITIVE(member, unit, text)    POSITIVE_AS(#member, port.member, unit, text)
#define PORT_NONNEGATIVE(member, unit, text) NONNEGATIVE_AS(#member, port.member, unit, text)
#define LATCH_ROWS(latch, stage)                                                                \
    POSITIVE_AS("k_" #latch, port.latch.k, "N/m", stage ": stiffness"),                         \
        NONNEGATIVE_AS("c_" #latch, port.latch.c, "N.s/m", stage ": damping"),                  \
        POSITIVE_AS("k_rot_" #latch, port.latch.k_rot, "N.m/rad", stage ": angular stiffness"), \
        NONNEGATIVE_AS("c_rot_" #latch, port.latch.c_rot, "N.m.s/rad", stage ": angular damping")

#define DOCKING_PARAMETERS                                                                         \
    POSITIVE(mass_S, "kg", "mass of the servicer, as assumed by the mechanism"),                   \
        MATRIX(J_S, "kg.m2",                                                                       \
               "inertia of the servicer about its centre of mass, wheels locked, body axes"),      \
        POSITIVE(mass_T, "kg", "mass of the target, as assumed by the mechanism"),                 \
        MATRIX(J_T, "kg.m2", "inertia of the target about its centre of mass, body axes"),         \
        PARAMETER(p_PS_S, "m",                                                                     \
                  "tip of the probe from the servicer's centre of mass, servicer axes"),           \
        PARAMETER(q_PS, "1", "attitude of the probe relative to the servicer; +X points outward"), \
        PARAMETER(p_QT_T, "m",                                                                     \
                  "centre of the mouth from the target's centre of mass, target axes"),            \
        PARAMETER(q_QT, "1", "attitude of the drogue relative to the target; +X points outward"),  \
        PORT_POSITIVE(mouth_radius, "m", "radius of the cone at its mouth"),                       \
        PORT_POSITIVE(floor_radius, "m", "radius of the cone at its floor"),                       \
        PORT_POSITIVE(cone_depth, "m", "depth of the cone"),                                       \
        PORT_POSITIVE(face_radius, "m", "radius of the face around the mouth"),                    \
        PORT_POSITIVE(depth_max, "m",                                                              \
                      "depth of the tip in the material beyond which no contact force acts"),      \
        PORT_POSITIVE(k_contact, "1", "contact: stiffness [N/m^n_contact]"),                       \
        PORT_POSITIVE(n_contact, "1", "contact: exponent of the depth"),                           \
        PORT_NONNEGATIVE(damping_contact, "s/m",                                                   \
                         "contact: damping force per elastic force and speed of compression"),     \
        PORT_NONNEGATIVE(friction, "1", "contact: coefficient of friction"),                       \
        PORT_NONNEGATIVE(friction_speed, "m/s",                                                    \
                         "contact: slip speed below which friction decreases to zero"),            \
        POSITIVE(latch_depth, "m", "window of the latch: least depth of the tip below the mouth"), \
        NONNEGATIVE(latch_offset, "m", "window of the latch: largest offset from the axis"),       \
        NONNEGATIVE(latch_angle, "rad", "window of the latch: largest misalignment"),              \
        NONNEGATIVE(latch_speed, "m/s", "window of the latch: largest speed of the tip"),          \
        NONNEGATIVE(latch_rate, "rad/s", "window of the latch: largest relative angular rate"),    \
        NONNEGATIVE(latch_dwell, "s",                                                              \
                    "window of the latch: least time inside it before soft capture"),              \
        NONNEGATIVE(trip_force, "N", "window of the latch: normal force needed for soft capture"), \
        LATCH_ROWS(soft, "soft capture"),                                                          \
        PORT_POSITIVE(draw_delay, "s", "time from soft capture to the start of the retraction"),   \
        PORT_POSITIVE(draw_time, "s", "duration of the retraction of the probe"),                  \
        NONNEGATIVE(hard_distance, "m",                                                            \
                    "hard capture: largest distance of the tip from its seated position"),         \
        NONNEGATIVE(hard_angle, "rad",                                                             \
                    "hard capture: largest rotation from aligned axes, roll as in soft capture"),  \
        NONNEGATIVE(hard_speed, "m/s", "hard capture: largest speed of the tip"),                  \
        NONNEGATIVE(hard_rate, "rad/s", "hard capture: largest relative angular rate"),            \
        LATCH_ROWS(hard, "hard capture"),                                                          \
        NONNEGATIVE(break_force, "N", "the latch breaks above this force, averaged over a step"),  \
        NONNEGATIVE(break_moment, "N.m",                                                           \
                    "the latch breaks above this couple, averaged over a step"),                   \
        PORT_POSITIVE(k_sep, "N/m", "stiffness of the separation spring"),                         \
        PORT_NONNEGATIVE(stroke_sep, "m", "stroke of the separation spring"),                      \
        SWITCH(latency,                                                                            \
               "1: loads are one step ahead, for Jacobi masters, which apply them a step late"),   \
        GRID(max_step, "longest internal step of the prediction")

static inline void check_nonzero_quaternion(Problems *problems, const char *name, quat q)
{
    double n = q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z;
    if (n == 0) reject(problems, name, n, "must not have norm 0");
}

static inline void check_docking(Problems *problems, const DockingParameters *p)
{
    const Port *c = &p->port;
    check_inertia(problems, "J_S", p->J_S);
    check_inertia(problems, "J_T", p->J_T);
    check_nonzero_quaternion(problems, "q_PS", p->q_PS);
    check_nonzero_quaternion(problems, "q_QT", p->q_QT);
    if (c->mouth_radius <= c->floor_radius)
        reject(problems, "mouth_radius", c->mouth_radius, "must be above floor_radius");
    if (c->face_radius < c->mouth_radius)
        reject(problems, "face_radius", c->face_radius, "must not be below mouth_radius");
    if (p->latch_depth > c->cone_depth + c->depth_max)
        reject(problems, "latch_depth", p->latch_depth, "must not be above cone_depth + depth_max");
    if (p->latch_angle > 1.5) reject(problems, "latch_angle", p->latch_angle, "must be <= 1.5");
}

#endif
