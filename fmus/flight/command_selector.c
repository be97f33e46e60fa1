/* command_selector.c - selection of one force, one torque and one wheel acceleration from the
 * commands of six laws.
 *
 * The input select_force selects F*, the input select_torque (0 to 4) selects M* and W*:
 *   F* = {0: 0, 1: F_1, 2: F_close, 3: F_sync, 4: 0, 5: F_retreat, 6: F_opt}
 *   M* = {0: 0, 1: M_1, 2: M_close, 3: M_sync, 4: M_unload}
 *   W* = {0: 0, 1: W_1, 2: wheel_close, 3: wheel_sync, 4: wheel_stack + A_w^-1 M_unload}
 * Laws: 0 none, 1 far approach, 2 closing, 3 synchronised approach, 4 stack, 5 retreat, 6
 * fuel-optimal. With k_unload > 0 the wheels are also unloaded in laws 1 to 3, by an additional
 * torque M_w:
 *   M* += M_w,  W* += A_w^-1 M_w,   M_w = clip(-k_unload A_w (Omega - wheel_speed_ref))
 * Omega: wheel speeds; clip limits each axis to M_unload_max. M_w is switched on when a wheel
 * differs from wheel_speed_ref by unload_on wheel_speed_max, and off when none differs by more
 * than unload_off wheel_speed_max. With `prepare` M_w is always on and brings the wheels to
 * wheel_bias instead of wheel_speed_ref; after `prepare` it is off until a wheel exceeds unload_on
 * again. In law 1 without far_wheels M_w is on above unload_off already, because this law commands
 * no wheels. The throttles th of the relay controller command virtual engines, whose force and
 * torque the allocation distributes to the thrusters ((o): product of each element):
 *   F_1 = [main_thrust th_13 - brake_thrust (th_9 + th_10 + th_11 + th_12)/4, 0, 0]
 *   M_1 = relay_torque (o) [(th_6 + th_8 - th_5 - th_7)/2, th_4 - th_2, th_1 - th_3]
 * W_1 = 0. With far_wheels the wheels give the torque M_1: W_1 = -A_w^-1 M_1, and then M_1 = 0.
 * The change between laws is bumpless, the change to and from no law or the retreat immediate: when
 * select_force changes from law to law, D is set to the last command minus F*, and decreases,
 *   D *= exp(-period/blend_time),   F_cmd = F* + D + push [push_force, 0, 0] (law 3; not in D)
 * When select_torque changes from law to law, M* and W* have such a D each.
 * A selection that is not in the list is rejected. Equations: docs/models.md J.5 */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "fmu.h"
#include "mat3.h"
#include "rigid_body.h"
#include "thrusters.h"
#include "time_grid.h"
#include "unloading.h"

enum { NONE, FAR_LAW, CLOSE_LAW, SYNC_LAW, STACK_LAW, RETREAT_LAW, OPTIMAL_LAW, SELECTIONS };

typedef struct {
    double main_thrust, brake_thrust;
    vec3 relay_torque;
    mat3 A_w;
    double far_wheels, push_force, blend_time;
    Unloading unload;
    double sample_period;
} Parameters;
typedef struct {
    double select_force, select_torque, push, throttle[THRUSTERS];
    vec3 F_close_S, M_close_S, wheel_close;
    vec3 F_sync_S, M_sync_S, wheel_sync;
    vec3 F_retreat_S;
    vec3 wheel_stack, M_unload_S;
    vec3 wheel_speed;
    double prepare;
    vec3 wheel_bias, F_opt_S;
} Input;
typedef struct { vec3 F, M, W; } Command;
typedef struct {
    double started, force, torque; /* 1 after the first sample; laws selected at the last sample */
    Command out, D;                /* last command without the push; fading difference D */
    double unloading;
} State;
typedef struct {
    vec3 F_cmd_S, M_cmd_S, wheel_accel_cmd;
    double force_law, torque_law, wheels_unloading;
} Output;
MODEL_STRUCT;

static const Model start = {
    .p = {.main_thrust = 2,
          .brake_thrust = 2,
          .relay_torque = {0.5, 0.5, 0.5},
          .A_w = {{{12, 0, 0}, {0, 15, 0}, {0, 0, 10}}},
          .push_force = 1,
          .blend_time = 5,
          .unload = {.on = 0.7, .off = 0.1, .k = 0, .most = 0.05, .speed_max = 0.3},
          .sample_period = 0.1},
};

