/* SPARK methods: T2, which computes the end of the step, and the work of a step. */
#ifndef GS_SPARK_STEP_END_H
#define GS_SPARK_STEP_END_H

#include "gyrospark/spark/residual.h"

#if GS_VELOCITY_CONSTRAINTS
/*
 * q1 = Q~_P, p1 = P~_P and the multipliers Lambda_0..Lambda_P, M_1..M_S. P~_P satisfies all conditions
 * on momenta but for the error of Newton's method, which a projection removes.
 */
static int finish(work_t *w, real dt, const real q[N], const real p[N], const real x[U],
    real q1[N], real p1[N], real multipliers[ROOM])
{
    real Q[N], momentum[N], impulse[HIDDEN];
    stage_values(w, dt, q, p, x);
    node_state(w, dt, q, p, x, P, Q, momentum);
    for (int a = 0; a < N; ++a) {
        q1[a] = Q[a];
        p1[a] = momentum[a];
    }
    for (int l = 0; l < MULTIPLIERS; ++l)
        multipliers[l] = x[FIRST_LAMBDA + l];
    const int status = project_momentum(AT(&w->constants, w->t + w->step), q1, p1, impulse);
    return status != OK || isfinite(norm(N, q1) + norm(N, p1)) ? status : NOT_FINITE;
}
#endif

#if GS_CLOCK
/* 1 if t' > 0 at all stages. */
static int time_advances(const real x[U])
{
    int advances = 1;
    for (int i = 0; i < S; ++i)
        advances &= x[i*N + N - 1] > 0;
    return advances;
}
#endif

#if GS_CONSTRAINED
/* d <- q1 - q (A.3) */
static void displacement(real dt, const real x[U], real d[N])
{
    for (int a = 0; a < N; ++a) {
        real sum = 0;
        for (int j = 0; j < S; ++j)
            sum += tableau.b[j]*x[j*N + a];
        d[a] = dt*sum;
    }
}

#endif

#if !GS_VELOCITY_CONSTRAINTS
/*
 * T2: q1 = q + dt sum b_j k_j (A.3), P = p + dt sum b^_j k^_j - dt sum_(l<p) b~_l G_l^T Lambda_l.
 * The projection of P onto f(q1, p1) = 0 yields p1 and the last multiplier (A.5), (A.6).
 */
static int finish(work_t *w, real dt, const real q[N], const real p[N], const real x[U],
    real q1[N], real p1[N], real multipliers[ROOM])
{
    IF_CLOCK(if (!time_advances(x)) return TIME_STOPPED;)
    stage_values(w, dt, q, p, x);
    for (int a = 0; a < N; ++a) {
        real force = 0;
        for (int j = 0; j < S; ++j)
            force += tableau.b_hat[j]*x[K_HAT + j*N + a];
        for (int l = 0; l < ACTING; ++l)
            force -= tableau.b_tilde[l]*w->force[l][a];
        q1[a] = q[a] + w->D[P][a];
        p1[a] = p[a] + dt*force;
    }
    int status = OK;
#if GS_CONSTRAINED
    for (int l = 0; l < P*M; ++l)
        multipliers[l] = x[LAMBDA + l];
    status = project_momentum(AT(&w->constants, w->t + w->step), q1, p1, multipliers + P*M);
    for (int mu = 0; mu < M; ++mu)
        multipliers[P*M + mu] /= dt*tableau.b_tilde[P];
#else
    (void)multipliers;
#endif
    return status != OK || isfinite(norm(N, q1) + norm(N, p1)) ? status : NOT_FINITE;
}
#endif

#if GS_TIME_DEPENDENT && GS_CONSTRAINED
/* sum b~_l Lambda_l.g_t(Q~_l, t_l): the mean power of rheonomic constraints over the step. */
static real node_power(work_t *w, real dt, const real q[N], const real p[N], const real x[U])
{
    real q1[N], p1[N], multipliers[ROOM], rate[M], sum = 0;
    if (finish(w, dt, q, p, x, q1, p1, multipliers) != OK)
        return NAN;
    for (int l = 0; l <= P; ++l) {
        constraint_rate(AT(&w->constants, w->t + w->node_time[l]), w->Q_tilde[l], rate);
        for (int mu = 0; mu < M; ++mu)
            sum += tableau.b_tilde[l]*multipliers[l*M + mu]*rate[mu];
    }
    return sum;
}
#endif

#if GS_FORCES
#if GS_VELOCITY_CONSTRAINTS
/* M_i.a(Q_i): the power of the reactions at the stage i, since A q' = -a */
static real reaction_power(const constants *c, const real q[N], const real mu[ROWS])
{
    const real still[N] = { 0 };
    real rest[HIDDEN], sum = 0;
    velocity_defect(c, q, still, rest);
    for (int nu = 0; nu < ROWS; ++nu)
        sum += mu[nu]*rest[M + nu];
    return sum;
}
#endif

#if GS_CLOCK
/* Work of the forces and of explicit time dependence: the decrease of the momentum of t. */
static real step_work(work_t *w, real dt, const real q[N], const real p[N], const real x[U])
{
    real q1[N], p1[N], multipliers[ROOM];
    return finish(w, dt, q, p, x, q1, p1, multipliers) == OK ? p[N - 1] - p1[N - 1] : NAN;
}
#else
/* Work of the forces, dt sum b_i F(Q_i, P_i, t_i).k_i, accurate to the order of the method. */
static real step_work(work_t *w, real dt, const real q[N], const real p[N], const real x[U])
{
    real sum = 0;
    stage_values(w, dt, q, p, x);
    for (int i = 0; i < S; ++i) {
        real F[N], power = 0;
        IF_FRAME_WORK(real v[N];)
        const real t = w->t + dt*tableau.c[i];
        applied_force(AT(&w->constants, t), w->stage_q[i], w->stage_p[i], &t, F);
        for (int a = 0; a < N; ++a)
            power += F[a]*x[i*N + a];
        IF_FRAME_WORK(frame_velocity(&w->constants, w->stage_q[i], v);)
        IF_FRAME_WORK(for (int a = 0; a < N; ++a))
            IF_FRAME_WORK(power += F[a]*v[a];)
        IF_TIME(power += energy_rate(&w->constants, w->stage_q[i], w->stage_p[i]);)
#if GS_VELOCITY_CONSTRAINTS
        power += reaction_power(&w->constants, w->stage_q[i], x + REACTIONS + i*ROWS);
#endif
        sum += tableau.b[i]*power;
    }
    IF_TIME(IF_CONSTRAINED(sum += node_power(w, dt, q, p, x);))
    return dt*sum;
}
#endif
#endif

#endif
