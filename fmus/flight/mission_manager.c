/* mission_manager.c - one mission from 500 m to a stack at rest: phases, holds with go and no-go,
 * reasons to end an approach, the range profile on the grasp axis, and the retreat.
 *
 * One sample, in this order, with at most one change of phase:
 *   1 the last valid relative state is stored
 *   2 the timers of "axis or pointing error" (near the target), "too fast" (before capture) and
 *     "no capture possible" (hold 2) are updated
 *   3 abort of the monitor -> ABORTED; else, before capture, the first reason to retreat -> RETREAT
 *   4 else the condition of the phase: if it has held for dwell -> next phase
 *   5 outputs of the resulting phase
 *
 * rho = r_S - r_T,  R = |rho|;  a = C_TN^T p_T, l = rho.a, d = |rho - l a|; p_T: parameter, the
 * grasp axis in target axes; l, d: distances along and from the grasp axis. Speeds in conditions of
 * phases are as seen in H up to hold 2, as seen in T from the fly-around on; "too fast" is
 * for the speed as seen in H. An input from the ground has an effect only while it is > 0. Neither
 * retreat nor abort ends RIGIDISE, DETUMBLE and STACK. With budget > 0 the estimated tumble rate
 * decides at hold 2 whether the target can be captured, and how: range of the fly-around, rate of
 * motion about the target as seen in T, wheel speeds before the fly-around (mission_budget.h).
 * After a time-out of FINAL or HOLD_3 the servicer backs off to the range of the fly-around while
 * attempts are left. With by_arm the arm mates from L_3: the servicer stays there without a push.
 * Equations, numbers: section J of docs/models.md. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "earth.h"
#include "mission_aim.h"
#include "mission_budget.h"
#include "mission_retreat.h"
#include "mission_window.h"

typedef MissionParameters Parameters;
typedef MissionInput Input;

typedef struct {
    double runs, since;
} Timer; /* runs: 1 while a condition holds; since: time from which it holds */
typedef struct {
    double begun, phase, t_phase, reason, attempt, torque;
    double t_valid;
    RelativeState valid; /* last valid state, at time t_valid */
    vec3 axis_H;         /* grasp axis at t_valid */
    /* timers: condition of the phase, contact, error, too fast, verdict against a capture */
    Timer good, touched, error, fast, doomed;
    Profile profile;
    double spins;  /* 1: the servicer turns with the target */
    Budget budget; /* updated up to HOLD_2; later only its wheel speeds `bias` */
    Aim aim;
    vec3 dv_N;
    double planned, clearance; /* 1: a retreat was planned; least range of the drift after it */
} State;
typedef struct {
    double phase, t_phase, reason, attempt;
    double select_force, select_torque, active_far, active_close, active_sync, active_stack;
    double L_ref, dL_ref, ddL_ref;
    quat q_VN;
    vec3 omega_VN_V;
    double approaching, monitor_valid, latch_enable, release, push, arm_mode_cmd, momentum;
    vec3 F_retreat_S, dv_left_N;
    double clearance;
    double verdict, dv_ahead, steer_max, prepare, spin;
    vec3 wheel_bias;
    double goal, L_goal, T_goal;
} Output;
MODEL_STRUCT;

/* ---- phases ---- */
enum { NONE, FAR_LAW, CLOSE_LAW, SYNC_LAW, STACK_LAW, MANAGER, OPTIMAL_LAW, AS_BEFORE };
enum { NO_GOAL, TO_POINT, TO_AXIS, ALONG_AXIS }; /* goals of the fuel-optimal law */
enum { STOW, DEPLOY, GRASP, REST };              /* commands to the arm */
/* reasons to leave a phase; a verdict against a capture (mission_budget.h, 1 to 4) is the reason
 * ATTEMPTS + verdict */
enum { NO_REASON, ABORT, GROUND, NAVIGATION, PROPELLANT, ERROR, TOO_FAST, TIME_OUT, ATTEMPTS };

