/* Profiles control and run: the unknowns of a step beside those of the iteration. */
#ifndef GS_PROFILES_UNKNOWNS_H
#define GS_PROFILES_UNKNOWNS_H

#include "gyrospark/profiles/solve.h"

#if GS_FORCES || GS_DERIVATIVES
#if GS_SPARK
#include "gyrospark/spark/unknowns.h"

/* Unknown e of (B.2): its place among the scaled unknowns, and the factor there. */
static real scale_of(const state_t *w, int e, int *place)
{
    *place = e;
#if GS_CONSTRAINED
    if (e >= LAMBDA) {
        const int l = (e - LAMBDA)/M;
        const int node = l == 0 ? P - 1 : l - 1;
        *place = IMPULSE + node*M + (e - LAMBDA) % M;
        return w->h*tableau.b_tilde[l];
    }
#endif
    return w->h*(e < K_HAT ? weights[e/N] : weights_hat[(e - K_HAT)/N]);
}
#else
/* Unknown e: its place in the iteration, and the factor there: impulses are h lambda. */
static real scale_of(const state_t *w, int e, int *place)
{
    *place = e;
    return e < IMPULSE ? 1 : w->h;
}
#endif

/* The unknowns x of a step from those of the iteration. */
static void get_unknowns(const state_t *w, const real scaled[X], real x[U])
{
    for (int e = 0; e < U; ++e) {
        int place;
        const real scale = scale_of(w, e, &place);
        x[e] = scaled[place]/scale;
    }
}
#endif

#endif
