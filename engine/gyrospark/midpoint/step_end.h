/* Implicit midpoint (IMS) and energy-momentum (EMS) schemes: end and work of a step. */
#ifndef GS_MIDPOINT_STEP_END_H
#define GS_MIDPOINT_STEP_END_H

#include "gyrospark/midpoint/residual.h"

/* T2: q1 = q + dq, p1 = p + dp. */
static int finish(work_t *w, real dt, const real q[N], const real p[N], const real x[U],
    real q1[N], real p1[N], real multipliers[ROOM])
{
    (void)w, (void)dt;
    IF_CLOCK(if (!(x[N - 1]*dt > 0))
        return TIME_STOPPED;)
    for (int a = 0; a < N; ++a) {
        q1[a] = q[a] + x[a];
        p1[a] = p[a] + x[DP + a];
    }
    (void)multipliers; /* without constraints */
    for (int mu = 0; mu < M; ++mu)
        multipliers[mu] = x[2*N + mu];
    return isfinite(norm(N, q1) + norm(N, p1)) ? OK : NOT_FINITE;
}

#if GS_TIME_DEPENDENT && GS_CONSTRAINED
/* lambda.g_t: the power of rheonomic constraints, with the mean g_t of both ends */
static real constraint_power(work_t *w, const real x[U])
{
    real rate[M], sum = 0;
    mean_constraint_rate(&w->constants, w->q_mean, x, rate);
    for (int mu = 0; mu < M; ++mu)
        sum += x[2*N + mu]*rate[mu];
    return sum;
}
#endif

#if GS_FORCES
#if GS_CLOCK
/* Work of the forces and of explicit time dependence: the decrease of the momentum of t. */
static real step_work(work_t *w, real dt, const real q[N], const real p[N], const real x[U])
{
    (void)w, (void)dt, (void)q;
    return p[N - 1] - (p[N - 1] + x[DP + N - 1]);
}
#else
/*
 * Work of the forces, F.dq; EMS takes F at the mean velocity. With a discrete gradient, H1 - H0
 * equals it exactly.
 */
static real step_work(work_t *w, real dt, const real q[N], const real p[N], const real x[U])
{
    real F[N], sum = 0;
    IF_FRAME_WORK(real v[N];)
    const real t = w->t + dt/2;
    mean_values(w, q, p, x);
#if GS_ENERGY_MOMENTUM
    real mean_velocity[N];
    for (int a = 0; a < N; ++a)
        mean_velocity[a] = x[a]/dt;
    force_of_velocity(BETWEEN(&w->constants, w->t, w->step), w->q_mean, mean_velocity, &t, F);
#else
    applied_force(BETWEEN(&w->constants, w->t, w->step), w->q_mean, w->p_mean, &t, F);
#endif
    for (int a = 0; a < N; ++a)
        sum += F[a]*x[a];
    IF_FRAME_WORK(frame_velocity(&w->constants, w->q_mean, v);)
    IF_FRAME_WORK(for (int a = 0; a < N; ++a))
        IF_FRAME_WORK(sum += dt*F[a]*v[a];)
    IF_TIME(sum += w->step*mean_energy_rate(&w->constants, w->q_mean, w->p_mean, x, x + DP);)
    IF_TIME(IF_CONSTRAINED(sum += w->step*constraint_power(w, x);))
    return sum;
}
#endif
#endif

#endif