static const struct {
    int force, torque, next;
    int near; /* 1: on the grasp axis: errors are monitored, nav_near applies in place of nav_far */
    int before;  /* 1: before capture, a retreat is possible */
    int profile; /* 1: a range profile begins with this phase */
    int arm;     /* command to the arm if by_arm = 1 */
} phases[PHASES] = {
    /* clang-format off */
    /*             force      torque     to         near before profile arm */
    [FAR]       = {FAR_LAW,   FAR_LAW,   HOLD_1,    0,   1,     1, STOW},
    [HOLD_1]    = {FAR_LAW,   FAR_LAW,   CLOSING,   0,   1,     0, STOW},
    [CLOSING]   = {CLOSE_LAW, CLOSE_LAW, HOLD_2,    0,   1,     0, STOW},
    [HOLD_2]    = {CLOSE_LAW, CLOSE_LAW, FLYAROUND, 0,   1,     0, STOW},
    [FLYAROUND] = {SYNC_LAW,  SYNC_LAW,  FINAL,     0,   1,     1, STOW},
    [FINAL]     = {SYNC_LAW,  SYNC_LAW,  HOLD_3,    1,   1,     1, STOW},
    [HOLD_3]    = {SYNC_LAW,  SYNC_LAW,  MATING,    1,   1,     1, DEPLOY},
    [MATING]    = {SYNC_LAW,  SYNC_LAW,  RIGIDISE,  1,   1,     1, GRASP},
    [RIGIDISE]  = {NONE,      NONE,      DETUMBLE,  0,   0,     0, REST},
    [DETUMBLE]  = {STACK_LAW, STACK_LAW, STACK,     0,   0,     0, REST},
    [STACK]     = {STACK_LAW, STACK_LAW, STACK,     0,   0,     0, REST},
    [BACKOFF]   = {SYNC_LAW,  SYNC_LAW,  HOLD_3,    1,   1,     1, DEPLOY},
    [RETREAT]   = {MANAGER,   AS_BEFORE, SAFE,      0,   0,     0, STOW},
    [SAFE]      = {NONE,      AS_BEFORE, FAR,       0,   0,     0, STOW},
    [ABORTED]   = {NONE,      AS_BEFORE, ABORTED,   0,   0,     0, STOW},
    /* clang-format on */
};

static int phase_of(const State *x) { return (int)x->phase; }

/* law that commands the torque. In the far phases FAR_LAW turns the thrust axis along its force.
 * The fuel-optimal force needs no thrust axis, so with it CLOSE_LAW points the servicer at the
 * target. */
static int torque_law(const Parameters *p, int phase)
{
    int law = phases[phase].torque;
    return law == FAR_LAW && p->use_optimal ? CLOSE_LAW : law;
}

/* true if the angular momentum of both bodies, which the stack will have, does not exceed
 * momentum_max, or if momentum_max is 0 */
/* J.1-10 */
static int may_grasp(const Parameters *p, const Geometry *g)
{
    return p->momentum_max == 0 || g->momentum <= p->momentum_max;
}

static int wheels_within_budget(const Parameters *p, const Input *u)
{
    return p->budget == 0 || largest_size(u->wheel_speed) <= p->budget * p->wheel_speed_max;
}
static int wheels_are_prepared(const Parameters *p, const Input *u, const Budget *b)
{
    double off = largest_size(sub(u->wheel_speed, b->bias));
    return p->budget == 0 || off <= p->bias_tol * p->wheel_speed_max;
}

/* true at the end of the fly-around: in front of the grasp axis, turning with the target */
static int is_before_axis(const Parameters *p, const Input *u, const State *x, const Geometry *g,
                          double t)
{
    return x->spins && reached(t, x->t_phase + profile_duration(p, &x->profile)) &&
           u->relative_valid > 0 && g->los <= p->angle_2 &&
           fabs(g->R - x->profile.to) <= p->tol_2 && g->v_rel <= p->v_2 &&
           g->pointing <= p->angle_abort && (p->rate_2 == 0 || g->w_rel <= p->rate_2) &&
           wheels_within_budget(p, u);
}

/* true if the range profile has ended and the servicer rests in target axes at the third hold */
static int is_at_hold_3(const Parameters *p, const State *x, const Geometry *g, double t)
{
    return reached(t, x->t_phase + profile_duration(p, &x->profile)) && g->d <= p->tol_3 &&
           fabs(g->l - p->L_3) <= p->tol_3 && g->v_rel <= p->v_3 && g->pointing <= p->angle_3 &&
           g->w_rel <= p->rate_3;
}

