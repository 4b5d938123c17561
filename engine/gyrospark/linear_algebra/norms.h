/* Norms, and perturbations of the size of round-off. */
#ifndef GS_LINEAR_ALGEBRA_NORMS_H
#define GS_LINEAR_ALGEBRA_NORMS_H

#include "gyrospark/engine.h"

static real larger(real a, real b)
{
    return a > b ? a : b;
}

/* max |x_i|; NaN if there is one */
static real norm(int n, const real *x)
{
    real size = 0;
    for (int i = 0; i < n; ++i) {
        const real a = MATH(fabs)(x[i]);
        if (isnan(a))
            return a;
        if (a > size)
            size = a;
    }
    return size;
}

/* Two units in the last place of 1, up or down by chance: to see what rounding is worth. */
static real perturbation(unsigned *chance)
{
    *chance = *chance*1664525u + 1013904223u;
    return *chance >> 31 ? 2*epsilon : -2*epsilon;
}

#endif
