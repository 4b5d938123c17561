/* Maximum norm, and random perturbations of the size of round-off. */
#ifndef GS_LINEAR_ALGEBRA_NORMS_H
#define GS_LINEAR_ALGEBRA_NORMS_H

#include "gyrospark/engine.h"

#if !GS_PROFILE_CONTROL
/* The larger number; b if a or b is NaN */
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

/*
 * Coordinates that measure a state and its changes: all but the time of a system in scaled time. t
 * grows, and -H contains any constant: relative to them every change would become small.
 */
#if GS_CLOCK
enum { MEASURED = N - 1 };
#else
enum { MEASURED = N };
#endif

#if !GS_PROFILE_CONTROL && !GS_SPLITTING
/* The maximum norm of `rows` rows of N numbers, without the time; NaN if any number is NaN. */
static real state_norm(int rows, const real *x)
{
#if GS_CLOCK
    real size = 0;
    for (int i = 0; i < rows; ++i) {
        const real of_row = norm(MEASURED, x + i*N);
        if (!(of_row <= size))
            size = of_row;
        if (isnan(size))
            break;
    }
    return size;
#else
    return norm(rows*N, x);
#endif
}
#endif

#if !GS_PROFILE_CONTROL && !GS_SPLITTING
/* A relative perturbation of +-2 ulp, with pseudo-random sign, to estimate round-off errors. */
static real perturbation(unsigned *seed)
{
    *seed = *seed*1664525u + 1013904223u;
    return *seed >> 31 ? 2*epsilon : -2*epsilon;
}
#endif

#endif