/* true if the servicer backs off, after a time-out, beyond the third hold to the fly-around's
 * range */
static int is_far_back(const Parameters *p, const State *x)
{
    return x->phase == BACKOFF && x->profile.to != p->L_3;
}

/* true if the condition of the present phase holds; the next phase begins when it has held for
 * `dwell` seconds */
/* J.1-1 */
static int condition_holds(const Parameters *p, const Input *u, const State *x, const Geometry *g,
                           double t)
{
    int valid = u->relative_valid > 0;
    double psi = p->line_angle, off_R_1 = fabs(g->R - p->R_1), v_H = norm(g->drho_H);
    vec3 at_R_2 = scale(p->R_2, vec(cosine(psi), sine(psi), 0));
    int at_hold_2 = valid && norm(sub(g->rho_H, at_R_2)) <= p->tol_2 && v_H <= p->v_2;
    int at_hold_3 = valid && is_at_hold_3(p, x, g, t);
    const int holds[PHASES] = {
        /* clang-format off */
        [FAR]       = valid && off_R_1 <= p->tol_1 && v_H <= p->v_1,
        [HOLD_1]    = valid && u->go_1 > 0 && off_R_1 <= 2 * p->tol_1,
        [CLOSING]   = at_hold_2,
        [HOLD_2]    = at_hold_2 && u->go_2 > 0 && x->budget.verdict == CAN_CAPTURE &&
                      wheels_are_prepared(p, u, &x->budget),
        [FLYAROUND] = is_before_axis(p, u, x, g, t),
        [FINAL]     = at_hold_3,
        [HOLD_3]    = at_hold_3 && u->go_3 > 0 && may_grasp(p, g) && wheels_within_budget(p, u),
        [MATING]    = 0, /* left by update_mating() */
        [RIGIDISE]  = u->hard > 0,
        [DETUMBLE]  = u->done > 0 && norm(u->S.omega) <= p->settle_rate,
        [STACK]     = 0,
        [BACKOFF]   = is_far_back(p, x) ? is_before_axis(p, u, x, g, t) : at_hold_3,
        [RETREAT]   = norm(x->dv_N) == 0 && g->R >= p->R_safe,
        [SAFE]      = valid && u->resume > 0,
        [ABORTED]   = 0,
        /* clang-format on */
    };
    return holds[phase_of(x)];
}

static const Model start = {
    .p = {.mu = MU_JGM3,
          .p_T = {1, 0, 0},
          .line_angle = -PI / 2,
          .R_1 = 100,
          .R_2 = 20,
          .L_3 = 3,
          .L_end = 1.48,
          .tol_1 = 5,
          .v_1 = 0.03,
          .tol_2 = 1,
          .v_2 = 0.03,
          .angle_2 = 0.06,
          .tol_3 = 0.05,
          .v_3 = 0.01,
          .angle_3 = 0.0524,
          .rate_3 = 0.005,
          .v_final = 0.1,
          .v_mate = 0.03,
          .ramp_mate = 10,
          .v_back = 0.05,
          .capture_time = 20,
          .settle_rate = 2e-4,
          .v_retreat = 0.1,
          .v_drift = 0.05,
          .F_retreat = 0.9,
          .R_safe = 200,
          .drift_time = 86400,
          .drift_step = 120,
          .dwell = {30, 60, 30, 30, 30, 10, 20, 0, 0, 0, 0, 10, 0, 0, 0},
          .time_out = {7200, 3600, 3600, 3600, 3600, 1200, 1800, 120, 0, 1200, 0, 600, 0, 0, 0},
          .attempts = 2,
          .mass_dry = 85,
          .reserve = 1,
          .nav_far = 10,
          .nav_near = 2,
          .d_abort = {0.2, 0.1},
          .angle_abort = 0.2618,
          .error_dwell = 3,
          .v_0 = {0.6, 0.06},
          .v_slope = {0.01, 0.0083},
          .tumble_max = 0.04,
          .speed_dwell = 5,
          .mass_T = 150,
          .J_T = {{{100, 0, 0}, {0, 150, 0}, {0, 0, 90}}},
          .J_S = {{{200, 0, 0}, {0, 250, 0}, {0, 0, 150}}},
          .F_axis = 2,
          .R_around = 14,
          .w_steer = 0.005,
          .steer_least = 0.002,
          .Isp = 220,
          .A_w = {{{12, 0, 0}, {0, 15, 0}, {0, 0, 10}}},
          .wheel_speed_max = 0.3,
          .bias_max = 0.65,
          .bias_tol = 0.1,
          .spin_time = 60,
          .abort_relative = 1,
          .axis_radius = 3,
          .monitor_stack = 1,
          .far_time = 1200,
          .sample_period = 0.1},
    .u = {.T = {.r = {42164000, 0, 0}, .v = {0, 3074.66, 0}, .q = {1, 0, 0, 0}},
          .S = {.r = {42164000, -100, 0}, .v = {0.00729, 3074.66, 0}, .q = {1, 0, 0, 0}},
          .mass = 100,
          .relative_valid = 1,
          .go_1 = 1,
          .go_2 = 1,
          .go_3 = 1},
};

