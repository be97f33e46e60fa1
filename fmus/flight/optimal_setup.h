/* optimal_setup.h - set-up of a solve of optimal_controller: horizon, axes, free motion and
 * constraints of every node from the inputs of one sample. A node is one of the NODES intervals of
 * equal length that divide the horizon.
 *
 * If the state at the start of the plan violates the cone, the slab or keep_out, these are widened
 * so far that it satisfies them; the widening decreases to 0 within `relax_time`. Limits of
 * force and speed, and arrive_radius, are not widened. Equations: docs/models.md N.2. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef OPTIMAL_SETUP_H
#define OPTIMAL_SETUP_H

#include "optimal_forecast.h"

typedef struct {
    int goal;
    double L; /* distance of the goal from the target [m] */
    /* t_arrival: time at which the goal must be reached [s]; at the start of the plan: range =
     * |rho|, along: component of rho along the grasp axis, across: distance from this axis [m] */
    double t_arrival, range, along, across;
    Grid grid;
    Carried from;
    OrbitNow orbit;
} Task;

static inline double end_of_node(const Task *task, int k) { return (k + 1) * task->grid.dt; }
static inline double seconds_after(const Task *task, double in_plan)
{
    return task->from.after + in_plan;
}
static inline int arrived(const Task *task, int k, double lead)
{
    return reached(task->grid.t + end_of_node(task, k), task->t_arrival - lead);
}

/* sets, for every node, the servicer axes C at the start of the node and the grasp axis a at its
 * end; returns attitude and angular velocity of the target at the end of the horizon */
static inline Tumble set_axes(const OptimalParameters *p, const OptimalInput *u, const Task *task,
                              Problem *b)
{
    Inertia i = inertia_of(p);
    Tumble at = task->from.tumble;
    mat3 C_SN = dcm_of_quat(canonical(u->S.q)), C_ST = matmul_t(C_SN, dcm_of_quat(u->T.q));
    int turns = norm(u->S.omega) >= p->omega_rest && p->turn[task->goal - 1];
    for (int k = 0; k < NODES; k++) {
        b->node[k].C = turns ? matmul(C_ST, dcm_of_quat(at.q)) : C_SN;
        tumble_over_node(&i, task->grid.dt, p->tumble_step, &at);
        b->node[k].a = tmul(dcm_of_quat(at.q), p->p_T);
    }
    return at;
}

/* sets the position of the goal at the end of every node, divided by the square of the horizon */
static inline void set_places(const OptimalParameters *p, const Task *task, Problem *b)
{
    double T = task->grid.dt * NODES, L = task->L / (T * T);
    for (int k = 0; k < NODES; k++) {
        vec3 to = b->node[k].a;
        if (task->goal == TO_POINT) {
            double after = seconds_after(task, end_of_node(task, k));
            to = tmul(hill_axes(&task->orbit, after), p->line);
        }
        b->node[k].place = scale(L, to);
    }
}

static inline vec3 orbit_rate(const OrbitNow *o) { return scale(o->rate, o->e_n); }

static inline void set_end(const Task *task, Tumble last, Problem *b)
{
    vec3 turning = tmul(dcm_of_quat(last.q), last.w), orbiting = orbit_rate(&task->orbit);
    b->p_end = b->node[NODES - 1].place;
    b->v_end =
        scale(task->grid.dt * NODES, cross(task->goal == TO_POINT ? orbiting : turning, b->p_end));
}

/* (4): sets position and velocity without force at the end of every node, scaled by the horizon T:
 * position/T^2, velocity/T; d_hat: estimate of the acceleration that is not modelled [m/s2]; way:
 * positions on the path of the previous solve at the ends of the nodes [m] */
static inline void set_free_motion(const Task *task, vec3 d_hat, const vec3 way[], Problem *b)
{
    double T = task->grid.dt * NODES, h = 1.0 / NODES;
    vec3 x = scale(1 / (T * T), task->from.rho), w = scale(1 / T, task->from.v);
    vec3 before = task->from.rho;
    for (int k = 0; k < NODES; k++) {
        double middle = seconds_after(task, (k + 0.5) * task->grid.dt);
        vec3 d = add(d_hat, tide(&task->orbit, middle, scale(0.5, add(before, way[k]))));
        x = sum3(x, scale(h, w), scale(h * h / 2, d));
        w = add(w, scale(h, d));
        b->node[k].p_free = x;
        b->node[k].v_free = w;
        before = way[k];
    }
}

/* goal 3, along the axis: sets the constraints cone and slab of node k, widened by (7); fade: share
 * of the widening that is left at this node */