static const Variable variables[] = {
    NONNEGATIVE(main_thrust, "N",
                "force along +X at full throttle of the main engine, which thrusters emulate"),
    NONNEGATIVE(brake_thrust, "N",
                "force along -X at full throttle of all four brakes, which thrusters emulate"),
    NONNEGATIVE(relay_torque, "N.m",
                "full torque of the attitude engines per axis, emulated by thrusters or wheels"),
    MATRIX(A_w, "kg.m2", "wheel inertia matrix: wheel speeds to wheel momentum in body axes"),
    SWITCH(far_wheels, "1: the wheels give the torque of law 1 (far approach), 0: the thrusters"),
    NONNEGATIVE(push_force, "N", "force along +X if push = 1, after contact"),
    NONNEGATIVE(blend_time, "s", "time constant of the change from law to law; 0 = immediate"),
    SAMPLE_PERIOD,
    POSITIVE_AS("wheel_speed_max", unload.speed_max, "rad/s", "largest wheel speed, per wheel"),
    NONNEGATIVE_AS("unload_on", unload.on, "1",
                   "unloading begins when a wheel is this share of wheel_speed_max off "
                   "wheel_speed_ref (law 1, far_wheels = 0: unload_off)"),
    NONNEGATIVE_AS("unload_off", unload.off, "1",
                   "unloading ends when every wheel is within this share of wheel_speed_max of "
                   "wheel_speed_ref"),
    NONNEGATIVE_AS("k_unload", unload.k, "1/s", "gain of the unloading in laws 1 to 3; 0: none"),
    NONNEGATIVE_AS("M_unload_max", unload.most, "N.m",
                   "largest torque of unloading in laws 1 to 3, per body axis"),
    PARAMETER_AS("wheel_speed_ref", unload.ref, "rad/s",
                 "wheel speeds to which the unloading leads"),

    MODE_INPUT(select_force, "source of the force, none in law 4 (stack)",
               "none|far|close|sync|none|retreat|optimal"),
    MODE_INPUT(select_torque, "source of the torque", "none|far|close|sync|stack"),
    INPUT(push, "1", "1: push_force acts in law 3, after contact"),
    INPUT(throttle, "1",
          "throttles of the relay controller: 8 attitude, 4 brakes, 1 main engine, 3 unused"),
    INPUT(F_close_S, "N", "force commanded by law 2 (closing), servicer axes"),
    INPUT(M_close_S, "N.m", "torque commanded by law 2 (closing), servicer axes"),
    INPUT(wheel_close, "rad/s2", "wheel acceleration commanded by law 2 (closing)"),
    INPUT(F_sync_S, "N", "force commanded by the synchronised approach, servicer axes"),
    INPUT(M_sync_S, "N.m", "torque commanded by the synchronised approach, servicer axes"),
    INPUT(wheel_sync, "rad/s2", "wheel acceleration commanded by the synchronised approach"),
    INPUT(F_retreat_S, "N", "force of the retreat, servicer axes"),
    INPUT(wheel_stack, "rad/s2", "wheel acceleration commanded by law 4 (stack)"),
    INPUT(M_unload_S, "N.m",
          "torque of the thrusters that unloads the wheels in law 4 (stack), servicer axes"),
    OPTIONAL_INPUT(wheel_speed, "rad/s", "wheel speeds relative to the body; used if k_unload > 0"),
    OPTIONAL_SWITCH(prepare, "1: the wheels are brought to wheel_bias; used if k_unload > 0"),
    OPTIONAL_INPUT(wheel_bias, "rad/s",
                   "wheel speeds in place of wheel_speed_ref while prepare = 1"),
    OPTIONAL_INPUT(F_opt_S, "N", "force commanded by the fuel-optimal law, servicer axes"),

    OUTPUT(F_cmd_S, "N", "commanded force, servicer axes"),
    OUTPUT(M_cmd_S, "N.m", "commanded torque, servicer axes"),
    OUTPUT(wheel_accel_cmd, "rad/s2", "commanded wheel acceleration"),
    MODE(force_law,
         "source of the commanded force, none in law 4 (stack); error if select_force is invalid",
         "none|far|close|sync|none|retreat|optimal"),
    MODE(torque_law, "source of the commanded torque; error if select_torque is invalid",
         "none|far|close|sync|stack"),
    FLAG(wheels_unloading, "1: the wheels are unloaded in laws 1 to 3"),
};

/* J.5-7 */
static void check(const Parameters *p, Problems *problems)
{
    check_positive_definite(problems, "A_w", p->A_w);
    check_unloading(&p->unload, problems);
}

static vec3 relay_force(const Parameters *p, const double th[])
{
    double brakes = (th[8] + th[9] + th[10] + th[11]) / 4;
    return vec(p->main_thrust * th[12] - p->brake_thrust * brakes, 0, 0);
}
static vec3 relay_torque(const Parameters *p, const double th[])
{
    vec3 engines = vec((th[5] + th[7] - th[4] - th[6]) / 2, th[3] - th[1], th[0] - th[2]);
    return times(p->relay_torque, engines);
}

/* number of the law nearest to the input value; -1 if there is no such law: -1 violates the range
 * of the outputs force_law and torque_law, so that the step fails */
/* J.5-6 */
static int selection(double value, int count)
{
    const int n = last_bits(value + ROUNDER, 0xff);
    return n < count && nearest_whole(value) == n ? n : -1;
}

static Unloading unloading_now(const Parameters *p, const Input *u)
{
    Unloading now = p->unload;
    if (u->prepare) now.ref = u->wheel_bias;
    return now;
}

