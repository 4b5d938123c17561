/* Contribution of a constraint force to the banded Jacobian of T1. */
#ifndef GS_SPARK_BAND_JACOBIAN_H
#define GS_SPARK_BAND_JACOBIAN_H

#include "gyrospark/linear_algebra/band_lu.h"

/*
 * Adds dr/dP dP/dx for one unknown x, with dP/dx = factor*change[e] at the momenta places[e].
 * `upper` and `lower` are the first rows of k_i and k^_i.
 */
static void add_reaction(real *J, int upper, int lower, int unknown, int count, const int *places,
    const real *change, real factor, const real *H_pp, const real *H_qp)
{
    for (int e = 0; e < count; ++e) {
        const real amount = factor*change[e];
        if (amount == 0)
            continue;
        const int at = places[e];
        for (int a = 0; a < cell_count[at]; ++a)
            *entry(J, upper + cell_row[cell_first[at] + a], unknown) -=
                H_pp[cell_first[at] + a]*amount;
        for (int a = mixed_first[at]; a < mixed_first[at + 1]; ++a)
            *entry(J, lower + mixed_row[a], unknown) += H_qp[a]*amount;
    }
}

#endif
