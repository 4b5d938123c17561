/* Rates of a Lagrangian system for the fixed-point iteration, in all lanes. */
#ifndef GS_LAGRANGIAN_RATES_H
#define GS_LAGRANGIAN_RATES_H

#include "gyrospark/simd/vector.h"

#if GS_CONSTRAINED
/* W = G H_pp G^T, independent of p */
INLINE void lanes_schur(const lanes_constants *c, const lanes q[N], const lanes p[N],
    lanes W[M][M])
{
    lanes_hidden_matrix(c, q, p, W);
}
#endif

#if GS_SPARK
/* H_p and H_q at one q share the factors of M. */
enum { SHARED = MASS, ROUNDS = 1 };

/* H_p = v, and the factors of M */
INLINE void first_rates(const lanes_constants *c, const lanes q[N], const lanes p[N],
    lanes H_p[N], lanes shared[SHARED])
{
    lanes_factor_mass(c, q, shared);
    lanes_velocities(c, q, p, shared, H_p);
}

/* H_q - F = -R(q, v, t) and H_p = v, from the factors of M */
static void second_rates(const lanes_constants *c, const lanes q[N], const lanes p[N],
    const lanes t[1], const lanes shared[SHARED], lanes H_p[N], lanes H_q[N])
{
    lanes_velocities(c, q, p, shared, H_p);
    lanes_generalised_force(c, q, H_p, t, H_q);
    for (int a = 0; a < N; ++a)
        H_q[a] = -H_q[a];
}
#else
#if GS_ENERGY_MOMENTUM
/* D_p = (v0 + v1)/2 */
static void lanes_mean_velocity(const lanes_constants *c, const lanes qm[N],
    const lanes pm[N], const lanes dq[N], const lanes dp[N], lanes D_p[N])
{
    lanes q1[N], A[MASS], v0[N], v1[N];
    lanes_end_velocities(c, qm, pm, dq, dp, q1, A, v0, v1);
    for (int a = 0; a < N; ++a)
        D_p[a] = (real)0.5*(v0[a] + v1[a]);
}

/* D_q - F = -R, the discrete generalised force between both ends */
static void lanes_mean_force(const lanes_constants *c, const lanes qm[N], const lanes pm[N],
    const lanes dq[N], const lanes dp[N], const lanes t[1], lanes D_q[N])
{
    lanes q1[N], A[MASS], v0[N], v1[N];
    lanes_end_velocities(c, qm, pm, dq, dp, q1, A, v0, v1);
    lanes_mean_generalised_force(c, qm, dq, v0, v1, t, D_q);
    for (int a = 0; a < N; ++a)
        D_q[a] = -D_q[a];
}
#else
/* D_p = v at the midpoint */
static inline void lanes_mean_velocity(const lanes_constants *c, const lanes qm[N],
    const lanes pm[N], const lanes dq[N], const lanes dp[N], lanes D_p[N])
{
    lanes A[MASS];
    (void)dq, (void)dp;
    lanes_factor_mass(c, qm, A);
    lanes_velocities(c, qm, pm, A, D_p);
}

/* D_q - F = -R(q, v, t) at the midpoint */
static void lanes_mean_force(const lanes_constants *c, const lanes qm[N], const lanes pm[N],
    const lanes dq[N], const lanes dp[N], const lanes t[1], lanes D_q[N])
{
    lanes v[N];
    lanes_mean_velocity(c, qm, pm, dq, dp, v);
    lanes_generalised_force(c, qm, v, t, D_q);
    for (int a = 0; a < N; ++a)
        D_q[a] = -D_q[a];
}
#endif
#endif

#endif
