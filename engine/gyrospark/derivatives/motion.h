/* Public functions: the second time derivative of a state, with the multipliers, and H_pp. */
#ifndef GS_DERIVATIVES_MOTION_H
#define GS_DERIVATIVES_MOTION_H

#include "gyrospark/derivatives/steps.h"

/* v <- H_p, force <- F - H_q */
static void rates_of_state(const constants *at, const real q[N], const real p[N], real v[N],
    real force[N])
{
    const real t = 0; /* kernels count from the start */
#if GS_SPARK
    gradient(at, q, p, &t, force, v);
#else
    const real zero[N] = { 0 };
    mean_gradient(at, q, p, zero, zero, &t, force, v);
#endif
    for (int a = 0; a < N; ++a)
        force[a] = -force[a];
}

#if GS_ELEMENTS
/* change <- H_pq dq + H_pp dp + H_pt dt */
static void velocity_change(const rates_matrices *rates, const real dq[N], const real dp[N],
    real dt, real change[N])
{
    real force[N] = { 0 }, dc[E] = { 0 };
    (void)dt;
#if TIMES
    dc[E - TIMES] = dt;
#endif
    for (int a = 0; a < N; ++a)
        change[a] = 0;
    rates_times(rates, dq, dp, dc, force, change);
}
#else
/* Derivatives of v = H_p by q, p and t */
static void velocity_derivatives(const constants *at, const real q[N], const real p[N],
    real H_pq[N][N], real H_pp[N][N], real H_pt[N])
{
    const real t = 0;
    real H_qq[N][N], H_qp[N][N];
    for (int a = 0; a < N; ++a)
        H_pt[a] = 0;
#if !GS_SPARK
    const real zero[N] = { 0 };
    real H_qc[N][E], H_pc[N][E];
    mean_rates_derivative(at, q, p, zero, zero, &t, H_qq, H_qp, H_pq, H_pp, H_qc, H_pc);
#elif !GS_TIME_DEPENDENT
    rates_by_state(at, q, p, &t, H_qq, H_qp, H_pq, H_pp);
#elif GS_LAGRANGIAN
    real H_qc[N][E], H_pc[N][E];
    rates_derivative(at, q, p, &t, H_qq, H_qp, H_pq, H_pp, H_qc, H_pc);
#else
    real H_qc[N][E], H_pc[N][E];
    rates_by_state(at, q, p, &t, H_qq, H_qp, H_pq, H_pp);
    rates_by_constants(at, q, p, &t, H_qc, H_pc);
#endif
#if GS_TIME_DEPENDENT
    for (int a = 0; a < N; ++a)
        H_pt[a] = H_pc[a][E - TIMES];
#endif
}
#endif

#if GS_CONSTRAINED
/*
 * lambda <- W^-1 (f_q v + f_p force + f_t), force <- force - G^T lambda: then f = G H_p + g_t stays
 * zero along q' = v, p' = force. (Hairer-Lubich-Wanner, VII.1.2)
 */
static int constrain_force(const constants *at, const real q[N], const real p[N], const real v[N],
    real force[N], real lambda[M], derivatives_t *d)
{
    real pull[N];
#if GS_ELEMENTS
    real dc[E] = { 0 };
#if TIMES
    dc[E - TIMES] = 1;
#endif
    int status = linearise_hidden(at, q, p, &d->hidden);
    for (int m = 0; m < M; ++m)
        lambda[m] = 0;
    add_hidden_times(&d->hidden, v, force, dc, lambda);
    substitute(d->hidden.W, lambda);
#else
    real f_q[M][N], f_p[M][N], f_c[M][E];
    (void)d;
    hidden_derivative(at, q, p, f_q, f_p, f_c);
    for (int m = 0; m < M; ++m) {
        lambda[m] = 0;
#if TIMES
        lambda[m] = f_c[m][E - TIMES];
#endif
        for (int a = 0; a < N; ++a)
            lambda[m] += f_q[m][a]*v[a] + f_p[m][a]*force[a];
    }
    int status = solve_momentum(at, q, p, lambda);
#endif
    constraint_force(at, q, lambda, pull);
    for (int a = 0; a < N; ++a)
        force[a] -= pull[a];
    return status;
}
#endif

int NAME(accelerations)(const parameters_t *parameters, const real q[N], const real p[N], real v[N],
    real rate[N], real acceleration[N], real *lambda, void *memory)
{
    derivatives_t *d = derivatives_of(memory);
    prepare(parameters, &d->work.constants);
    const constants *at = AT(&d->work.constants, start_time(parameters));
    rates_of_state(at, q, p, v, rate);
#if GS_CONSTRAINED
    const int status = constrain_force(at, q, p, v, rate, lambda, d);
#else
    const int status = OK;
    (void)lambda;
#endif
#if GS_ELEMENTS
    const real t = 0; /* kernels count from the start */
    evaluate_rates(at, q, p, &t, 0, &d->rates);
    velocity_change(&d->rates, v, rate, 1, acceleration);
#else
    real H_pq[N][N], H_pp[N][N], H_pt[N];
    velocity_derivatives(at, q, p, H_pq, H_pp, H_pt);
    for (int a = 0; a < N; ++a) {
        acceleration[a] = H_pt[a];
        for (int b = 0; b < N; ++b)
            acceleration[a] += H_pq[a][b]*v[b] + H_pp[a][b]*rate[b];
    }
#endif
    return status;
}

/* inverse <- H_pp, N rows */
static void evaluate_inverse_mass(const constants *at, const real q[N], const real p[N],
    real *inverse, derivatives_t *d)
{
#if GS_ELEMENTS
    const real zero[N] = { 0 };
    evaluate_rates(at, q, p, zero, 0, &d->rates);
    for (int b = 0; b < N; ++b) { /* H_pp is symmetric: its columns are its rows */
        real unit[N] = { 0 };
        unit[b] = 1;
        velocity_change(&d->rates, zero, unit, 0, inverse + b*N);
    }
#else
    real H_pq[N][N], H_pp[N][N], H_pt[N];
    (void)d;
    velocity_derivatives(at, q, p, H_pq, H_pp, H_pt);
    for (int a = 0; a < N; ++a)
        for (int b = 0; b < N; ++b)
            inverse[a*N + b] = H_pp[a][b];
#endif
}

void NAME(inverse_mass)(const parameters_t *parameters, const real q[N], const real p[N],
    real *inverse, void *memory)
{
    derivatives_t *d = derivatives_of(memory);
    prepare(parameters, &d->work.constants);
    evaluate_inverse_mass(AT(&d->work.constants, start_time(parameters)), q, p, inverse, d);
}

#endif
