/* Maximum norm, and random perturbations of the size of round-off. */
#ifndef GS_LINEAR_ALGEBRA_NORMS_H
#define GS_LINEAR_ALGEBRA_NORMS_H

#include "gyrospark/engine.h"

#if !GS_PROFILE_CONTROL
static real larger(real a, real b)
{
    return a > b ? a : b;
}
#endif

/* max |x_i|; NaN if any x_i is NaN */
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

#if !GS_PROFILE_CONTROL && !(GS_SPLITTING && GS_PROFILE_RUN)
/* A relative perturbation of +-2 ulp, with pseudo-random sign, to estimate round-off errors. */
static real perturbation(unsigned *seed)
{
    *seed = *seed*1664525u + 1013904223u;
    return *seed >> 31 ? 2*epsilon : -2*epsilon;
}
#endif

#endif