static const Variable variables[] = {
    MISSION_PARAMETERS,

    MISSION_INPUTS,

    MODE(phase, "phase of the mission",
         "far|hold 1|closing|hold 2|fly-around|final|hold 3|mating|rigidise|detumble|stack|"
         "back-off|retreat|safe|aborted"),
    OUTPUT(t_phase, "s", "time at which the phase began"),
    MODE(reason, "reason for which the previous phase ended",
         "end condition or failed attempt|abort|ground|navigation|propellant reserve|"
         "axis or pointing error|too fast|time-out|attempts|too little force|too much momentum|"
         "too little propellant|tumble too fast for probe"),
    NONNEGATIVE_OUTPUT(attempt, "1",
                       "attempts since the far approach began: matings, and final approaches "
                       "broken off by a time-out"),
    MODE(select_force, "source of the force, none in law 4 (stack)",
         "none|far|close|sync|none|retreat|optimal"),
    MODE(select_torque, "source of the torque", "none|far|close|sync|stack"),
    FLAG(active_far, "1: guidance and controller of the far approach are active"),
    FLAG(active_close, "1: guidance and controller of the closing are active"),
    FLAG(active_sync, "1: guidance and controller of the synchronised approach are active"),
    FLAG(active_stack, "1: guidance and controller of the stack are active"),
    OUTPUT(L_ref, "m", "reference distance from the target; on the grasp axis from phase 5 on"),
    OUTPUT(dL_ref, "m/s", "rate of L_ref"),
    OUTPUT(ddL_ref, "m/s2", "acceleration of L_ref"),
    OUTPUT(q_VN, "1",
           "attitude of V relative to N, scalar first; V: virtual target of the closing, X to the "
           "reference position"),
    OUTPUT(omega_VN_V, "rad/s", "angular velocity of V relative to N, V axes"),
    FLAG(approaching, "1: phases 5 to 11, final to back-off; for the inputs approaching of "
                      "safety_monitor and safety_filter"),
    FLAG(monitor_valid, "1: the safety monitor may use the relative state"),
    FLAG(latch_enable, "1: the latch is armed"),
    FLAG(release, "1: the latch releases; always 0, the manager never releases the target"),
    FLAG(push, "1: the servicer pushes, during mating after contact"),
    MODE(arm_mode_cmd, "commanded mode of the arm; 0 if by_arm = 0", "stow|deploy|grasp|rest"),
    NONNEGATIVE_OUTPUT(momentum, "N.m.s",
                       "angular momentum of servicer and target about their common centre of mass, "
                       "without spin of the wheels"),
    OUTPUT(F_retreat_S, "N", "force of the retreat, servicer axes"),
    OUTPUT(dv_left_N, "m/s", "velocity increment of the retreat that remains, N axes"),
    OUTPUT(clearance, "m", "least range of the drift after the retreat, as planned; -1: none yet"),
    MODE(verdict, "whether capture is possible; 0 if budget = 0; fixed after hold 2",
         "yes|too little force|too much momentum|too little propellant|tumble too fast for probe"),
    NONNEGATIVE_OUTPUT(dv_ahead, "m/s",
                       "predicted velocity increment for turning with the target from fly-around "
                       "to mating; fixed after hold 2"),
    NONNEGATIVE_OUTPUT(steer_max, "rad/s",
                       "largest steering rate about the target, seen in T, that F_axis permits at "
                       "this range; at most w_steer"),
    FLAG(prepare, "1: the wheels are brought to wheel_bias, from the closing to the fly-around"),
    FLAG(spin, "1: the servicer may turn with the target; 0: it still waits in the fly-around"),
    OUTPUT(wheel_bias, "rad/s",
           "wheel speeds to reach before turning with the target; 0 if prepare = 0"),
    MODE(goal, "goal of the fuel-optimal law; 0 if use_optimal = 0",
         "inactive|point on the line of holds|grasp axis at constant range|along the grasp axis"),
    OUTPUT(L_goal, "m",
           "range at the end of the goal; 0 (after hold 1): the fuel-optimal law uses its L_end"),
    OUTPUT(T_goal, "s",
           "duration of the goal; 0 (after hold 1): the fuel-optimal law uses its duration"),
};

