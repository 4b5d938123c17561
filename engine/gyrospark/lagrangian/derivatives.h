/* Derivatives of the H of a Lagrangian for Newton's method; momenta and velocities. */
#ifndef GS_LAGRANGIAN_DERIVATIVES_H
#define GS_LAGRANGIAN_DERIVATIVES_H

#include "gyrospark/engine.h"

#if GS_ENERGY_MOMENTUM
/*
 * Discrete gradient: D_p = (v0 + v1)/2 and D_q - F = -R. Without forces it satisfies
 * H(q1, p1) - H(q0, p0) = D_q.dq + D_p.dp.
 */
static void mean_gradient(const constants *c, const real qm[N], const real pm[N],
    const real dq[N], const real dp[N], const real t[1], real D_q[N], real D_p[N])
{
    real q1[N], A[MASS], v0[N], v1[N];
    end_velocities(c, qm, pm, dq, dp, q1, A, v0, v1);
    mean_generalised_force(c, qm, dq, v0, v1, t, D_q);
    for (int a = 0; a < N; ++a) {
        D_q[a] = -D_q[a];
        D_p[a] = (v0[a] + v1[a])/2;
    }
}

/*
 * Derivatives of the discrete gradient by dq and dp at a fixed start (q0, p0): with
 * P = d(b + M v)/dq at the end, dv1 = M^-1 (dp - P dq), and R depends on q1 and v1.
 */
static void mean_jacobian(const constants *c, const real qm[N], const real pm[N],
    const real dq[N], const real dp[N], const real t[1], real D_qq[N][N], real D_qp[N][N],
    real D_pq[N][N], real D_pp[N][N])
{
    const real zero[N] = { 0 };
    real q1[N], A[MASS], v0[N], v1[N], direction[N] = { 0 }, P[N][N], R_v[N][N], change[N];
    const constants *c_end = c;
    IF_TIME(constants end = *c;)
    IF_TIME(c_end = at_time(&end, c->_t + c->_dt/2);)
    end_velocities(c, qm, pm, dq, dp, q1, A, v0, v1);
    for (int b = 0; b < N; ++b) {
        direction[b] = 1;
        force_derivative(c_end, q1, v1, zero, direction, P[b]);
        mean_generalised_force_derivative(c, qm, dq, v0, v1, t, zero, direction, change);
        for (int a = 0; a < N; ++a)
            R_v[a][b] = change[a];
        direction[b] = 0;
    }
    for (int column = 0; column < N; ++column) {
        real by_p[N] = { 0 }, by_q[N];
        direction[column] = by_p[column] = 1;
        solve_mass(A, by_p);
        for (int a = 0; a < N; ++a)
            by_q[a] = -P[a][column];
        solve_mass(A, by_q);
        mean_generalised_force_derivative(c, qm, dq, v0, v1, t, direction, by_q, change);
        for (int a = 0; a < N; ++a) {
            real sum = 0;
            for (int b = 0; b < N; ++b)
                sum += R_v[a][b]*by_p[b];
            D_pq[a][column] = by_q[a]/2;
            D_pp[a][column] = by_p[a]/2;
            D_qq[a][column] = -change[a];
            D_qp[a][column] = -sum;
        }
        direction[column] = 0;
    }
}
#else
/* Gradient of H: H_p = v, H_q - F = -R(q, v, t) with R = dL/dq + F */
static void gradient(const constants *c, const real q[N], const real p[N], const real t[1],
    real H_q[N], real H_p[N])
{
    real A[MASS];
    factor_mass(c, q, A);
    velocities(c, q, p, A, H_p);
    generalised_force(c, q, H_p, t, H_q);
    for (int a = 0; a < N; ++a)
        H_q[a] = -H_q[a];
}

/* change <- d(dL/dq + F) along dq and dv */
static void rate_derivative(const constants *c, const real q[N], const real v[N],
    const real t[1], const real dq[N], const real dv[N], real change[N])
{
    (void)t; /* of the forces */
    force_derivative(c, q, v, dq, dv, change);
#if GS_FORCES
    real dF[N];
    applied_force_derivative(c, q, v, t, dq, dv, dF);
    for (int a = 0; a < N; ++a)
        change[a] += dF[a];
#endif
}

