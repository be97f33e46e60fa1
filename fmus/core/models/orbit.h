/* orbit.h - Keplerian elements, point-mass gravity with J2, the Hill frame.
 *
 * H: x radial outward, y along track, z orbit normal. Equations: docs/models.md A.2, A.4. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef ORBIT_H
#define ORBIT_H

#include "attitude.h"
#include "mat3.h"

typedef struct {
    double a, e, inc, argp, raan, nu, mu, R_E, J2;
} Orbit; /* osculating elements at the start; from mu on: constants of the planet */
typedef struct { vec3 r, v; } PosVel; /* N axes */

/* position and velocity for osculating elements: perifocal axes rotated by argp, inc, raan */
static inline PosVel posvel_of_elements(const Orbit *o)
{
    SineCosine i = sine_and_cosine(o->inc), w = sine_and_cosine(o->argp);
    SineCosine O = sine_and_cosine(o->raan), nu = sine_and_cosine(o->nu);
    double p = o->a * (1 - o->e * o->e), r = p / (1 + o->e * nu.c), k = sqrt(o->mu / p);
    vec3 P = vec(O.c * w.c - O.s * w.s * i.c, O.s * w.c + O.c * w.s * i.c, w.s * i.s);
    vec3 Q = vec(-O.c * w.s - O.s * w.c * i.c, -O.s * w.s + O.c * w.c * i.c, w.c * i.s);
    return (PosVel){add(scale(r * nu.c, P), scale(r * nu.s, Q)),
                    add(scale(-k * nu.s, P), scale(k * (o->e + nu.c), Q))};
}

/* A.2: acceleration -mu r/r^3 + a_J2 */
static inline vec3 gravity(const Orbit *o, double with_J2, vec3 r)
{
    if (o->mu == 0) return vec(0, 0, 0);
    double rr = dot(r, r), k = o->mu / (rr * sqrt(rr)), zz = 5 * r.z * r.z / rr;
    double j = with_J2 * 1.5 * o->J2 * o->R_E * o->R_E / rr;
    return scale(-k,
                 vec(r.x * (1 + j * (1 - zz)), r.y * (1 + j * (1 - zz)), r.z * (1 + j * (3 - zz))));
}

/* A.4.1: Hill frame: C_HN with the rows radial, along track and orbit normal; angular velocity w_H
 * = [0, 0, |h|/r^2] with h = r x v, and its derivative on a Keplerian orbit, dw_H = -2 (r.v)/r^2
 * w_H. In deep space (mu = 0) there is no orbit: H is N. */
typedef struct {
    mat3 C_HN;
    vec3 w_H, dw_H;
} HillFrame;

static inline HillFrame hill_frame(double mu, vec3 r, vec3 v)
{
    if (mu == 0) return (HillFrame){diagonal(1, 1, 1), vec(0, 0, 0), vec(0, 0, 0)};
    vec3 h = cross(r, v), ir = unit(r), ih = unit(h);
    double rr = dot(r, r), rate = norm(h) / rr;
    return (HillFrame){rows(ir, cross(ih, ir), ih), vec(0, 0, rate),
                       vec(0, 0, -2 * dot(r, v) / rr * rate)};
}

/* derivative of the vector x as seen in the frame, from its derivative as seen in N; rate_in_N()
 * is the inverse; all in H components */
static inline vec3 rate_in_frame(const HillFrame *f, vec3 x, vec3 dx_N)
{
    return sub(dx_N, cross(f->w_H, x));
}
static inline vec3 rate_in_N(const HillFrame *f, vec3 x, vec3 dx)
{
    return add(dx, cross(f->w_H, x));
}

/* position and velocity at an offset rho_H, drho_H (as seen in H) from the start of an orbit:
 * r = r_o + C_HN^T rho, v = v_o + C_HN^T (drho + w_H x rho) */
static inline PosVel posvel_beside(const Orbit *o, vec3 rho_H, vec3 drho_H)
{
    PosVel orbit = posvel_of_elements(o);
    HillFrame H = hill_frame(o->mu, orbit.r, orbit.v);
    return (PosVel){add(orbit.r, tmul(H.C_HN, rho_H)),
                    add(orbit.v, tmul(H.C_HN, rate_in_N(&H, rho_H, drho_H)))};
}

/* derivative of point-mass gravity with respect to r: mu/r^3 (3 r r^T/r^2 - I) */
static inline mat3 gravity_gradient_matrix(double mu, vec3 r)
{
    if (mu == 0) return identity(0);
    double rr = dot(r, r), k = mu / (rr * sqrt(rr));
    return plus(identity(-k), scaled(3 * k / rr, outer(r, r)));
}

/* transport terms of the second derivative of a vector r, w' x r + 2 w x r' + w x (w x r), with
 * w = w_H; x: r, dx: r' as seen in the frame */
static inline vec3 transport(const HillFrame *f, vec3 x, vec3 dx)
{
    return sum3(cross(f->dw_H, x), scale(2, cross(f->w_H, dx)), cross(f->w_H, cross(f->w_H, x)));
}

#endif
