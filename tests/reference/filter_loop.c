/* filter_loop.c - the safety filter in closed loop with a hostile policy and a true world that is
 * none of its models: two bodies in orbit, a target that tumbles freely, another mass, a disturbance
 * at its bound, errors of the states, delay and lag of the force.
 *
 * put() sets a parameter by name, simulate() does one run. Margins of the truth, at four points
 * of every hold, with the cone in place of the pyramid. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "safety_filter.c"

enum { RANDOM, BANG_BANG, AT_TARGET, ALONG_V, AGAINST_BARRIER, STRONG_PD, GENTLE_PD };
enum { POINTS = 4, LATE = 16, TRIES = 4000 };

typedef struct {
    double policy, seed, duration, mass, rate_T, rate_S, nearest, farthest, speed, error, delay,
        lag;
} Setup;
typedef struct {
    double margin[4], relaxed, changed, samples, passed_impulse, changed_impulse, arrival, began;
} Outcome;
typedef struct {
    vec3 rT, vT, rS, vS, wT, wS, F;
    quat qT, qS;
} World;

static Model prototype;

int put(const char *name, const double *value);
int put(const char *name, const double *value)
{
    if (prototype.p.mass == 0) prototype = start;
    for (size_t i = 0; i < COUNT(variables); i++) {
        const Variable *v = &variables[i];
        if (v->causality != PARAMETER_ROW || strcmp(v->name, name) != 0) continue;
        memcpy((char *)&prototype + v->offset, value, v->size * sizeof *value);
        return 1;
    }
    return 0;
}

/* nearest point of rows of four numbers, n and c; returns the excluded row or -1 */
int nearest(const double *given, int number, const double u_0[3], double tol, double u[3]);
int nearest(const double *given, int number, const double u_0[3], double tol, double u[3])
{
    Row row[MOST_ROWS];
    vec3 found;
    for (int i = 0; i < number; i++) {
        const double *r = given + 4 * i;
        row[i] = (Row){vec(r[0], r[1], r[2]), r[3], 0, 0};
    }
    int excluded = nearest_point(row, number, vec(u_0[0], u_0[1], u_0[2]), tol, &found);
    memcpy(u, &found, sizeof found);
    return excluded;
}

/* ---- parts of one sample, for comparison ---- */
static Input input_of(const double *given)
{
    Input u;
    memcpy(&u, given, sizeof u);
    return u;
}

/* all rows but the drift, four numbers each; returns how many */
int rows_at(const double *given, double *found);
int rows_at(const double *given, double *found)
{
    Input u = input_of(given);
    double barrier[BARRIERS];
    const Parameters *p = &prototype.p;
    Geometry g = geometry(p, &u, p->sample_period);
    Rows rows = all_rows(p, &u, &g, initial_state(p).slope, barrier);
    for (int i = 0; i < rows.count; i++) memcpy(found + 4 * i, &rows.row[i], 4 * sizeof *found);
    return rows.count;
}

/* margin of the worst chord under a force, the chord, and the rows of chord 1 */
int drift_at(const double *given, const double F[3], double *found);
int drift_at(const double *given, const double F[3], double *found)
{
    Input u = input_of(given);
    const Parameters *p = &prototype.p;
    Geometry g = geometry(p, &u, p->sample_period);
    DriftFan f = drift_fan(p, &u, &g);
    Worst w = worst_drift(p, &f, vec(F[0], F[1], F[2]));
    Rows rows = {.count = 0};
    add_drift_rows(p, &f, 1, &rows);
    found[0] = w.margin, found[1] = w.chord;
    for (int i = 0; i < rows.count; i++) memcpy(found + 2 + 4 * i, &rows.row[i], 4 * sizeof *found);
    return rows.count;
}

/* (22): x_1, v_1, e and s/(2 a_B) */
void held_at(const double *given, const double F[3], double found[8]);
void held_at(const double *given, const double F[3], double found[8])
{
    Input u = input_of(given);
    Geometry g = geometry(&prototype.p, &u, prototype.p.sample_period);
    Held h = after_hold(&prototype.p, &g, vec(F[0], F[1], F[2]));
    memcpy(found, &h, sizeof h);
}

