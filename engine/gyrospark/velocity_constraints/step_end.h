/* The end of a step with velocity constraints: T1 has found all multipliers. */
#ifndef GS_VELOCITY_CONSTRAINTS_STEP_END_H
#define GS_VELOCITY_CONSTRAINTS_STEP_END_H

#include "gyrospark/spark/residual.h"

/*
 * q1 = Q~_P, p1 = P~_P and the multipliers Lambda_0..Lambda_P, M_1..M_S. P~_P satisfies all conditions
 * on momenta but for the error of Newton's method, which a projection removes.
 */
static int finish(work_t *w, real dt, const real q[N], const real p[N], const real x[U],
    real q1[N], real p1[N], real multipliers[ROOM])
{
    real Q[N], momentum[N];
    stage_values(w, dt, q, p, x);
    node_state(w, dt, q, p, x, P, Q, momentum);
    for (int a = 0; a < N; ++a) {
        q1[a] = Q[a];
        p1[a] = momentum[a];
    }
    for (int l = 0; l < MULTIPLIERS; ++l)
        multipliers[l] = x[FIRST_LAMBDA + l];
    const int status = project_momentum(AT(&w->constants, w->t + w->step), q1, p1);
    return status != OK || isfinite(norm(N, q1) + norm(N, p1)) ? status : NOT_FINITE;
}

#if GS_FORCES
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

#endif
