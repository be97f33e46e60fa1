/* joint_controller.c - proportional and derivative control of two joints, and their lock.
 *
 *   tau_j = Kp_j (q_ref_j - q_j) - Kd_j dq_j,   |tau_j| <= torque_max_j
 *
 * With Kp = Kd = 0 the joints are free. If use_lock is set, the joints are locked and the torque is
 * zero from lock_from on.
 * Sampled controller: one sample reads the inputs once and holds torque and lock. Source:
 * docs/models.md D.5. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "fmu.h"
#include "time_grid.h"
#include "vec3.h"

enum { JOINTS = 2 };

typedef struct {
    double joint_angle_ref[JOINTS], Kp[JOINTS], Kd[JOINTS], torque_max[JOINTS];
    double use_lock, lock_from, sample_period;
} Parameters;
typedef struct { double joint_angle[JOINTS], joint_rate[JOINTS]; } Input;
typedef struct { double locked; } State;
typedef struct { double joint_torque[JOINTS], joint_lock, saturated[JOINTS]; } Output;
MODEL_STRUCT;

static const Model start = {
    .p = {.joint_angle_ref = {1.0471975511965976, -0.6981317007977318},
          .Kp = {2, 1},
          .Kd = {60, 20}},
};

static const Variable variables[] = {
    PARAMETER(joint_angle_ref, "rad", "reference of the joint angles"),
    NONNEGATIVE(Kp, "N.m/rad", "proportional gain, per joint"),
    NONNEGATIVE(Kd, "N.m.s/rad", "derivative gain, per joint"),
    NONNEGATIVE(torque_max, "N.m", "largest torque, per joint; 0 = no limit"),
    SWITCH(use_lock, "1: the joints are locked from lock_from on"),
    PARAMETER(lock_from, "s", "start of the lock"),
    SAMPLE_PERIOD,

    INPUT(joint_angle, "rad", "joint angles"),
    INPUT(joint_rate, "rad/s", "joint rates"),

    OUTPUT(joint_torque, "N.m", "torque at the joints"),
    FLAG(joint_lock, "1: the joints are to be locked"),
    FLAG(saturated, "1: the torque is at its limit, per joint"),
};

static void check(const Parameters *p, Problems *problems)
{
    (void)p;
    (void)problems;
}

/* D.5-1, D.5-2 */
static void control(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    x->locked = p->use_lock != 0 && reached(t, p->lock_from);
    y->joint_lock = x->locked;
    for (int j = 0; j < JOINTS; j++) {
        double torque =
            p->Kp[j] * (p->joint_angle_ref[j] - u->joint_angle[j]) - p->Kd[j] * u->joint_rate[j];
        double tau = limited(torque, p->torque_max[j]);
        y->joint_torque[j] = x->locked ? 0 : tau;
        y->saturated[j] = !x->locked && tau != torque;
    }
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    control(p, u, x, y, t);
}

/* D.5-3 */
static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    for (Sample s = first_sample(t, h, p->sample_period); s.left > 0; s = next_sample(s))
        control(p, u, x, y, s.t);
}

FMU_MODEL("joint_controller", "Proportional and derivative control of two joints, and their lock");
