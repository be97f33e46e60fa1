/* core_headers.c - functions of the core headers as a library for the unit tests.
 *
 * The tests read the signatures from the lines CALL(result, function, (parameters), (arguments)).
 * */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "arc.h"
#include "arm.h"
#include "attitude.h"
#include "carried_frame.h"
#include "cholesky.h"
#include "finite.h"
#include "index.h"
#include "interface.h"
#include "limited_roll.h"
#include "line_of_sight.h"
#include "mission_aim.h"
#include "mission_budget.h"
#include "mission_retreat.h"
#include "motion.h"
#include "optimal_problem.h"
#include "riccati.h"
#include "rigid_body.h"
#include "small_rotation.h"
#include "symmetric3.h"
#include "time_grid.h"

#define between between_ends /* another between() is in arc.h */
#include "optimal_motion.h"
#undef between

#define CALL(result, function, parameters, arguments) \
    result call_##function parameters;                \
    result call_##function parameters { return function arguments; }

/* arc.h */
CALL(Square, square_along, (vec3 a, vec3 b, vec3 c, vec3 d), ((vec3[4]){a, b, c, d}))

/* arm.h: mass matrix H, by columns, of the numbers of an Arm */
enum { SPEEDS = 6 + ARM_JOINTS };

void call_mass_matrix(const double *arm, double m_0, const double J_S[9], const double q[7],
                      double H[SPEEDS * SPEEDS]);
void call_mass_matrix(const double *arm, double m_0, const double J_S[9], const double q[7],
                      double H[SPEEDS * SPEEDS])
{
    Arm a;
    mat3 J;
    memcpy(&a, arm, sizeof a);
    memcpy(&J, J_S, sizeof J);
    Chain chain;
    Links links;
    Tree tree;
    Composite base = body_at_S(m_0, J);
    set_chain(&chain, &a);
    place_links(&tree, &links, &chain, q);
    set_link_inertias(&links, &chain);
    set_mass_matrix(&tree, &links, &base);
    memset(H, 0, SPEEDS * SPEEDS * sizeof *H);
    for (int j = 0; j < 6 + chain.joints; j++) {
        Speeds u = {.v = vec(j == 0, j == 1, j == 2), .w = vec(j == 3, j == 4, j == 5)};
        double column[SPEEDS] = {0}, row[COLUMNS] = {0};
        if (j >= 6) u.joint[j - 6] = 1;
        Wrench rows = base_rows(&tree, &u);
        memcpy(column, &rows, sizeof rows);
        set_joint_rows(row, &tree, &u);
        memcpy(column + 6, row, ARM_JOINTS * sizeof *row);
        for (int i = 0; i < SPEEDS; i++) H[i * SPEEDS + j] = column[i];
    }
}

/* cholesky.h: elements that are not given are NaN */
int call_solve_upper(const double *A, int n, const double *b, double *x);
int call_solve_upper(const double *A, int n, const double *b, double *x)
{
    double a[UPPER][UPPER];
    for (int i = 0; i < UPPER; i++)
        for (int j = 0; j < UPPER; j++) a[i][j] = NAN;
    for (int i = 0; i < n; i++) {
        for (int j = i; j < n; j++) a[i][j] = A[i * n + j];
        a[i][n] = b[i];
    }
    return solve_upper(a, n, x);
}

/* optimal_problem.h */
CALL(vec3, onto_cone, (vec3 a, double t, double o, vec3 x), (a, t, o, x))
CALL(vec3, onto_slab, (vec3 n, double low, double high, vec3 x), (n, low, high, x))
CALL(vec3, onto_ball, (vec3 centre, double radius, vec3 x), (centre, radius, x))
CALL(int, differ, (vec3 a, vec3 b), (a, b))
static vec3 box_projection(vec3 most, double threshold, mat3 C, vec3 x)
{
    Problem b = {.most = most, .threshold = threshold};
    int near;
    return onto_box(&b, &C, x, &near);
}
CALL(vec3, box_projection, (vec3 most, double threshold, mat3 C, vec3 x), (most, threshold, C, x))