/* J.1-12 */
static void check(const Parameters *p, Problems *problems) { check_mission(p, problems); }

/* ---- hold timers: start at the first sample at which a condition holds, reset when it does not
 * ---- */
static Timer hold_timer(Timer c, int holds, double t)
{
    if (!holds) return (Timer){0, 0};
    return c.runs ? c : (Timer){1, t};
}
static int has_held(Timer c, double duration, double t)
{
    return c.runs && reached(t, c.since + duration);
}
static int is_longer_ago(double since, double duration, double t)
{
    return !reached(since + duration, t);
}

/* tumble rate that is added to v_slope of the speed limit; 0 in phases in which the servicer does
 * not move with the target */
static double tumble_of_limit(const Parameters *p, const State *x, const Geometry *g)
{
    return phases[phase_of(x)].force == SYNC_LAW ? smaller(g->tumble, p->tumble_max) : 0;
}

/* sets `spins`: in the fly-around the servicer first rests in H. It begins to turn with the target
 * when the range profile has ended and the grasp axis is about to pass the servicer */
static void update_spin(const Parameters *p, const Input *u, State *x, const Geometry *g, double t)
{
    double begun = x->t_phase + profile_duration(p, &x->profile);
    if (x->phase != FLYAROUND) x->spins = x->phase > FLYAROUND;
    else if (u->relative_valid > 0 && reached(t, begun))
        x->spins = x->spins || window_is_open(p, g->w_T, g->a, g->rho, t - begun);
}

/* step 2: updates the timers of an error near the target, of too high a speed before capture and,
 * in hold 2, of a verdict against the capture */
static void update_timers(const Parameters *p, const Geometry *g, State *x, double t)
{
    int near = phases[phase_of(x)].near, before = phases[phase_of(x)].before;
    double d_most = p->d_abort[0] + p->d_abort[1] * larger(g->l - p->L_3, 0);
    double v_most = p->v_0[near] + (p->v_slope[near] + tumble_of_limit(p, x, g)) * g->R;
    x->error = hold_timer(x->error, near && (g->d > d_most || g->pointing > p->angle_abort), t);
    x->fast = hold_timer(x->fast, before && norm(g->drho_H) > v_most, t);
    x->doomed = hold_timer(x->doomed, x->phase == HOLD_2 && x->budget.verdict != CAN_CAPTURE, t);
}

/* up to hold 2, computes the whole budget from the estimated state; afterwards only the wheel
 * speeds, until the servicer turns with the target */
static void update_budget(const Parameters *p, const Input *u, State *x, const Geometry *g)
{
    if (u->relative_valid <= 0 || x->spins) return;
    if (x->phase <= HOLD_2) x->budget = budget_for(p, u, g);
    else x->budget.bias = wheel_bias(p, g->w_mean_S);
}

/* ---- changes of phase ---- */
static void enter_phase(const Parameters *p, State *x, const Geometry *g, double phase,
                        double reason, double t)
{
    int leaves_by_axis = p->abort_relative && phases[phase_of(x)].near;
    x->phase = phase;
    x->reason = reason;
    x->t_phase = t;
    x->good = x->touched = (Timer){0, 0};
    if (phase == MATING) x->attempt++;
    if (phase == FAR) x->attempt = 0;
    if (phase == FLYAROUND) x->profile = (Profile){phase, t, p->R_2, x->budget.R};
    else if (phases[phase_of(x)].profile) x->profile = (Profile){phase, t, g->l, p->L_3};
    int torque = torque_law(p, phase_of(x));
    if (torque != AS_BEFORE && torque != NONE) x->torque = torque;
    if (phase == CLOSING) x->aim = aim_from(p, g->rho_H, g->R);
    if (phase != RETREAT) return;
    RelativeState from = p->abort_relative ? drifted(&x->valid, t - x->t_valid) : x->valid;
    Escape escape = plan_escape(p, &from, leaves_by_axis ? x->axis_H : vec(0, 0, 0));
    x->dv_N = escape.dv_N;
    x->clearance = escape.clearance;
    x->planned = 1;
}