static int may_unload(const Parameters *p, int torque)
{
    return torque >= FAR_LAW && torque <= SYNC_LAW && p->unload.k > 0;
}

/* true if the speeds of the wheels require unloading by the thresholds unload_on and unload_off.
 * While `prepare` is 1, when the caller unloads anyway, the result is false: so the wheels retain
 * their bias afterwards, until one exceeds unload_on. In law 1 the wheels have no other task and
 * are unloaded whenever they are above unload_off, unless they turn the body (far_wheels). */
/* J.5-4 */
static double unloading_active(const Parameters *p, const Input *u, int torque, double before)
{
    if (!may_unload(p, torque) || u->prepare) return 0;
    return unloading_is_on(&p->unload, u->wheel_speed,
                           torque == FAR_LAW && !p->far_wheels ? 1 : before);
}

/* J.5-1 */
static Command selected_command(const Parameters *p, const Input *u, int force, int torque)
{
    vec3 none = vec(0, 0, 0), unload = solve(p->A_w, u->M_unload_S);
    vec3 M_1 = relay_torque(p, u->throttle), W_1 = none;
    if (p->far_wheels) W_1 = neg(solve(p->A_w, M_1)), M_1 = none;
    const vec3 F[SELECTIONS] = {
        none,      relay_force(p, u->throttle), u->F_close_S, u->F_sync_S, none, u->F_retreat_S,
        u->F_opt_S};
    const vec3 M[RETREAT_LAW] = {none, M_1, u->M_close_S, u->M_sync_S, u->M_unload_S};
    const vec3 W[RETREAT_LAW] = {none, W_1, u->wheel_close, u->wheel_sync,
                                 add(u->wheel_stack, unload)};
    return (Command){F[force > 0 ? force : NONE], M[torque > 0 ? torque : NONE],
                     W[torque > 0 ? torque : NONE]};
}

/* the command `now` plus, if `on`, the unloading: opposite torques of thrusters and wheels, whose
 * sum on the body is 0 */
/* J.5-5 */
static Command with_unloading(const Parameters *p, const Input *u, double on, Command now)
{
    if (!on) return now;
    Unloading unload = unloading_now(p, u);
    vec3 M = unloading_torque(&unload, on, p->A_w, u->wheel_speed);
    return (Command){now.F, add(now.M, M), add(now.W, solve(p->A_w, M))};
}

static int is_law(double selection, int last)
{
    return selection == OPTIMAL_LAW || (selection >= FAR_LAW && selection <= last);
}

/* factor on D after a change of the selected law: 1 from law to law; 0 to or from no law or the
 * retreat, where the command changes at once; last: largest number of a law before the retreat */
/* J.5-3 */
static double blend_factor(const Parameters *p, double before, double now, int last)
{
    return p->blend_time > 0 && is_law(before, last) && is_law(now, last);
}

/* J.5-2 */
static void blend(const Parameters *p, State *x, Command now, int force, int torque, double period)
{
    double fade = p->blend_time > 0 ? exponential(-period / p->blend_time) : 0;
    x->D = (Command){scale(fade, x->D.F), scale(fade, x->D.M), scale(fade, x->D.W)};
    if (x->started && force != x->force) {
        double factor = blend_factor(p, x->force, force, SYNC_LAW);
        x->D.F = scale(factor, sub(x->out.F, now.F));
    }
    if (x->started && torque != x->torque) {
        double factor = blend_factor(p, x->torque, torque, STACK_LAW);
        x->D.M = scale(factor, sub(x->out.M, now.M));
        x->D.W = scale(factor, sub(x->out.W, now.W));
    }
}

static void select_commands(const Parameters *p, const Input *u, State *x, Output *y, double period)
{
    int force = selection(u->select_force, SELECTIONS);
    int torque = selection(u->select_torque, RETREAT_LAW);
    x->unloading = unloading_active(p, u, torque, x->unloading);
    double on = x->unloading || (u->prepare && may_unload(p, torque));
    Command now = with_unloading(p, u, on, selected_command(p, u, force, torque));
    blend(p, x, now, force, torque, period);
    x->out = (Command){add(now.F, x->D.F), add(now.M, x->D.M), add(now.W, x->D.W)};
    x->started = 1;
    x->force = force;
    x->torque = torque;

    double push = force == SYNC_LAW ? u->push * p->push_force : 0;
    y->F_cmd_S = add(x->out.F, vec(push, 0, 0));
    y->M_cmd_S = x->out.M;
    y->wheel_accel_cmd = x->out.W;
    y->force_law = force;
    y->torque_law = torque;
    y->wheels_unloading = on;
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    State first = {0}, nothing = {0};
    (void)t;
    *x = nothing;
    select_commands(p, u, &first, y, p->sample_period);
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    for (Sample s = first_sample(t, h, p->sample_period); s.left > 0; s = next_sample(s))
        select_commands(p, u, x, y, s.period);
}

FMU_MODEL("command_selector",
          "Selection between the laws of a mission: one force, one torque, bumpless between laws");
