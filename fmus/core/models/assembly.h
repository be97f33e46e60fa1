/* assembly.h - two docked bodies on a circular orbit, the module (1) turning about the z axis of a
 * hinge on the base (0): composite inertia, momentum, torques, attitude. Plant, guidance and
 * controller use the same model.
 *
 *   J_A = J0 + A_01 J1 A_01^T - m_r [R]x[R]x,   m_r = m0 m1/(m0+m1),   R: CM 0 -> CM 1
 *   h_m = A_01 J1 omega_1 + m_r R x V,          V = dR/dt as seen in the base
 *   H   = J_A omega_0 + h_m + h_cmg             about the centre of mass of the assembly
 *   J_A omega_0' + J_A' omega_0 + h_m' + h_cmg' + omega_0 x H = tau_gg + tau_aero
 *
 * J_A, H: inertia and momentum of the assembly; h_m: momentum of the relative motion; h_cmg:
 * momentum of the gyros; m_r: reduced mass; A_01: rotation matrix from module to base axes;
 * omega_0: rate of the base; omega_1: rate of the module relative to the base.
 *
 * All vectors are in base axes S. Attitude zero is the flight attitude: the base axes coincide with
 * the orbital frame o of the patent, X along the velocity, Y opposite to the orbit normal, Z to the
 * Earth. The attitudes in ports are relative to H (x outward, y along track, z orbit normal): X_o =
 * y_H, Y_o = -z_H, Z_o = -x_H, so that attitude zero is q_SH = q_oH = (1, -1, -1, 1)/2. q_oH and
 * q_HN below are the only functions that contain this convention. N: the axes of H at t = 0. eps:
 * vector part of q_So, for rotations below half a turn. Source: patent CN106020225A, corrected
 * (docs/models.md E). */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef ASSEMBLY_H
#define ASSEMBLY_H

#include "attitude.h"
#include "motion.h"
#include "rigid_body.h"
#include "surfaces.h"
#include "swing.h"

typedef struct {
    double m0, m1;
    mat3 J0, J1;        /* each about its centre of mass, in its own axes */
    vec3 hinge, module; /* CM 0 -> hinge, base axes; hinge -> CM 1, module axes */
    Surfaces surfaces;
    double mu, R_C, rho, C_D;
} Assembly;

/* ---- quantities at one angle, rate and acceleration (Arm) of the module about the hinge ---- */
typedef struct {
    mat3 J, dJ; /* J_A and its derivative */
    vec3 h, dh; /* h_m and its derivative */
    vec3 R, V;
    Facet facets[FACETS]; /* positions from the centre of mass of the assembly, base axes */
} Configuration;

static inline mat3 turn_about_z(double angle) /* A_01 */
{
    SineCosine a = sine_and_cosine(angle);
    return rows(vec(a.c, -a.s, 0), vec(a.s, a.c, 0), vec(0, 0, 1));
}

static inline void place_facets(const Assembly *a, mat3 A_01, vec3 R, Facet facets[FACETS])
{
    vec3 cm = scale(a->m1 / (a->m0 + a->m1), R);
    for (int k = 0; k < FACETS; k++) {
        Facet f = facet(&a->surfaces, k);
        if (body_of_facet(&a->surfaces, k) == 1) {
            f.normal = mul(A_01, f.normal);
            f.centre = add(R, mul(A_01, f.centre));
        }
        f.centre = sub(f.centre, cm);
        facets[k] = f;
    }
}

static inline Configuration configuration(const Assembly *a, Arm arm)
{
    Configuration c;
    double m_r = a->m0 * a->m1 / (a->m0 + a->m1);
    mat3 A_01 = turn_about_z(arm.angle), J_m = matmul_t(matmul(A_01, a->J1), A_01);
    vec3 z = vec(0, 0, 1), d = mul(A_01, a->module), w = scale(arm.rate, z);
    vec3 R = add(a->hinge, d), V = cross(w, d);
    vec3 dV = add(scale(arm.accel, cross(z, d)), cross(w, V)), h_1 = mul(J_m, w);

    c.J = plus(plus(a->J0, J_m), scaled(m_r, inertia_product(R, R)));
    c.dJ = plus(minus(matmul(tilde(w), J_m), matmul(J_m, tilde(w))),
                scaled(2 * m_r, inertia_product(R, V)));
    c.h = add(h_1, scale(m_r, cross(R, V)));
    c.dh = sum3(scale(arm.accel, mul(J_m, z)), cross(w, h_1), scale(m_r, cross(R, dV)));
    c.R = R;
    c.V = V;
    place_facets(a, A_01, R, c.facets);
    return c;
}

/* ---- orbit ---- */
static inline double orbit_rate(const Assembly *a) /* n */
{
    return sqrt(a->mu / (a->R_C * a->R_C * a->R_C));
}
static inline vec3 orbital_rate_o(const Assembly *a) { return vec(0, -orbit_rate(a), 0); }