/* step 3 of a sample (head of this file): first reason to retreat that applies, or NO_REASON */
/* J.1-3, J.1-5 */
static int reason_to_retreat(const Parameters *p, const Input *u, const State *x, double t)
{
    double lost = phases[phase_of(x)].near ? p->nav_near : p->nav_far;
    double longest = phase_of(x) == MATING ? 0 : p->time_out[phase_of(x)];
    const int holds[ATTEMPTS] = {
        /* clang-format off */
        [GROUND]     = u->retreat > 0,
        [NAVIGATION] = is_longer_ago(x->t_valid, lost, t),
        [PROPELLANT] = u->mass - p->mass_dry < p->reserve,
        [ERROR]      = has_held(x->error, p->error_dwell, t),
        [TOO_FAST]   = has_held(x->fast, p->speed_dwell, t),
        [TIME_OUT]   = longest > 0 && reached(t, x->t_phase + longest),
        /* clang-format on */
    };
    for (int reason = GROUND; reason < ATTEMPTS; reason++)
        if (holds[reason]) return reason;
    if (!has_held(x->doomed, p->dwell[HOLD_2], t)) return NO_REASON;
    return ATTEMPTS + (int)x->budget.verdict;
}

/* true if, after a time-out of FINAL or HOLD_3, the final approach may be repeated from the range
 * of the fly-around; not while HOLD_3 waits for go_3, or for a momentum below its limit */
/* J.1-7 */
static int may_begin_anew(const Parameters *p, const Input *u, const State *x, const Geometry *g)
{
    int waits = x->phase == HOLD_3 && (u->go_3 <= 0 || !may_grasp(p, g));
    return (x->phase == FINAL || x->phase == HOLD_3) && !waits && x->attempt + 1 < p->attempts;
}

static void back_off_far(const Parameters *p, State *x, const Geometry *g, double t)
{
    enter_phase(p, x, g, BACKOFF, TIME_OUT, t);
    x->attempt++;
    x->profile.to = x->budget.R;
}

/* step 4 of a sample (head of this file) in MATING: next phase after soft capture or after a failed
 * attempt */
/* J.1-6 */
static void update_mating(const Parameters *p, const Input *u, State *x, const Geometry *g,
                          double t)
{
    double longest = p->time_out[MATING];
    x->touched = hold_timer(x->touched, x->touched.runs || u->contact > 0, t);
    if (u->soft > 0) {
        enter_phase(p, x, g, RIGIDISE, NO_REASON, t);
        return;
    }
    if (!has_held(x->touched, p->capture_time, t) &&
        !(longest > 0 && reached(t, x->t_phase + longest)))
        return;
    if (x->attempt < p->attempts) enter_phase(p, x, g, BACKOFF, NO_REASON, t);
    else enter_phase(p, x, g, RETREAT, ATTEMPTS, t);
}

/* step 4 in other phases: next phase after the condition of the present one has held for `dwell` */
static void advance_phase(const Parameters *p, const Input *u, State *x, const Geometry *g,
                          double t)
{
    x->good = hold_timer(x->good, condition_holds(p, u, x, g, t), t);
    if (has_held(x->good, p->dwell[phase_of(x)], t))
        enter_phase(p, x, g, is_far_back(p, x) ? FINAL : phases[phase_of(x)].next, NO_REASON, t);
}

/* J.1-4 */
static int may_abort(const State *x)
{
    return x->phase != RIGIDISE && x->phase != DETUMBLE && x->phase != STACK && x->phase != ABORTED;
}

