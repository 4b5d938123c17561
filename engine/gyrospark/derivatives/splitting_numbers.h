/* Derivatives of one step of a composition of flows. */
#ifndef GS_DERIVATIVES_SPLITTING_NUMBERS_H
#define GS_DERIVATIVES_SPLITTING_NUMBERS_H

#include "gyrospark/derivatives/step_maps.h"

/* A step that was done: nothing was solved, so that neither unknowns nor the end are needed. */
static int linearise(const constants *c, real t, real h, const real *q, const real *p,
    const real *x, const real *q1, const real *p1, linearisation_t *l)
{
    (void)x, (void)q1, (void)p1;
    l->c = c;
    l->s.h = h;
    l->s.t = t;
    prepare_flows(&l->s, c, h);
    l->s.is_symmetric = 0;
    start_of_step(&l->s, q, p);
    take_step(l, p);
    return are_finite(&l->s.now) ? OK : NOT_FINITE;
}

#endif
