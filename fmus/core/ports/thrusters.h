/* thrusters.h - up to 16 body-fixed thrusters: position, direction and nominal thrust.
 *
 * A thruster with nominal thrust 0 does not exist. Positions L are in body axes from the body
 * origin, unit vectors R of the forces in body axes. A thruster with thrust P gives the force P R
 * and the torque (L - D_cm) x (P R) about the centre of mass D_cm. docs/models.md B.6 */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef THRUSTERS_H
#define THRUSTERS_H

#include "directions.h"

enum { THRUSTERS = 16 };

typedef struct { vec3 row[THRUSTERS]; } Rows; /* one row per thruster */
typedef struct {
    Rows position, direction;
    double nominal[THRUSTERS];
    vec3 centre_of_mass;
} Thrusters;

#define THRUSTER_ROWS(member)                                                                      \
    ROW_AS(PARAMETER_ROW, p, "thruster_position", member.position, 3, "m",                         \
           "positions of the thrusters from the body origin, body axes, one row each", ANY_VALUE), \
        ROW_AS(PARAMETER_ROW, p, "thruster_direction", member.direction, 3, "1",                   \
               "unit vectors of the forces on the vehicle, body axes, one row each", ANY_VALUE),   \
        NONNEGATIVE_AS("thrust_nominal", member.nominal, "N",                                      \
                       "nominal thrust, per thruster; 0 = no such thruster"),                      \
        PARAMETER_AS("centre_of_mass", member.centre_of_mass, "m",                                 \
                     "centre of mass from the body origin, body axes")

/* thrusters of Kozlova & Fomichev 2023: attitude P1..P8 (0.5 N), brakes P'1..P'4 (10 N), main
 * engine P'5 (50 N); their positions are chosen here, not in the paper */
#define PAPER_THRUSTERS                                                       \
    {.position = {{{-0.5, 1, 0},                                              \
                   {-0.5, 0, 1},                                              \
                   {-0.5, -1, 0},                                             \
                   {-0.5, 0, -1},                                             \
                   {0.5, 1, 0},                                               \
                   {0.5, 1, 0},                                               \
                   {0.5, -1, 0},                                              \
                   {0.5, -1, 0},                                              \
                   {1.5, 0.7, 0.7},                                           \
                   {1.5, -0.7, 0.7},                                          \
                   {1.5, -0.7, -0.7},                                         \
                   {1.5, 0.7, -0.7},                                          \
                   {-0.5, 0, 0}}},                                            \
     .direction = {{{0, -1, 0},                                               \
                    {0, 0, -1},                                               \
                    {0, 1, 0},                                                \
                    {0, 0, 1},                                                \
                    {0, 0, -1},                                               \
                    {0, 0, 1},                                                \
                    {0, 0, 1},                                                \
                    {0, 0, -1},                                               \
                    {-1, 0, 0},                                               \
                    {-1, 0, 0},                                               \
                    {-1, 0, 0},                                               \
                    {-1, 0, 0},                                               \
                    {1, 0, 0}}},                                              \
     .nominal = {0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 10, 10, 10, 10, 50}, \
     .centre_of_mass = {0.5, 0, 0}}

typedef struct { vec3 F, M; } Wrench;

static inline Wrench thruster_wrench(const Thrusters *all, int i, double thrust)
{
    vec3 F = scale(thrust, all->direction.row[i]);
    return (Wrench){F, cross(sub(all->position.row[i], all->centre_of_mass), F)};
}

static inline void check_thrusters(Problems *problems, const Thrusters *all)
{
    char name[40];
    for (int i = 0; i < THRUSTERS; i++) {
        double length = norm(all->direction.row[i]);
        snprintf(name, sizeof name, "|thruster_direction[%d]|", i + 1);
        if (all->nominal[i] > 0 && !(is_unit_length(length)))
            reject(problems, name, length, "must be a unit vector where thrust_nominal > 0");
    }
}

#endif
