/* notch_filter.c - removes the frequencies of flexible modes from the commands of a controller.
 *
 *   H(s) = (s^2 + 2 z w s + w^2)/(s^2 + 2 Z w s + w^2),   s = k (1 - 1/q)/(1 + 1/q),
 *   k = w/tan(w T/2)
 *
 * w: frequency, z: depth, Z: width; T: sample period, 1/q: delay by one sample. Two notches in
 * series, the same on all axes, for torque and wheel acceleration, and two for the force, which
 * excites other modes: antisymmetric bending of the wings turns the hub, symmetric bending shifts
 * it. The discretisation is bilinear (Tustin), prewarped so that a notch is exactly at w for any
 * T. The gain is z/Z at w, 1 far from it, and exactly 1 for a constant command. A notch causes a
 * phase lag of about 2 Z u/(1 - u^2) rad at the frequency u w, u < 1, so w should be above the
 * bandwidth of the loop. Frequency 0: no notch. The filter starts at rest. Sampled: a step reads
 * the inputs once and holds the outputs. Equations: docs/models.md L.7. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "exact.h"
#include "fmu.h"
#include "time_grid.h"
#include "vec3.h"

enum { NOTCHES = 2 }; /* notches in series */

typedef struct {
    double frequency[NOTCHES], force_frequency[NOTCHES];
    double depth[NOTCHES], width[NOTCHES], sample_period;
} Parameters;
typedef struct { vec3 M_cmd_S, wheel_accel_cmd, F_cmd_S; } Input;
/* states of one notch: `one` is added to the next output, `two` to `one` at the next sample */
typedef struct { vec3 one, two; } Memory;
typedef struct { Memory torque[NOTCHES], wheels[NOTCHES], force[NOTCHES]; } State;
typedef struct { vec3 M_notched_S, wheel_accel_notched, F_notched_S; } Output;
MODEL_STRUCT;

static const Model start = {
    .p = {.depth = {0.05, 0.05}, .width = {0.7, 0.7}, .sample_period = 0.1},
};

static const Variable variables[] = {
    NONNEGATIVE(frequency, "rad/s",
                "frequency of each notch in torque and wheel acceleration; 0 = no such notch"),
    NONNEGATIVE(force_frequency, "rad/s",
                "frequency of each notch in the force; 0 = no such notch"),
    NONNEGATIVE(
        depth, "1",
        "damping ratio of the zeros, for frequency and force_frequency: gain depth/width there"),
    NONNEGATIVE(
        width, "1",
        "damping ratio of the poles, as for depth: half of the relative width of the notch"),
    GRID(sample_period, "sample period of the software, for which the notches are computed"),

    INPUT(M_cmd_S, "N.m", "commanded torque, servicer axes"),
    INPUT(wheel_accel_cmd, "rad/s2", "commanded wheel acceleration"),
    OPTIONAL_INPUT(F_cmd_S, "N", "commanded force, servicer axes"),

    OUTPUT(M_notched_S, "N.m", "commanded torque without the frequencies of the notches"),
    OUTPUT(wheel_accel_notched, "rad/s2",
           "commanded wheel acceleration without the frequencies of the notches"),
    OUTPUT(F_notched_S, "N", "commanded force without the frequencies of its notches"),
};

static void check_frequency(const Parameters *p, const char *list, int i, double frequency,
                            Problems *problems)
{
    char name[40];
    if (frequency * p->sample_period < PI) return;
    snprintf(name, sizeof name, "%s[%d]", list, i + 1);
    reject(problems, name, frequency, "must be below pi/sample_period, half of the sample rate");
}

/* L.7-5 */
static void check(const Parameters *p, Problems *problems)
{
    for (int i = 0; i < NOTCHES; i++) {
        char name[20];
        check_frequency(p, "frequency", i, p->frequency[i], problems);
        check_frequency(p, "force_frequency", i, p->force_frequency[i], problems);
        snprintf(name, sizeof name, "width[%d]", i + 1);
        if (p->frequency[i] + p->force_frequency[i] > 0 && p->width[i] == 0)
            reject(problems, name, 0,
                   "must be > 0 if frequency or force_frequency of this notch is > 0");
    }
}

/* ---- one notch: y = b0 u + b1 (u_1 - y_1) + b2 u_2 - a2 y_2 ----
 * u, y: input and output of this sample; u_1, y_1, u_2, y_2: one and two samples before */
typedef struct { double b0, b1, b2, a2; } Notch;

/* L.7-2 */
static Notch notch_of(const Parameters *p, int i, double w)
{
    double half = w * p->sample_period / 2;
    double k = w * cosine(half) / sine(half), square = k * k + w * w;
    double zeros = 2 * p->depth[i] * w * k, poles = 2 * p->width[i] * w * k, a0 = square + poles;
    return (Notch){(square + zeros) / a0, 2 * (w * w - k * k) / a0, (square - zeros) / a0,
                   (square - poles) / a0};
}

static vec3 filtered(const Notch *n, Memory *m, vec3 u)
{
    vec3 y = add(scale(n->b0, u), m->one);
    m->one = add(scale(n->b1, sub(u, y)), m->two);
    m->two = sub(scale(n->b2, u), scale(n->a2, y));
    return y;
}

/* L.7-1 */
static void filter(const Parameters *p, const Input *u, State *x, Output *y)
{
    vec3 M = u->M_cmd_S, wheels = u->wheel_accel_cmd, F = u->F_cmd_S;
    for (int i = 0; i < NOTCHES; i++) {
        if (p->frequency[i] > 0) {
            Notch notch = notch_of(p, i, p->frequency[i]);
            M = filtered(&notch, &x->torque[i], M);
            wheels = filtered(&notch, &x->wheels[i], wheels);
        }
        if (p->force_frequency[i] > 0) {
            Notch notch = notch_of(p, i, p->force_frequency[i]);
            F = filtered(&notch, &x->force[i], F);
        }
    }
    *y = (Output){M, wheels, F};
}

/* L.7-3 */
static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    (void)p, (void)u, (void)t;
    *x = (State){.torque = {{{0, 0, 0}, {0, 0, 0}}}};
    *y = (Output){{0, 0, 0}, {0, 0, 0}, {0, 0, 0}};
}

/* L.7-4 */
static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    for (Sample s = first_sample(t, h, p->sample_period); s.left > 0; s = next_sample(s))
        filter(p, u, x, y);
}

FMU_MODEL(
    "notch_filter",
    "Two notches in torque and wheel command and two in the force, for modes of known frequency");