/* ---- random numbers (splitmix64) ---- */
static uint64_t noise;
static double uniform(double low, double high)
{
    uint64_t z = noise += UINT64_C(0x9E3779B97F4A7C15);
    z = (z ^ (z >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94D049BB133111EB);
    z ^= z >> 31;
    return low + (high - low) * (double)(z >> 11) * 0x1p-53;
}
/* in a fixed order: compilers evaluate arguments in different ones */
static vec3 in_cube(double a)
{
    double z = uniform(-a, a), y = uniform(-a, a), x = uniform(-a, a);
    return vec(x, y, z);
}
static vec3 direction(void)
{
    for (;;) {
        vec3 a = in_cube(1);
        double n = norm(a);
        if (n > 0.1 && n <= 1) return scale(1 / n, a);
    }
}
/* in a random direction, of a random length up to this */
static vec3 up_to(double most)
{
    vec3 way = direction();
    return scale(uniform(0, 1) * most, way);
}
static quat attitude(void) { return quat_of_mrp(up_to(1)); }

/* ---- the true world ---- */
typedef struct { vec3 rT, vT, rS, vS, wT; } Rates;
static const vec3 inertia = {100, 150, 90};

static vec3 euler(vec3 w)
{
    vec3 J = inertia;
    return vec((J.y - J.z) * w.y * w.z / J.x, (J.z - J.x) * w.z * w.x / J.y,
               (J.x - J.y) * w.x * w.y / J.z);
}

static quat turned(quat q, vec3 w, double h)
{
    double n = norm(w), a = n * h / 2;
    if (n == 0) return q;
    SineCosine half = sine_and_cosine(a);
    vec3 v = scale(half.s / n, w);
    return canonical(product(q, (quat){half.c, v.x, v.y, v.z}));
}

static Rates rates(const World *x, double mu, double mass, vec3 a_N, quat qS)
{
    vec3 a = add(scale(1 / mass, tmul(dcm_of_quat(qS), x->F)), a_N);
    return (Rates){x->vT, point_mass_gravity(mu, x->rT), x->vS,
                   add(point_mass_gravity(mu, x->rS), a), euler(x->wT)};
}

static World moved(const World *x, const Rates *k, double h)
{
    World y = *x;
    y.rT = add(x->rT, scale(h, k->rT));
    y.vT = add(x->vT, scale(h, k->vT));
    y.rS = add(x->rS, scale(h, k->rS));
    y.vS = add(x->vS, scale(h, k->vS));
    y.wT = add(x->wT, scale(h, k->wT));
    return y;
}

static void advance(World *x, double mu, double mass, vec3 a_N, double h)
{
    quat middle = turned(x->qS, x->wS, h / 2), end = turned(x->qS, x->wS, h);
    Rates k1 = rates(x, mu, mass, a_N, x->qS);
    World x2 = moved(x, &k1, h / 2);
    Rates k2 = rates(&x2, mu, mass, a_N, middle);
    World x3 = moved(x, &k2, h / 2);
    Rates k3 = rates(&x3, mu, mass, a_N, middle);
    World x4 = moved(x, &k3, h);
    Rates k4 = rates(&x4, mu, mass, a_N, end);
    vec3 w = scale(0.5, add(x->wT, x4.wT));
    World y = moved(x, &k1, h / 6);
    y = moved(&y, &k2, h / 3);
    y = moved(&y, &k3, h / 3);
    y = moved(&y, &k4, h / 6);
    y.qT = turned(x->qT, w, h);
    y.qS = end;
    *x = y;
}

/* ---- margins of the truth ---- */
static void observe_truth(const Parameters *p, const World *x, double margin[4])
{
    vec3 rho = sub(x->rS, x->rT), v = sub(x->vS, x->vT);
    double R = norm(rho);
    if (p->keep_out_radius > 0) margin[0] = smaller(margin[0], R - p->keep_out_radius);
    if (p->use_corridor) {
        vec3 q = sub(mul(dcm_of_quat(x->qT), rho), p->corridor_apex);
        double a = dot(q, p->corridor_axis), d = norm(sub(q, scale(a, p->corridor_axis)));
        SineCosine half = sine_and_cosine(p->corridor_half_angle);
        double inside = a * half.s - d * half.c;
        if (p->corridor_length > 0) inside = smaller(inside, p->corridor_length - a);
        margin[1] = smaller(margin[1], inside);
    }
    if (p->use_speed_limit) {
        vec3 w = p->mu == 0 ? vec(0, 0, 0) : scale(1 / dot(x->rT, x->rT), cross(x->rT, x->vT));
        double v_H = norm(sub(v, cross(w, rho)));
        margin[2] = smaller(margin[2], speed_limit(p, R) - v_H);
    }
}

/* ---- what the software sees ---- */
static Input seen(const Parameters *p, const World *x, double error)
{
    Input u = {.T = {x->rT, x->vT, x->qT, x->wT},
               .S = {x->rS, x->vS, x->qS, x->wS},
               .approaching = 1,
               .relative_valid = 1};
    u.S.r = add(u.S.r, up_to(error * p->position_error));
    u.S.v = add(u.S.v, up_to(error * p->velocity_error));
    u.T.omega = add(u.T.omega, up_to(error * p->rate_error));
    u.T.q = turned(u.T.q, up_to(error * p->attitude_error), 1);
    return u;
}

/* ---- policies ---- */
static vec3 to_S(const Input *u, vec3 F_N) { return mul(dcm_of_quat(u->S.q), F_N); }
static vec3 along(vec3 a, double size)
{
    double n = norm(a);
    return n > 0 ? scale(size / n, a) : a;
}

/* towards a place in target axes, 0.3 of the sphere inside it, with a damping */
static vec3 to_place(const Parameters *p, const Geometry *g, double share)
{
    double k = share * norm(p->F_max) / 4, c = 2 * sqrt(k * p->mass);
    double deep = larger(p->keep_out_radius, 1);
    vec3 place = scale(share > 1 ? 0.3 * deep : 1.3 * deep, p->corridor_axis);
    vec3 e = sub(g->rho, tmul(g->C_TN, place));
    return add(scale(-k, e), scale(-c, g->v_T));
}

static vec3 against_barrier(const Parameters *p, const Geometry *g, const double h[])
{
    double size = 3 * norm(p->F_max);
    if (p->use_speed_limit && h[SPEED - 1] < h[KEEP_OUT - 1] / 10 &&
        h[SPEED - 1] < h[CORRIDOR - 1] / 10)
        return along(g->v_H, size);
    vec3 axis = tmul(g->C_TN, p->corridor_axis), side = sub(g->rho, scale(dot(axis, g->rho), axis));
    return p->use_corridor && h[CORRIDOR - 1] < h[KEEP_OUT - 1] ? along(side, size)
                                                                : along(g->rho, -size);
}

static vec3 command(const Parameters *p, const Setup *f, const Input *u, const Output *y, vec3 last)
{
    Geometry g = geometry(p, u, p->sample_period);
    vec3 most = p->F_max, full = scale(2, most);
    switch ((int)f->policy) {
    case RANDOM: return times(full, in_cube(1));
    case BANG_BANG:
        if (norm(last) > 0 && uniform(0, 1) < 0.9) return last;
        last = in_cube(1);
        return times(full, vec(last.x < 0 ? -1 : 1, last.y < 0 ? -1 : 1, last.z < 0 ? -1 : 1));
    case AT_TARGET: return to_S(u, scale(-norm(most), g.out));
    case ALONG_V: return to_S(u, along(g.v, norm(full)));
    case AGAINST_BARRIER: return to_S(u, against_barrier(p, &g, y->barrier));
    case STRONG_PD: return to_S(u, to_place(p, &g, 5));
    default: return to_S(u, to_place(p, &g, 0.05));
    }
}

/* ---- runs ---- */
static World random_world(const Parameters *p, const Setup *f)
{
    World x = {.rT = {7e6, 0, 0}, .vT = {0, 7546.0, 0}};
    x.wT = scale(f->rate_T, direction());
    x.wS = scale(f->rate_S, direction());
    x.qT = attitude();
    x.qS = attitude();
    if (p->mu == 0) x.rT = x.vT = vec(0, 0, 0);
    mat3 C_TN = dcm_of_quat(x.qT);
    vec3 out = direction();
    if (p->use_corridor)
        out = unit(add(p->corridor_axis, scale(p->corridor_half_angle, in_cube(1))));
    vec3 rho = tmul(C_TN, scale(uniform(f->nearest, f->farthest), out)), w = tmul(C_TN, x.wT);
    vec3 turning = p->use_corridor ? cross(w, rho) : vec(0, 0, 0);
    x.rS = add(x.rT, rho);
    x.vS = sum3(x.vT, turning, up_to(f->speed));
    return x;
}

static int all_inside(const Output *y)
{
    for (int rule = 0; rule < 4; rule++)
        if (y->barrier[rule] < 0) return 0;
    return 1;
}

static int is_inside(const Parameters *p, const World *x)
{
    double margin[4] = {0, 0, 0, 0};
    observe_truth(p, x, margin);
    return margin[0] >= 0 && margin[1] >= 0 && margin[2] >= 0;
}

/* a random start inside, with all barriers >= 0: with a reaction the barriers belong to a later
 * time; 0: none was found */
static int begin(const Parameters *p, const Setup *f, World *x)
{
    Parameters off = *p;
    off.filter = NO_FILTER;
    for (int k = 0; k < TRIES; k++) {
        Model m = prototype;
        *x = random_world(p, f);
        if (!is_inside(p, x)) continue;
        Input u = seen(p, x, 0);
        initialize(&off, &u, &m.x, &m.y, 0);
        if (all_inside(&m.y)) return 1;
    }
    return 0;
}

static void hold(const Parameters *p, const Setup *f, World *x, vec3 u_now, double margin[4])
{
    vec3 disturbance = scale(p->a_dist, direction());
    double h = p->sample_period / POINTS;
    for (int i = 0; i < POINTS; i++) {
        double share = f->lag > 0 ? 1 - exponential(-h / f->lag) : 1;
        x->F = add(x->F, scale(share, sub(u_now, x->F)));
        advance(x, p->mu, f->mass, disturbance, h);
        observe_truth(p, x, margin);
    }
}

void simulate(const Setup *f, Outcome *o);
void simulate(const Setup *f, Outcome *o)
{
    Model m = prototype;
    const Parameters *p = &m.p;
    double P = p->sample_period, late = f->delay / P;
    vec3 F = {0, 0, 0}, line[LATE] = {{0, 0, 0}};
    World x;
    noise = (uint64_t)f->seed;
    *o = (Outcome){.margin = {RESTING, RESTING, RESTING, RESTING}, .arrival = -1};
    o->began = begin(p, f, &x);
    if (!o->began) return;
    Input u = seen(p, &x, f->error);
    initialize(p, &u, &m.x, &m.y, 0);
    for (int k = 0; k < f->duration / P; k++) {
        u = seen(p, &x, f->error);
        u.F_cmd_S = F = command(p, f, &u, &m.y, F);
        step(p, &u, &m.x, &m.y, k * P, P);
        line[k % LATE] = m.y.F_safe_S;
        int at = k - (int)late;
        hold(p, f, &x, at >= 0 ? line[at % LATE] : vec(0, 0, 0), o->margin);
        o->margin[3] = smaller(o->margin[3], m.y.barrier[DRIFT - 1]);
        o->relaxed += m.y.feasible == 0;
        o->changed += m.y.intervention > 0;
        o->samples++;
        o->passed_impulse += P * norm(m.y.F_safe_S);
        o->changed_impulse += P * m.y.intervention;
        if (o->arrival < 0 && norm(sub(x.rS, x.rT)) < 1.05 * p->keep_out_radius)
            o->arrival = (k + 1) * P;
    }
}