/* J.1-2 */
static void change_phase(const Parameters *p, const Input *u, State *x, const Geometry *g, double t)
{
    int reason = phases[phase_of(x)].before ? reason_to_retreat(p, u, x, t) : NO_REASON;
    if (u->abort > 0 && may_abort(x)) enter_phase(p, x, g, ABORTED, ABORT, t);
    else if (reason == TIME_OUT && may_begin_anew(p, u, x, g)) back_off_far(p, x, g, t);
    else if (reason) enter_phase(p, x, g, RETREAT, reason, t);
    else if (x->phase == MATING) update_mating(p, u, x, g, t);
    else advance_phase(p, u, x, g, t);
}

/* ---- outputs ---- */
static void publish_phase(const State *x, Output *y)
{
    y->phase = x->phase;
    y->t_phase = x->t_phase;
    y->reason = x->reason;
    y->attempt = x->attempt;
    y->clearance = x->planned ? x->clearance : -1;
}

/* goal of the fuel-optimal law. In the fly-around it is the hold point until the servicer turns
 * with the target. If the range of the fly-around is below R_2, the fly-around and all phases after
 * it have no goal, as only a circular path is possible there. */
static int goal_of(const Parameters *p, const State *x)
{
    int around = x->spins ? TO_AXIS : TO_POINT, wide = x->budget.R == p->R_2;
    const int goals[PHASES] = {[FAR] = TO_POINT,
                               [HOLD_1] = TO_POINT,
                               [CLOSING] = TO_POINT,
                               [HOLD_2] = TO_POINT,
                               [FLYAROUND] = wide ? around : NO_GOAL,
                               [FINAL] = wide ? ALONG_AXIS : NO_GOAL,
                               [HOLD_3] = wide ? ALONG_AXIS : NO_GOAL};
    return p->use_optimal ? goals[phase_of(x)] : NO_GOAL;
}

/* J.1-8 */
static void publish_selection(const Parameters *p, const State *x, Output *y)
{
    int force = phases[phase_of(x)].force, torque = torque_law(p, phase_of(x));
    if (torque == AS_BEFORE) torque = (int)x->torque;
    int to_hold_1 = p->use_optimal && x->phase <= HOLD_1;
    y->goal = goal_of(p, x);
    y->L_goal = to_hold_1 ? p->R_1 : 0;
    y->T_goal = to_hold_1 ? p->far_time : 0;
    if (y->goal != NO_GOAL) force = OPTIMAL_LAW;
    y->select_force = force;
    y->select_torque = torque;
    y->active_far = force == FAR_LAW || torque == FAR_LAW;
    y->active_close = force == CLOSE_LAW || torque == CLOSE_LAW;
    y->active_sync = force == SYNC_LAW || torque == SYNC_LAW;
    y->active_stack = force == STACK_LAW || torque == STACK_LAW;
}

/* The keep-out zone does not apply while `approaching` is 1. In RETREAT and SAFE within R_2
 * monitor_valid is 0: otherwise the monitor would report the position as an entry into the zone.
 * After capture monitor_valid has the value of monitor_stack; 0 prevents an abort, whose force
 * would turn the stack. */
/* J.1-9, J.1-13 */
static void publish_switches(const Parameters *p, const Input *u, const State *x, const Geometry *g,
                             Output *y)
{
    int docked = x->phase >= RIGIDISE && x->phase <= STACK;
    int leaving = (x->phase == RETREAT || x->phase == SAFE) && g->R < p->R_2;
    y->approaching = x->phase >= FINAL && x->phase <= BACKOFF;
    y->monitor_valid = docked ? p->monitor_stack : (u->relative_valid > 0 && !leaving);
    y->latch_enable = x->phase == MATING || docked;
    y->release = 0;
    y->push = !p->by_arm && x->phase == MATING && x->touched.runs;
    y->arm_mode_cmd = p->by_arm && !is_far_back(p, x) ? phases[phase_of(x)].arm : STOW;
    y->momentum = g->momentum;
}

static void publish_budget(const Parameters *p, const Input *u, const State *x, const Geometry *g,
                           Output *y)
{
    int prepares = p->budget > 0 && x->phase >= CLOSING && x->phase <= FLYAROUND;
    y->verdict = x->budget.verdict;
    y->dv_ahead = x->budget.dv;
    y->steer_max = steering_left(p, u->mass, g->tumble, larger(g->R, p->L_3));
    y->prepare = prepares;
    y->spin = x->phase == FLYAROUND ? x->spins : 1;
    y->wheel_bias = prepares ? wheels_with(p, x->budget.bias, u->S.omega) : vec(0, 0, 0);
}