/* gains of a table: three per node */
void call_gains(int nodes, int has_speed_limit, double *gains);
void call_gains(int nodes, int has_speed_limit, double *gains)
{
    Gains g;
    set_gains(&g, nodes, has_speed_limit);
    memcpy(gains, &g, 3 * sizeof(double) * (size_t)nodes);
}

/* `count` iterations from a cold start along x: corridor and slab about x, constant for all nodes;
 * out: per node u.z, p, slab.z */
void call_iterations(int nodes, int count, const double *setting, double *out);
void call_iterations(int nodes, int count, const double *setting, double *out)
{
    static Problem b;
    static Iterates it;
    Gains g;
    vec3 q[NODES], x = vec(1, 0, 0);
    const double *s = setting; /* rho, most, p_end of 3; threshold, tangent, low, high */
    b = (Problem){.p_end = vec(s[6], s[7], s[8]), .most = vec(s[3], s[4], s[5])};
    b.threshold = s[9];
    b.has_cone = 1;
    for (int k = 0; k < nodes; k++)
        b.node[k] = (Node){.C = identity(1),
                           .a = x,
                           .n = x,
                           .tangent = s[10],
                           .low = s[11],
                           .high = s[12],
                           .p_free = vec(s[0], s[1], s[2])};
    set_gains(&g, nodes, 0);
    start_cold(&b, nodes, &it);
    for (int i = 0; i < count; i++) iterate(&b, &g, nodes, &it, q, NULL);
    for (int k = 0; k < nodes; k++) {
        memcpy(out + 9 * k, &it.u[k].z, sizeof(vec3));
        memcpy(out + 9 * k + 3, &it.p[k], sizeof(vec3));
        memcpy(out + 9 * k + 6, &it.slab[k].z, sizeof(vec3));
    }
}

/* vec3.h */
CALL(vec3, add, (vec3 a, vec3 b), (a, b))
CALL(vec3, sub, (vec3 a, vec3 b), (a, b))
CALL(vec3, neg, (vec3 a), (a))
CALL(vec3, scale, (double k, vec3 a), (k, a))
CALL(vec3, times, (vec3 a, vec3 b), (a, b))
CALL(vec3, sum3, (vec3 a, vec3 b, vec3 c), (a, b, c))
CALL(vec3, sum4, (vec3 a, vec3 b, vec3 c, vec3 d), (a, b, c, d))
CALL(double, dot, (vec3 a, vec3 b), (a, b))
CALL(double, norm, (vec3 a), (a))
CALL(vec3, unit, (vec3 a), (a))
CALL(vec3, cross, (vec3 a, vec3 b), (a, b))
CALL(double, angle, (vec3 a, vec3 b), (a, b))
CALL(double, clamp, (double value, double low, double high), (value, low, high))
CALL(double, limited, (double value, double limit), (value, limit))
CALL(vec3, limited3, (vec3 a, vec3 limit), (a, limit))
CALL(vec3, unequal, (vec3 a, vec3 b), (a, b))
CALL(mat3, rows, (vec3 a, vec3 b, vec3 c), (a, b, c))
CALL(mat3, diagonal, (double a, double b, double c), (a, b, c))
CALL(vec3, mul, (mat3 m, vec3 a), (m, a))
CALL(vec3, tmul, (mat3 m, vec3 a), (m, a))
CALL(mat3, transpose, (mat3 m), (m))
CALL(mat3, matmul, (mat3 a, mat3 b), (a, b))
CALL(mat3, matmul_t, (mat3 a, mat3 b), (a, b))
CALL(double, determinant, (mat3 m), (m))
CALL(vec3, solve, (mat3 m, vec3 b), (m, b))

/* line_of_sight.h */
static Motion los_motion(double up, Motion r) { return line_of_sight(up, r).q; }
CALL(Motion, los_motion, (double up, Motion r), (up, r))