/*
 * Second derivatives of H - F from those of L at the velocity v. With P = d(b + M v)/dq, the
 * transpose of d(dL/dq)/dv, constant p requires M dv = -P dq. Hence H_pp = M^-1, H_pq = -M^-1 P,
 * and with R = dL/dq + F, H_qq = -(R_q + R_v H_pq) and H_qp = -R_v H_pp.
 */
static void rates_by_state(const constants *c, const real q[N], const real p[N], const real t[1],
    real H_qq[N][N], real H_qp[N][N], real H_pq[N][N], real H_pp[N][N])
{
    const real zero[N] = { 0 };
    real A[MASS], v[N], direction[N] = { 0 }, P[N][N], R_v[N][N], change[N];
    factor_mass(c, q, A);
    velocities(c, q, p, A, v);
    for (int b = 0; b < N; ++b) {
        direction[b] = 1;
        force_derivative(c, q, v, zero, direction, P[b]);
        rate_derivative(c, q, v, t, zero, direction, change);
        for (int a = 0; a < N; ++a)
            R_v[a][b] = change[a];
        direction[b] = 0;
    }
    for (int column = 0; column < N; ++column) {
        real by_p[N] = { 0 }, by_q[N];
        direction[column] = by_p[column] = 1;
        solve_mass(A, by_p);
        for (int a = 0; a < N; ++a)
            by_q[a] = -P[a][column];
        solve_mass(A, by_q);
        rate_derivative(c, q, v, t, direction, by_q, change);
        for (int a = 0; a < N; ++a) {
            real sum = 0;
            for (int b = 0; b < N; ++b)
                sum += R_v[a][b]*by_p[b];
            H_pq[a][column] = by_q[a];
            H_pp[a][column] = by_p[a];
            H_qq[a][column] = -change[a];
            H_qp[a][column] = -sum;
        }
        direction[column] = 0;
    }
}

#if !GS_SPARK
/* D_q, D_p <- the gradient at the midpoint */
static inline void mean_gradient(const constants *c, const real qm[N], const real pm[N],
    const real dq[N], const real dp[N], const real t[1], real D_q[N], real D_p[N])
{
    (void)dq, (void)dp;
    gradient(c, qm, pm, t, D_q, D_p);
}

/* Derivatives of D_q and D_p by dq and dp: half the second derivatives at the midpoint */
static inline void mean_jacobian(const constants *c, const real qm[N], const real pm[N],
    const real dq[N], const real dp[N], const real t[1], real D_qq[N][N], real D_qp[N][N],
    real D_pq[N][N], real D_pp[N][N])
{
    (void)dq, (void)dp;
    rates_by_state(c, qm, pm, t, D_qq, D_qp, D_pq, D_pp);
    for (int a = 0; a < N; ++a)
        for (int b = 0; b < N; ++b) {
            D_qq[a][b] /= 2;
            D_qp[a][b] /= 2;
            D_pq[a][b] /= 2;
            D_pp[a][b] /= 2;
        }
}
#endif
#endif

void NAME(velocities)(const parameters_t *parameters, long count, IF_TIME(
    const real *t,) const real *q, const real *p,
    real *v)
{
    constants c;
    real A[MASS];
    prepare(parameters, &c);
    for (long i = 0; i < count; ++i) {
        factor_mass(AT(&c, time_of(parameters, t, i)), q + i*N, A);
        velocities(&c, q + i*N, p + i*N, A, v + i*N);
    }
}

void NAME(momenta)(const parameters_t *parameters, long count, IF_TIME(
    const real *t,) const real *q, const real *v,
    real *p)
{
    constants c;
    real A[MASS];
    prepare(parameters, &c);
    for (long i = 0; i < count; ++i, q += N, v += N, p += N) {
        const int *row = mass_row, *slot = mass_slot;
        mass_matrix(AT(&c, time_of(parameters, t, i)), q, A);
        rest_momentum(&c, q, p);
        for (int k = 0; k < N; ++k) {
            const int pivot = mass_order[k];
            p[pivot] += A[pivot]*v[pivot];
            for (int j = 0; j < mass_rows[k]; ++j, ++row, ++slot) {
                p[pivot] += A[*slot]*v[*row];
                p[*row] += A[*slot]*v[pivot];
            }
        }
    }
}

#endif
