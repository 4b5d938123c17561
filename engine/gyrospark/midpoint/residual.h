/* Implicit midpoint (IMS) and energy-momentum (EMS) schemes: mean values and the residual. */
#ifndef GS_MIDPOINT_RESIDUAL_H
#define GS_MIDPOINT_RESIDUAL_H

#include "gyrospark/linear_algebra/norms.h"

#if GS_LAGRANGIAN
#include "gyrospark/lagrangian/derivatives.h"
#endif

#if GS_CONSTRAINED
#include "gyrospark/constraints/projection.h"
#endif

#if GS_CONSTRAINED
/* force += G^T lambda with the mean constraint Jacobian G of both ends of the step */
static void add_mean_constraint_force(const constants *c, const real qm[N], const real dq[N],
    const real lambda[M], real force[N])
{
#if GS_ELEMENTS
    real mean_force[N];
    mean_pull(c, qm, dq, lambda, mean_force);
    for (int a = 0; a < N; ++a)
        force[a] += mean_force[a];
#else
    real G[M][N];
    mean_constraint(c, qm, dq, G);
    for (int a = 0; a < N; ++a)
        for (int mu = 0; mu < M; ++mu)
            force[a] += G[mu][a]*lambda[mu];
#endif
}

/* Adds the constraint force to the rows of dp; appends the rows g(q + dq). */
static void constraint_rows(work_t *w, const real q[N], const real x[U], real r[U])
{
    real g[M], dg[M];
    add_mean_constraint_force(&w->constants, w->q_mean, x, x + 2*N, r + N);
    constraint(AT(&w->constants, w->t), q, g);
    constraint_increment(BETWEEN(&w->constants, w->t, w->step), q, x, dg);
    for (int mu = 0; mu < M; ++mu)
        r[2*N + mu] = g[mu] + dg[mu];
}

/* d <- q1 - q */
static void displacement(real dt, const real x[U], real d[N])
{
    (void)dt;
    for (int a = 0; a < N; ++a)
        d[a] = x[a];
}
#endif

#include "gyrospark/midpoint/unknowns.h"

/* Explicit Euler start, without constraint forces. */
static void euler_start(work_t *w, real dt, const real q[N], const real p[N], real x[U])
{
    const real zero[N] = { 0 };
    real D_q[N], D_p[N];
    mean_gradient(AT(&w->constants, w->t), q, p, zero, zero, &w->t, D_q, D_p);
    for (int a = 0; a < N; ++a) {
        x[a] = dt*D_p[a];
        x[DP + a] = -dt*D_q[a];
    }
    for (int l = LAMBDA; l < U; ++l)
        x[l] = 0;
}

/* Zero-force start: dp = 0, for stiff forces that mislead the Euler start. */
static void zero_force_start(real x[U])
{
    for (int e = DP; e < LAMBDA; ++e)
        x[e] = 0;
}

/* Mean values q_mean = q + dq/2, p_mean = p + dp/2 (51) */
static void mean_values(work_t *w, const real q[N], const real p[N], const real x[U])
{
    for (int a = 0; a < N; ++a) {
        w->q_mean[a] = q[a] + x[a]/2;
        w->p_mean[a] = p[a] + x[DP + a]/2;
    }
}

/*
 * r = [dq/dt - D_p; dp/dt + D_q - F + G^T lambda; g(q + dq)], with F at the mean values and
 * t + dt/2, and the mean constraint Jacobian G of both ends
 */
static void residual(work_t *w, real dt, const real q[N], const real p[N], const real x[U],
    real r[U])
{
    real D_q[N], D_p[N];
    const real t = w->t + dt/2;
    mean_values(w, q, p, x);
    mean_gradient(BETWEEN(&w->constants,
        w->t, w->step), w->q_mean, w->p_mean, x, x + DP, &t, D_q, D_p);
    for (int a = 0; a < N; ++a) {
        r[a] = x[a]/dt - D_p[a];
        r[DP + a] = x[DP + a]/dt + D_q[a];
    }
    IF_CONSTRAINED(constraint_rows(w, q, x, r);)
}

/* Norm of an increment, max(|ddq|/|q|, |ddp|/|p|), relative to the state; excludes multipliers. */
static real increment_size(const work_t *w, real dt, const real q[N], const real p[N],
    const real x[U], const real dx[U])
{
    (void)w, (void)dt;
    const real q_weight = larger(state_norm(1, q), state_norm(1, x));
    const real p_weight = larger(state_norm(1, p), state_norm(1, x + DP));
    const real dq = state_norm(1, dx), dp = state_norm(1, dx + DP);
    return larger(dq > 0 ? dq/q_weight : dq, dp > 0 ? dp/p_weight : dp);
}

/* Norm of dt r in the scale of increment_size; excludes the constraint residual. */
static real residual_size(const work_t *w, real dt, const real q[N], const real p[N],
    const real x[U], const real r[U])
{
    return MATH(fabs)(dt)*increment_size(w, dt, q, p, x, r);
}

#endif
