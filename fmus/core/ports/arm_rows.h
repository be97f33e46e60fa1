/* arm_rows.h - parameters of an arm, the same in the interfaces of plant and flight software:
 * entries of the table of variables, default values, rules.
 *
 * Parameters per joint have seven rows; rows beyond the number `joints` are not checked, except in
 * joint_torque_max, where every row must be >= 0. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef ARM_ROWS_H
#define ARM_ROWS_H

#include "arm.h"
#include "fmu.h"
#include "mounting.h"
#include "rigid_body.h"

/* default arm at the front face: seven joints about z, y, x, y, x, y, x, 2.0 m from the second
 * joint to the tip, 25 kg */
#define ARM_START                                                                           \
    {.joints = 7,                                                                           \
     .axis = {{0, 0, 1}, {0, 1, 0}, {1, 0, 0}, {0, 1, 0}, {1, 0, 0}, {0, 1, 0}, {1, 0, 0}}, \
     .offset = {{0.5, 0, -0.3},                                                             \
                {0.1, 0, 0},                                                                \
                {0.1, 0, 0},                                                                \
                {0.75, 0, 0},                                                               \
                {0.1, 0, 0},                                                                \
                {0.65, 0, 0},                                                               \
                {0.1, 0, 0}},                                                               \
     .mass = {4, 3.5, 5, 3.5, 3.5, 2.5, 3},                                                 \
     .centre = {{0.05, 0, 0},                                                               \
                {0.05, 0, 0},                                                               \
                {0.35, 0, 0},                                                               \
                {0.05, 0, 0},                                                               \
                {0.3, 0, 0},                                                                \
                {0.05, 0, 0},                                                               \
                {0.12, 0, 0}},                                                              \
     .inertia = {{0.015, 0.02, 0.02},                                                       \
                 {0.012, 0.015, 0.015},                                                     \
                 {0.015, 0.24, 0.24},                                                       \
                 {0.012, 0.015, 0.015},                                                     \
                 {0.008, 0.125, 0.125},                                                     \
                 {0.006, 0.007, 0.007},                                                     \
                 {0.008, 0.03, 0.03}},                                                      \
     .joint_inertia = {0.8, 0.8, 0.5, 0.5, 0.2, 0.2, 0.2},                                  \
     .p_EA_A = {0.3, 0, 0},                                                                 \
     .q_EA = {1, 0, 0, 0}}

/* joint angles of the stowed arm, which is folded over the front face */
#define ARM_STOWED {1.5707963267948966, 0.3, 0, -2.7, 0, 1.2, 0}

#define ARM_MATRIX(name, member, unit, text) \
    ROW_AS(PARAMETER_ROW, p, name, arm.member, 3, unit, text, ANY_VALUE)
#define ARM_PARAMETERS                                                                             \
    PARAMETER_AS("joints", arm.joints, "1", "number of joints, whole, 0 to 7"),                    \
        ARM_MATRIX("joint_axis", axis, "1",                                                        \
                   "unit vector of the axis, per joint; zero pose, base axes"),                    \
        ARM_MATRIX("joint_offset", offset, "m",                                                    \
                   "position from the previous joint, the first from S, centre of mass of the "    \
                   "base; zero pose, base axes"),                                                  \
        PARAMETER_AS("link_mass", arm.mass, "kg", "mass per link"),                                \
        ARM_MATRIX("link_centre", centre, "m",                                                     \
                   "centre of mass from the joint of the link, per link; zero pose, base axes"),   \
        ARM_MATRIX("link_inertia", inertia, "kg.m2",                                               \
                   "moments of inertia xx, yy, zz about the centre of mass, per link; zero pose, " \
                   "base axes"),                                                                   \
        ARM_MATRIX("link_products", products, "kg.m2",                                             \
                   "elements xy, xz, yz of the inertia matrix, per link; zero pose, base axes"),   \
        PARAMETER_AS("joint_inertia", arm.joint_inertia, "kg.m2",                                  \
                     "inertia of the rotor seen through the gear, per joint"),                     \
        PARAMETER_AS("p_EA_A", arm.p_EA_A, "m",                                                    \
                     "end effector from the last joint, axes of the last link (base axes in the "  \
                     "zero pose)"),                                                                \
        PARAMETER_AS("q_EA", arm.q_EA, "1",                                                        \
                     "attitude of the end effector relative to the last link, scalar first")

/* ---- friction and torque limits of the joints: the true ones, or as known to the software ---- */
typedef struct {
    double damping[ARM_JOINTS], friction[ARM_JOINTS], friction_rate, torque_max[ARM_JOINTS];
} Joints;

#define JOINTS_PARAMETERS                                                                     \
    PARAMETER_AS("joint_damping", joint.damping, "N.m.s", "viscous friction, per joint"),     \
        PARAMETER_AS("joint_friction", joint.friction, "N.m", "Coulomb friction, per joint"), \
        POSITIVE_AS("friction_rate", joint.friction_rate, "rad/s",                            \
                    "rate at which Coulomb friction has 0.7 of its full value"),              \
        NONNEGATIVE_AS("joint_torque_max", joint.torque_max, "N.m",                           \
                       "largest torque, per joint; 0 = no limit")

/* friction torque of joint i: damping dq + friction dq/sqrt(dq^2 + friction_rate^2) */
static inline double friction_torque(const Joints *joint, int i, double dq)
{
    double r = joint->friction_rate, viscous = joint->damping[i] * dq;
    if (joint->friction[i] == 0) return viscous;
    return viscous + joint->friction[i] * dq / sqrt(dq * dq + r * r);
}

/* ---- rules ---- */
static inline const char *element_of(char text[32], const char *name, int i)
{
    snprintf(text, 32, "%s[%d]", name, i + 1);
    return text;
}
static inline void reject_row(Problems *problems, const char *name, int i, double value,
                              const char *rule)
{
    char text[32];
    reject(problems, element_of(text, name, i), value, rule);
}

static inline void check_not_negative(Problems *problems, const char *name, const double *value,
                                      int joints)
{
    for (int i = 0; i < joints; i++)
        if (!(value[i] >= 0)) reject_row(problems, name, i, value[i], "must be >= 0");
}

static inline void check_link(Problems *problems, const Arm *arm, int i)
{
    char text[32];
    double length = norm(arm->axis[i]);
    if (!(fabs(length - 1) <= 1e-9))
        reject_row(problems, "joint_axis", i, length,
                   "must be a unit vector (the value is its norm)");
    if (!(arm->mass[i] > 0)) reject_row(problems, "link_mass", i, arm->mass[i], "must be > 0");
    check_inertia(problems, element_of(text, "link_inertia", i), mat_of(link_inertia(arm, i)));
}

/* checks the number of joints and the rows of the arm; returns the number of joints, or 0 if it is
 * rejected: then no row is checked */
static inline int check_arm(Problems *problems, const Arm *arm)
{
    double n = arm->joints;
    if (!(n == floor_of(n) && n >= 0 && n <= ARM_JOINTS)) {
        reject(problems, "joints", n, "must be a whole number from 0 to 7");
        return 0;
    }
    int joints = (int)n;
    check_unit_quaternion(problems, "|q_EA|", arm->q_EA);
    check_not_negative(problems, "joint_inertia", arm->joint_inertia, joints);
    for (int i = 0; i < joints; i++) check_link(problems, arm, i);
    return joints;
}

static inline void check_joints(Problems *problems, const Joints *joint, int joints)
{
    check_not_negative(problems, "joint_damping", joint->damping, joints);
    check_not_negative(problems, "joint_friction", joint->friction, joints);
}

#endif