/* frame V of the closing if aim_radius > 0: the frame for the path along the tangent, or, near the
 * hold, the frame that turns towards the hold (mission_aim.h). Begins the turn when the servicer
 * comes near the hold */
static AimFrame aim_frame(const Parameters *p, State *x, const Geometry *g, double t)
{
    AimFrame V = {identity(1), vec(0, 0, 0)};
    if (x->aim.mode == ON_TANGENT && g->R > p->R_2 + NEAR_HOLD)
        return frame_on_tangent(p, &x->aim, g->rho_H, g->drho_H);
    if (x->aim.mode == ON_TANGENT) {
        V.C_VH =
            frame_on_tangent(p, &x->aim, scale((p->R_2 + NEAR_HOLD) / g->R, g->rho_H), vec(0, 0, 0))
                .C_VH;
        x->aim = turn_to_hold(p, &V, t);
    }
    return frame_turning(p, &x->aim, t);
}

/* publishes frame V: the Hill frame rotated to the line of the hold points, C_VN = Rz(psi) C_HN,
 * or, in the closing with aim_radius > 0, the frame from aim_frame() */
static void publish_virtual_target(const Parameters *p, State *x, const Geometry *g, Output *y,
                                   double t)
{
    SineCosine psi = sine_and_cosine(p->line_angle);
    AimFrame V = {rows(vec(psi.c, psi.s, 0), vec(-psi.s, psi.c, 0), vec(0, 0, 1)), vec(0, 0, 0)};
    if (x->phase != CLOSING) x->aim.mode = AT_HOLD;
    if (x->aim.mode != AT_HOLD) V = aim_frame(p, x, g, t);
    y->q_VN = quat_of_dcm(matmul(V.C_VH, g->H.C_HN));
    y->omega_VN_V = g->H.w_H;
    if (x->aim.mode != AT_HOLD) y->omega_VN_V = mul(V.C_VH, add(g->H.w_H, V.omega_H));
}

/* J.2-1 */
static void publish_profile(const Parameters *p, const State *x, Output *y, double t)
{
    Distance now = profile_at(p, &x->profile, t);
    y->L_ref = now.L;
    y->dL_ref = now.d;
    y->ddL_ref = now.dd;
}

static void manage(const Parameters *p, const Input *u, State *x, Output *y, double t,
                   double period)
{
    Geometry g = geometry(p, u);
    RelativeState seen = {g.H.C_HN, g.H.w_H, g.rho_H, g.drho_H};
    vec3 axis_H = mul(g.H.C_HN, tmul(dcm_of_quat(canonical(u->T.q)), p->p_T));
    if (!x->begun)
        *x = (State){.begun = 1,
                     .t_phase = t,
                     .torque = torque_law(p, FAR),
                     .t_valid = t,
                     .valid = seen,
                     .axis_H = axis_H,
                     .budget = budget_for(p, u, &g)};
    if (u->relative_valid > 0) x->t_valid = t, x->valid = seen, x->axis_H = axis_H;
    update_budget(p, u, x, &g);
    update_timers(p, &g, x, t);
    change_phase(p, u, x, &g, t);
    update_spin(p, u, x, &g, t);

    publish_phase(x, y);
    publish_selection(p, x, y);
    publish_switches(p, u, x, &g, y);
    publish_budget(p, u, x, &g, y);
    publish_virtual_target(p, x, &g, y, t);
    publish_profile(p, x, y, t);
    vec3 F_N = x->phase == RETREAT ? burn(p, u->mass, period, &x->dv_N) : vec(0, 0, 0);
    y->F_retreat_S = mul(g.C_SN, F_N);
    y->dv_left_N = x->dv_N;
}

/* J.1-11 */
static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    State first = {0}, nothing = {0};
    *x = nothing;
    manage(p, u, &first, y, t, p->sample_period);
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    for (Sample s = first_sample(t, h, p->sample_period); s.left > 0; s = next_sample(s))
        manage(p, u, x, y, s.t, s.period);
}

FMU_MODEL("mission_manager",
          "Mission from far approach to a stack at rest: phases, holds, range profile, retreat");