/* attitude.h */
CALL(vec3, vector_part, (quat q), (q))
CALL(quat, conjugate, (quat q), (q))
CALL(quat, product, (quat a, quat b), (a, b))
CALL(quat, canonical, (quat q), (q))
CALL(mat3, dcm_of_quat, (quat q), (q))
CALL(quat, quat_of_dcm, (mat3 c), (c))
CALL(vec3, mrp_of_quat, (quat q), (q))
CALL(quat, quat_of_mrp, (vec3 s), (s))
CALL(mat3, dcm_of_mrp, (vec3 s), (s))
CALL(vec3, mrp_G, (vec3 s, vec3 w), (s, w))
CALL(vec3, mrp_G_transposed, (vec3 s, vec3 w), (s, w))
CALL(vec3, mrp_rate, (vec3 s, vec3 w), (s, w))
CALL(vec3, mrp_inside, (vec3 s), (s))

/* mat3.h */
CALL(mat3, plus, (mat3 a, mat3 b), (a, b))
CALL(mat3, minus, (mat3 a, mat3 b), (a, b))
CALL(mat3, scaled, (double k, mat3 a), (k, a))
CALL(mat3, outer, (vec3 a, vec3 b), (a, b))
CALL(mat3, tilde, (vec3 a), (a))
CALL(mat3, inertia_product, (vec3 a, vec3 b), (a, b))

/* symmetric3.h */
CALL(mat3, pseudo_inverse, (mat3 m, double share), (m, share))

/* small_rotation.h */
CALL(quat, rotation, (vec3 a), (a))
CALL(vec3, rotation_error, (quat q), (q))
CALL(vec3, rotation_vector, (quat q), (q))
CALL(quat, quat_of_rotation_vector, (vec3 phi), (phi))

/* motion.h */
CALL(Motion, neg_motion, (Motion a), (a))
CALL(Motion, cross_motion, (Motion a, Motion b), (a, b))
CALL(Motion, normalised, (Motion u), (u))
CALL(Motion, perpendicular_part, (vec3 fixed, Motion i), (fixed, i))
CALL(vec3, frame_rate, (Motion i, Motion j, Motion k), (i, j, k))
CALL(vec3, frame_acceleration, (Motion i, Motion j, Motion k), (i, j, k))

/* riccati.h */
CALL(mat6, sum6, (double ka, mat6 a, double kb, mat6 b), (ka, a, kb, b))
CALL(mat6, product6, (mat6 a, mat6 b), (a, b))
CALL(mat6, transpose6, (mat6 a), (a))
CALL(mat6, solve6, (mat6 a, mat6 b), (a, b))
CALL(double, largest6, (mat6 a), (a))
CALL(mat6, riccati, (mat6 A, mat6 S, mat6 Q), (A, S, Q, &(LyapunovInverse){{{0}}}))

mat6 call_lyapunov(mat6 A, mat6 C);
mat6 call_lyapunov(mat6 A, mat6 C)
{
    LyapunovInverse inverse;
    lyapunov_inverse(A, &inverse);
    return lyapunov(&inverse, C);
}

/* rigid_body.h */
CALL(vec3, gravity_gradient, (double mu, vec3 r_B, mat3 J), (mu, r_B, J))
CALL(int, satisfies_triangle_inequality, (mat3 J), (J))

void problems_of_inertia(mat3 J, char text[8000]);
void problems_of_inertia(mat3 J, char text[8000])
{
    Problems problems = {.part = ""};
    check_inertia(&problems, "J", J);
    memcpy(text, problems.text, sizeof problems.text);
}

/* time_grid.h: the number of steps, of which the first `capacity` are stored */
CALL(double, time_tolerance, (double x, double most), (x, most))
CALL(double, grid_number, (double t, double grid), (t, grid))
CALL(double, sample_index, (double t, double period), (t, period))
CALL(int, reached, (double t, double begin), (t, begin))

size_t substeps(double t, double h, double grid, size_t capacity, double at[], double length[]);
size_t substeps(double t, double h, double grid, size_t capacity, double at[], double length[])
{
    size_t n = 0;
    for (Substep s = first_substep(t, h, grid); s.h > 0; s = next_substep(s), n++)
        if (n < capacity) at[n] = s.t, length[n] = s.h;
    return n;
}

