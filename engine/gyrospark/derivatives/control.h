/* Profile control: the unknowns and the end of a step, for its derivatives. */
#ifndef GS_DERIVATIVES_CONTROL_H
#define GS_DERIVATIVES_CONTROL_H

#include "gyrospark/profiles/control.h"
#include "gyrospark/profiles/unknowns.h"

/* T2: the end of the step from (q, p) with the unknowns x. */
static int finish(work_t *w, real dt, const real q[N], const real p[N], const real x[U],
    real q1[N], real p1[N], real multipliers[ROOM])
{
    real q_low[N], p_low[N], size = 0;
    (void)multipliers;
    w->h = dt;
    w->h_inverse = 1/dt;
    for (int a = 0; a < N; ++a) {
        w->q[a] = q[a];
        w->p[a] = p[a];
        w->q_low[a] = w->p_low[a] = 0;
    }
    for (int e = 0; e < U; ++e) {
        int place;
        const real scale = scale_of(w, e, &place);
        w->x[place] = scale*x[e];
    }
    begin_iteration(w); /* the constraint forces */
    end_of_step(w, q1, p1, q_low, p_low);
    for (int a = 0; a < N; ++a)
        size += q1[a] + p1[a];
    return isfinite(size) ? OK : NOT_FINITE;
}

#endif
