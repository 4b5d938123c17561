/* Derivatives of the rates of a Lagrangian system by its constants and the time. */
#ifndef GS_DERIVATIVES_LAGRANGIAN_H
#define GS_DERIVATIVES_LAGRANGIAN_H

#include "gyrospark/lagrangian/derivatives.h"

/* v_q = -M^-1 P with P = d(b + M v)/dq, v_p = M^-1, v_c = -M^-1 L_vc */
static void velocities_by_state(const constants *at, const real q[N], const real v[N],
    const real A[MASS], real v_q[N][N], real v_p[N][N], real v_c[N][E])
{
    const real zero[N] = { 0 };
    real direction[N] = { 0 }, P[N][N], momentum_c[N][E], column[N];
    momentum_by_constants(at, q, v, momentum_c);
    for (int b = 0; b < N; ++b) {
        direction[b] = 1;
        force_derivative(at, q, v, zero, direction, P[b]);
        for (int a = 0; a < N; ++a)
            column[a] = direction[a];
        solve_mass(A, column);
        for (int a = 0; a < N; ++a)
            v_p[a][b] = column[a];
        direction[b] = 0;
    }
    for (int a = 0; a < N; ++a) {
        for (int b = 0; b < N; ++b) {
            v_q[a][b] = 0;
            for (int e = 0; e < N; ++e)
                v_q[a][b] -= v_p[a][e]*P[e][b];
        }
        for (int b = 0; b < E; ++b) {
            v_c[a][b] = 0;
            for (int e = 0; e < N; ++e)
                v_c[a][b] -= v_p[a][e]*momentum_c[e][b];
        }
    }
}

#if GS_CONSTRAINED
/* Derivatives of f = G v + g_t by q, p and constants */
static void hidden_derivative(const constants *c, const real q[N], const real p[N],
    real f_q[M][N], real f_p[M][N], real f_c[M][E])
{
    real A[MASS], v[N], v_q[N][N], v_p[N][N], v_c[N][E], G[M][N];
    factor_mass(c, q, A);
    velocities(c, q, p, A, v);
    velocities_by_state(c, q, v, A, v_q, v_p, v_c);
    velocity_constraint(c, q, v, f_q, f_c);
    constraint_jacobian(c, q, G);
    for (int m = 0; m < M; ++m)
        for (int a = 0; a < N; ++a) {
            f_p[m][a] = 0;
            for (int b = 0; b < N; ++b) {
                f_q[m][a] += G[m][b]*v_q[b][a];
                f_p[m][a] += G[m][b]*v_p[b][a];
            }
            for (int e = 0; e < E; ++e)
                f_c[m][e] += G[m][a]*v_c[a][e];
        }
}
#endif

#if GS_ENERGY_MOMENTUM
/* D_p = (v0 + v1)/2 and D_q - F = -R(qm, dq, v0, v1); the start and the end move alike. */
static void mean_rates_derivative(const constants *c, const real qm[N], const real pm[N],
    const real dq[N], const real dp[N], const real t[1], real D_qq[N][N], real D_qp[N][N],
    real D_pq[N][N], real D_pp[N][N], real D_qc[N][E], real D_pc[N][E])
{
    real q1[N], A[MASS], v[2][N], R_q[N][N], R_v[2][N][N], v_q[N][N], v_p[N][N], v_c[N][E];
    end_velocities(c, qm, pm, dq, dp, q1, A, v[0], v[1]);
    mean_generalised_force_by_state(c, qm, dq, v[0], v[1], t, R_q, R_v[0], R_v[1], D_qc);
    for (int a = 0; a < N; ++a) {
        for (int b = 0; b < N; ++b) {
            D_qq[a][b] = -R_q[a][b];
            D_qp[a][b] = D_pq[a][b] = D_pp[a][b] = 0;
        }
        for (int b = 0; b < E; ++b) {
            D_qc[a][b] = -D_qc[a][b];
            D_pc[a][b] = 0;
        }
    }
    for (int side = 0; side < 2; ++side) {
        real q[N];
        const constants *at = c;
        IF_TIME(constants end = *c;)
        IF_TIME(at = at_time(&end, c->_t + (side - (real)0.5)*c->_dt);)
        for (int a = 0; a < N; ++a)
            q[a] = qm[a] + (side - (real)0.5)*dq[a];
        factor_mass(at, q, A);
        velocities_by_state(at, q, v[side], A, v_q, v_p, v_c);
#if TIMES > 1
        for (int a = 0; a < N; ++a) /* t of the end is that of the middle -+ dt/2 */
            v_c[a][E - 1] = (side - (real)0.5)*v_c[a][E - 2];
#endif
        for (int a = 0; a < N; ++a)
            for (int e = 0; e < N; ++e) {
                const real by_v = R_v[side][a][e], half = a == e ? (real)0.5 : 0;
                for (int b = 0; b < N; ++b) {
                    D_qq[a][b] -= by_v*v_q[e][b];
                    D_qp[a][b] -= by_v*v_p[e][b];
                    D_pq[a][b] += half*v_q[e][b];
                    D_pp[a][b] += half*v_p[e][b];
                }
                for (int b = 0; b < E; ++b) {
                    D_qc[a][b] -= by_v*v_c[e][b];
                    D_pc[a][b] += half*v_c[e][b];
                }
            }
    }
}
#else
/*
 * At constant p the velocity obeys M dv = -L_vc dc, so that dH_p = -H_pp L_vc dc. R = dL/dq + F
 * depends on v by R_v = -H_qp M, hence H_q - F = -R has -R_c - H_qp L_vc.
 */
static void rates_derivative(const constants *c, const real q[N], const real p[N],
    const real t[1], real H_qq[N][N], real H_qp[N][N], real H_pq[N][N], real H_pp[N][N],
    real H_qc[N][E], real H_pc[N][E])
{
    real A[MASS], v[N], momentum_c[N][E];
    rates_by_state(c, q, p, t, H_qq, H_qp, H_pq, H_pp);
    factor_mass(c, q, A);
    velocities(c, q, p, A, v);
    momentum_by_constants(c, q, v, momentum_c);
    generalised_force_by_constants(c, q, v, t, H_qc);
    for (int a = 0; a < N; ++a)
        for (int e = 0; e < E; ++e) {
            real force = -H_qc[a][e], velocity = 0;
            for (int b = 0; b < N; ++b) {
                force -= H_qp[a][b]*momentum_c[b][e];
                velocity -= H_pp[a][b]*momentum_c[b][e];
            }
            H_qc[a][e] = force;
            H_pc[a][e] = velocity;
        }
}


#if !GS_SPARK
/* IMS: the derivatives at the midpoint. */
static void mean_rates_derivative(const constants *c, const real qm[N], const real pm[N],
    const real dq[N], const real dp[N], const real t[1], real D_qq[N][N], real D_qp[N][N],
    real D_pq[N][N], real D_pp[N][N], real D_qc[N][E], real D_pc[N][E])
{
    (void)dq, (void)dp;
    rates_derivative(c, qm, pm, t, D_qq, D_qp, D_pq, D_pp, D_qc, D_pc);
}
#endif
#endif

#endif
