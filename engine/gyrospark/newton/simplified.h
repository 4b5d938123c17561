/* Simplified Newton method for T1, from a predicted starting value. */
#ifndef GS_NEWTON_SIMPLIFIED_H
#define GS_NEWTON_SIMPLIFIED_H

#include "gyrospark/newton/newton.h"

/*
 * Simplified Newton method from the guess in x (Hairer-Wanner II, IV.8): the factorisation at the
 * guess is reused, and renewed if the contraction is slower than 0.1. It gives up early, because
 * the caller falls back to full Newton from the Euler start, which selects the root of the step.
 */
static int simplified_newton(work_t *w, const options_t *options, real dt, const real q[N],
    const real p[N], real x[U], int *iterations)
{
    const real radius = (real)0.02, slow = (real)0.1;
    real previous = 0;
#if GS_VELOCITY_CONSTRAINTS
    int stale = !w->has_factors; /* of an earlier step */
#else
    int stale = 1;
#endif
    *iterations = 0;
    while (*iterations < options->max_iterations) {
        residual(w, dt, q, p, x, w->r);
        int status = OK;
        if (stale) {
            status = factorise_jacobian(w, dt, q, p, x);
            w->effort += JACOBIAN_COST + w->products/2;
        }
        if (status == OK)
            status = solve_jacobian(w, dt, w->r);
        if (status != OK)
            return status;
        ++*iterations;
        w->effort += RESIDUAL_COST;
        const real size = increment_size(w, dt, q, p, x, w->r);
        if (!(size < radius)) /* a distant prediction may converge to another root */
            return NOT_CONVERGED;
        for (int e = 0; e < U; ++e)
            x[e] -= w->r[e];
        if (size <= options->tolerance)
            return satisfies_constraints(w, dt, q, x);
        const real ratio = *iterations > 1 ? size/previous : 1;
        if (*iterations > 1 && ratio >= (real)0.5 && is_round_off(w, dt, q, p, size))
            return satisfies_constraints(w, dt, q, x);
        if (*iterations > 1 && !(options->tolerance > 0) && ratio < (real)0.5
            && size*ratio < epsilon/64)
            return satisfies_constraints(w, dt, q, x);
        if (*iterations > 2 && ratio > 1)
            return NOT_CONVERGED;
        stale = *iterations > 1 && ratio > slow && size > 64*epsilon; /* not for round-off */
        previous = size;
    }
    return NOT_CONVERGED;
}

#endif