static inline void set_corridor(const OptimalParameters *p, const Task *task, int k, double fade,
                                Node *node)
{
    double dt = task->grid.dt, sag = dot(task->from.tumble.w, task->from.tumble.w) * dt * dt / 8;
    SineCosine edge =
        sine_and_cosine(arrived(task, k, p->hold_lead) ? p->cone_hold : p->cone - sag);
    double T2 = 3600 * dt * dt, L = task->L;
    double low = L - p->slab[0], high = arrived(task, k, 0) ? L + p->slab[1] : 1e6;
    node->tangent = edge.s / edge.c;
    node->o = larger(0, task->across - node->tangent * task->along) * fade / T2;
    node->n = node->a;
    node->low = (low - larger(0, low - task->along) * fade) / T2;
    node->high = (high + larger(0, task->along - high) * fade) / T2;
    node->has_ball = 0;
}

/* goals 1 and 2: sets the constraint of node k. Before the arrival, the constraint is the keep-out
 * half space along `way`, the position on the path of the previous solve [m], widened by (7);
 * afterwards, the ball of arrive_radius around the goal. fade: as in set_corridor() */
static inline void set_keep_out(const OptimalParameters *p, const Task *task, int k, double fade,
                                vec3 way, Node *node)
{
    double dt = task->grid.dt, T2 = 3600 * dt * dt, R = p->keep_out[task->goal - 1];
    node->has_ball = arrived(task, k, 0);
    if (node->has_ball) {
        node->n = node->place;
        node->high = p->arrive_radius / T2;
        return;
    }
    node->n = norm(way) < 1e-6 ? task->orbit.e_r : unit(way);
    node->low = (R - larger(0, R - task->range) * fade) / T2;
    node->high = 1e6 / T2;
}

static inline void set_speed_limit(const OptimalParameters *p, const Task *task, vec3 way,
                                   Node *node)
{
    double T = task->grid.dt * NODES;
    node->v_centre = scale(1 / T, cross(orbit_rate(&task->orbit), way));
    node->v_max = (p->v_0 + p->v_slope * norm(way)) / T;
}

static inline void set_constraints(const OptimalParameters *p, const Task *task, const vec3 way[],
                                   Problem *b)
{
    for (int k = 0; k < NODES; k++) {
        Node *node = &b->node[k];
        double fade = larger(0, 1 - end_of_node(task, k) / p->relax_time);
        if (task->goal == ALONG_AXIS) set_corridor(p, task, k, fade, node);
        else set_keep_out(p, task, k, fade, way[k], node);
        set_speed_limit(p, task, way[k], node);
    }
}

/* (8) */
static inline Task task_of(const OptimalParameters *p, const OptimalInput *u, const OptimalState *x,
                           double t, int seconds)
{
    int goal = (int)x->goal;
    Task task = {.goal = goal,
                 .L = range_of(p, u, goal),
                 .t_arrival = x->t_goal + duration_of(p, u, goal),
                 .from = carried_now(u, t),
                 .orbit = orbit_of(p, u)};
    carry(p, x, &task.orbit, seconds, &task.from);
    double T = larger(task.t_arrival - task.from.t, p->T_min);
    vec3 a = tmul(dcm_of_quat(task.from.tumble.q), p->p_T), rho = task.from.rho;
    task.grid = (Grid){task.from.t, T / NODES};
    task.range = norm(rho);
    task.along = dot(rho, a);
    task.across = norm(sub(rho, scale(task.along, a)));
    return task;
}

static inline void set_first_way(const Task *task, const Problem *b, vec3 way[])
{
    double T = task->grid.dt * NODES;
    vec3 end = scale(T * T, b->p_end);
    for (int k = 0; k < NODES; k++)
        way[k] = first_way(task->from.rho, end, task->goal == TO_AXIS, (k + 1.0) / NODES);
}

static inline void set_up(const OptimalParameters *p, const OptimalInput *u, OptimalState *x,
                          double t, int seconds, int first)
{
    Problem *b = &x->problem;
    Task task = task_of(p, u, x, t, seconds);
    double largest = larger(p->F_max.x, larger(p->F_max.y, p->F_max.z));
    b->most = scale(1 / u->mass, p->F_max);
    b->threshold = p->kappa * (largest / u->mass);
    b->has_cone = task.goal == ALONG_AXIS;
    b->has_speed_limit = p->speed_limit;
    Tumble last = set_axes(p, u, &task, b);
    set_places(p, &task, b);
    set_end(&task, last, b);
    if (first) set_first_way(&task, b, x->it.p);
    else start_from_last(&x->it, x->grid, task.grid);
    set_free_motion(&task, x->d.d_hat, x->it.p, b);
    set_constraints(p, &task, x->it.p, b);
    if (!x->has_iterates) start_cold(b, NODES, &x->it);
    x->has_iterates = 1;
    x->grid = task.grid;
    x->range = task.range;
    x->seconds = seconds;
}

#endif
