/* SPARK methods: stage values and the residual of T1, equations (A.7) and (B.1). */
#ifndef GS_SPARK_RESIDUAL_H
#define GS_SPARK_RESIDUAL_H

#include "gyrospark/linear_algebra/norms.h"

#if GS_LAGRANGIAN
#include "gyrospark/lagrangian/derivatives.h"
#endif

#if GS_CONSTRAINED
#include "gyrospark/constraints/projection.h"
#endif

#if GS_EXACT_ENERGY
#include "gyrospark/spark/exact_energy.h"
#endif

#if GS_CONSTRAINED
#if GS_VELOCITY_CONSTRAINTS
/* Number of multipliers Lambda_l, l = 0..P: the last enters the velocity constraints of T1 */
enum { ACTING = P + 1 };
#else
/* Number of multipliers Lambda_l, l = 0..P-1, that enter the stage equations */
enum { ACTING = P };
#endif

/* Constraint forces G(Q~_l)^T Lambda_l at the nodes l = 0..P-1 */
static void node_forces(work_t *w, const real q[N], const real x[U])
{
    const real *lambda = x + 2*S*N;
    for (int l = 0; l <= P; ++l)
        for (int a = 0; a < N; ++a)
            w->Q_tilde[l][a] = q[a] + w->D[l][a];
    for (int l = 0; l < ACTING; ++l)
        constraint_force(AT(&w->constants,
            w->t + w->node_time[l]), w->Q_tilde[l], lambda + l*M, w->force[l]);
}

/* r <- g(Q~_l) at the nodes l = 1..P, as g(q) plus an increment, which avoids cancellation */
static void node_residuals(work_t *w, const real q[N], real r[P*M])
{
    real g[M];
    constraint(AT(&w->constants, w->t), q, g);
    for (int l = 1; l <= P; ++l) {
        real dg[M];
        constraint_increment(BETWEEN(&w->constants, w->t, w->node_time[l]), q, w->D[l], dg);
        for (int mu = 0; mu < M; ++mu)
            r[(l - 1)*M + mu] = g[mu] + dg[mu];
    }
}
#else
enum { ACTING = 0 };
#endif

#include "gyrospark/spark/unknowns.h"

/* Explicit Euler start: the rates at the start of the step, without constraint forces. */
static void euler_start(work_t *w, real dt, const real q[N], const real p[N], real x[U])
{
    real H_q[N], H_p[N];
    (void)dt;
    gradient(AT(&w->constants, w->t), q, p, &w->t, H_q, H_p);
    for (int i = 0; i < S; ++i)
        for (int a = 0; a < N; ++a) {
            x[i*N + a] = H_p[a];
            x[K_HAT + i*N + a] = -H_q[a];
        }
    for (int l = LAMBDA; l < U; ++l)
        x[l] = 0;
}

/* Zero-force start: k^_i = 0, for stiff forces whose Euler start diverges. */
static void zero_force_start(real x[U])
{
    for (int e = K_HAT; e < LAMBDA; ++e)
        x[e] = 0;
}

/* Displacements D_l = dt sum a-_lj k_j of the constraint nodes Q~_l = q + D_l (A.7) */
static void node_displacements(work_t *w, real dt, const real x[U])
{
    IF_TIME(for (int l = 0; l <= P; ++l))
        IF_TIME(w->node_time[l] = w->step*tableau.c_tilde[l];)
    for (int l = 0; l <= P; ++l)
        for (int a = 0; a < N; ++a) {
            real sum = 0;
            for (int j = 0; j < S; ++j)
                sum += tableau.A_bar[l][j]*x[j*N + a];
            w->D[l][a] = dt*sum;
        }
#if GS_EXACT_ENERGY && GS_CONSTRAINED
    add_theta_to_nodes(w, dt, x);
#endif
}

/*
 * (A.7): Q_i = q + dt sum a_ij k_j,
 *        P_i = p + dt sum a^_ij k^_j - dt sum a~_il G(Q~_l)^T Lambda_l
 */
static void stage_values(work_t *w, real dt, const real q[N], const real p[N], const real x[U])
{
    node_displacements(w, dt, x);
    IF_CONSTRAINED(node_forces(w, q, x);)
    for (int i = 0; i < S; ++i)
        for (int a = 0; a < N; ++a) {
            real rate = 0, force = 0;
            for (int j = 0; j < S; ++j) {
                rate += tableau.A[i][j]*x[j*N + a];
                force += tableau.A_hat[i][j]*x[K_HAT + j*N + a];
            }
            w->stage_q[i][a] = q[a] + dt*rate;
            for (int l = 0; l < ACTING; ++l)
                force -= tableau.A_tilde[i][l]*w->force[l][a];
            w->stage_p[i][a] = p[a] + dt*force;
        }
#if GS_EXACT_ENERGY
    add_theta_to_stages(w, dt, x);
#endif
}

#if GS_VELOCITY_CONSTRAINTS
#include "gyrospark/velocity_constraints/equations.h"
#endif

/* (B.1): r = [k_i - H_p(Q_i, P_i); k^_i + H_q(Q_i, P_i) - F(Q_i, P_i, t_i); g(Q~_l), l = 1..P] */
static void residual(work_t *w, real dt, const real q[N], const real p[N], const real x[U],
    real r[U])
{
    stage_values(w, dt, q, p, x);
    for (int i = 0; i < S; ++i) {
        real H_q[N], H_p[N];
        const real t = w->t + dt*tableau.c[i];
        gradient(AT(&w->constants, t), w->stage_q[i], w->stage_p[i], &t, H_q, H_p);
        for (int a = 0; a < N; ++a) {
            r[i*N + a] = x[i*N + a] - H_p[a];
            r[K_HAT + i*N + a] = x[K_HAT + i*N + a] + H_q[a];
        }
    }
    IF_CONSTRAINED(node_residuals(w, q, r + LAMBDA);)
#if GS_VELOCITY_CONSTRAINTS
    add_reactions(w, dt, x, r);
    velocity_residuals(w, dt, q, p, x, r);
#endif
}

/*
 * Norm of an increment: the relative change of the state that it causes, max(dt|dk|/|q|,
 * dt|dk^|/|p|). The scale |p| includes the stage values of the last residual, because p = 0 for a
 * body at rest. Multipliers are excluded: their round-off grows like 1/dt^2 and does not affect the
 * state.
 */
static real increment_size(const work_t *w, real dt, const real q[N], const real p[N],
    const real x[U], const real dx[U])
{
    const real step = MATH(fabs)(dt);
    const real q_weight = larger(state_norm(1, q), step*state_norm(S, x));
    const real p_stages = larger(state_norm(S, &w->stage_p[0][0]), step*state_norm(S, x + K_HAT));
    const real p_weight = larger(state_norm(1, p), p_stages);
    const real dq = step*state_norm(S, dx), dp = step*state_norm(S, dx + K_HAT);
    return larger(dq > 0 ? dq/q_weight : dq, dp > 0 ? dp/p_weight : dp);
}

/* Norm of a residual in the scale of increment_size; excludes the constraint residual. */
static real residual_size(const work_t *w, real dt, const real q[N], const real p[N],
    const real x[U], const real r[U])
{
    return increment_size(w, dt, q, p, x, r);
}

#endif