static inline quat q_oH(void) { return (quat){0.5, -0.5, -0.5, 0.5}; }
static inline quat q_HN(const Assembly *a, double t)
{
    SineCosine half = sine_and_cosine(orbit_rate(a) * t / 2);
    return (quat){half.c, 0, 0, half.s};
}
static inline quat q_oN(const Assembly *a, double t) { return product(q_HN(a, t), q_oH()); }

static inline quat q_So_of_q_SH(quat q_SH) /* attitude relative to o, scalar part >= 0 */
{
    return canonical(product(conjugate(q_oH()), q_SH));
}
static inline quat q_SH_of_q_So(quat q_So) { return canonical(product(q_oH(), q_So)); }

/* ---- torques; C_So: rotation matrix from o to base axes ---- */
static inline vec3 gravity_torque(const Assembly *a, const Configuration *c, mat3 C_So)
{
    return gravity_gradient(a->mu, mul(C_So, vec(0, 0, -a->R_C)), c->J);
}

/* aerodynamic torque 1/2 rho V_R^2 C_D sum(A_k C_k) x v; V_R^2 = mu/R_C; A_k, C_k: projected
 * area and centre of facet k; v: direction of the gas relative to the assembly, opposite to the
 * orbital velocity */
static inline vec3 aero_torque(const Assembly *a, const Configuration *c, mat3 C_So)
{
    vec3 v = mul(C_So, vec(-1, 0, 0)), moment = vec(0, 0, 0);
    for (int k = 0; k < FACETS; k++)
        moment = add(moment, scale(area_in_flow(c->facets[k], v), c->facets[k].centre));
    return scale(a->rho * a->mu / a->R_C / 2 * a->C_D, cross(moment, v));
}

static inline vec3 environment_torque(const Assembly *a, const Configuration *c, mat3 C_So)
{
    return add(gravity_torque(a, c, C_So), aero_torque(a, c, C_So));
}

/* ---- momentum and its balance ---- */
static inline vec3 momentum_without_gyros(const Configuration *c, vec3 omega) /* H - h_cmg */
{
    return add(mul(c->J, omega), c->h);
}

/* loads J_A' omega_0 + h_m' + omega_0 x H - tau, which equal -(J_A omega_0' + h_cmg') */
static inline vec3 inertial_load(const Configuration *c, vec3 omega, vec3 h, vec3 torque)
{
    vec3 gyroscopic = cross(omega, add(momentum_without_gyros(c, omega), h));
    return sub(sum3(mul(c->dJ, omega), c->dh, gyroscopic), torque);
}
static inline vec3 acceleration(const Configuration *c, vec3 omega, vec3 h, vec3 dh, vec3 torque)
{
    return solve(c->J, neg(add(inertial_load(c, omega, h, torque), dh)));
}
/* rate of the gyro momentum h_cmg' that gives the base the acceleration domega */
static inline vec3 momentum_rate(const Configuration *c, vec3 omega, vec3 domega, vec3 h,
                                 vec3 torque)
{
    return neg(add(mul(c->J, domega), inertial_load(c, omega, h, torque)));
}

/* ---- motion of the base from eps and its derivatives ---- */
typedef struct {
    quat q_So;
    mat3 C_So;
    vec3 omega, domega; /* relative to N, body axes */
} BaseMotion;

/* attitude, rate and acceleration of the base along eps(t): omega = C_So omega_orb + w, w = 2 (eta
 * eps' - eps x eps' - eta' eps), eta = sqrt(1 - eps.eps); omega_orb: rate of the orbital frame o */
static inline BaseMotion base_motion(const Assembly *a, Motion eps)
{
    double eta = sqrt(1 - dot(eps.x, eps.x)), deta = -dot(eps.x, eps.d) / eta;
    double ddeta = -(dot(eps.d, eps.d) + dot(eps.x, eps.dd) + deta * deta) / eta;
    quat q = {eta, eps.x.x, eps.x.y, eps.x.z};
    mat3 C = dcm_of_quat(q);
    vec3 w = scale(2, sub(sub(scale(eta, eps.d), cross(eps.x, eps.d)), scale(deta, eps.x)));
    vec3 dw = scale(2, sub(sub(scale(eta, eps.dd), cross(eps.x, eps.dd)), scale(ddeta, eps.x)));
    vec3 orbital = mul(C, orbital_rate_o(a));
    return (BaseMotion){q, C, add(orbital, w), sub(dw, cross(w, orbital))};
}

static inline double rotation_of(vec3 eps) /* angle of the rotation [rad] */
{
    return 2 * arc_tangent(norm(eps), sqrt(larger(0, 1 - dot(eps, eps))));
}

#endif