size_t samples(double t, double h, double period, size_t capacity, double at[], double spacing[]);
size_t samples(double t, double h, double period, size_t capacity, double at[], double spacing[])
{
    size_t n = 0;
    for (Sample s = first_sample(t, h, period); s.left > 0; s = next_sample(s), n++)
        if (n < capacity) at[n] = s.t, spacing[n] = s.period;
    return n;
}

/* finite.h */
int call_all_finite(const double x[], size_t count);
int call_all_finite(const double x[], size_t count) { return all_finite(x, count); }

/* index.h */
CALL(int, index_within, (double x, int last), (x, last))

/* interface.h */
int call_satisfy_rule(int rule, const double x[], size_t count);
int call_satisfy_rule(int rule, const double x[], size_t count)
{
    return satisfy_rule((Rule)rule, x, count);
}

uint64_t call_fold_text(uint64_t hash, const char *text);
uint64_t call_fold_text(uint64_t hash, const char *text) { return fold_text(hash, text); }

/* limited_roll.h: axis of both rolls, second axis and rate of each */
CALL(double, missing_roll, (vec3 i, vec3 k, double rate, vec3 rule, double rule_rate),
     ((Roll){i, k, rate, 0}, (Roll){i, rule, rule_rate, 0}))
CALL(double, closing_rate, (double psi, double a, double tau), (psi, a, tau))
CALL(int, satisfies, (double rate_max, double most, double rate, double acceleration, double h),
     ((RollLimits){rate_max, most}, (Roll){.rate = rate, .acceleration = acceleration}, h))
CALL(double, roll_acceleration, (double rate_max, double most, double rate, double h),
     ((RollLimits){rate_max, most}, (Roll){.rate = 0}, (Roll){.rate = rate}, 1, h))

/* mission_aim.h, mission_budget.h, mission_retreat.h, by the parameters that they read */
static double mode_of_aim(double aim_radius, double R_2, vec3 rho, double R)
{
    return aim_from(&(MissionParameters){.aim_radius = aim_radius, .R_2 = R_2}, rho, R).mode;
}
CALL(double, mode_of_aim, (double aim_radius, double R_2, vec3 rho, double R),
     (aim_radius, R_2, rho, R))
CALL(double, range_around, (double budget, double w_steer, double R_2, double F, double tumble),
     (&(MissionParameters){.budget = budget, .w_steer = w_steer, .R_2 = R_2, .F_axis = F}, 1,
      tumble))
CALL(vec3, wheel_bias, (double budget, mat3 J, mat3 A, double most, vec3 w),
     (
         &(MissionParameters){
             .budget = budget, .J_S = J, .A_w = A, .bias_max = 1, .wheel_speed_max = most},
         w))
CALL(double, verdict_on, (double rate_probe, double by_arm, double tumble),
     (&(MissionParameters){.budget = 1, .Isp = 200, .rate_probe = rate_probe, .by_arm = by_arm},
      &(MissionInput){.mass = 1}, tumble, &(Budget){.R = 1}))
CALL(double, least_distance, (double time, double step, vec3 rho, vec3 v),
     (&(MissionParameters){.drift_time = time, .drift_step = step}, &(RelativeState){.rho_H = rho},
      v))

/* carried_frame.h */
CALL(vec3, integrated_steering, (double w_steer, vec3 b, vec3 db, double period),
     (&(Steering){.w_steer = w_steer}, b, db, period))

/* optimal_motion.h */
CALL(vec3, first_way, (vec3 a, vec3 b, int is_arc, double part), (a, b, is_arc, part))

static vec3 rate_after_node(mat3 J, mat3 J_inverse, vec3 w, double dt, double longest)
{
    Tumble x = {{1, 0, 0, 0}, w};
    tumble_over_node(&(Inertia){J, J_inverse}, dt, longest, &x);
    return x.w;
}
CALL(vec3, rate_after_node, (mat3 J, mat3 J_inverse, vec3 w, double dt, double longest),
     (J, J_inverse, w, dt, longest))
