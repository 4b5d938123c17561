/* Profile control: checks of arguments, and the time of a state. */
#ifndef GS_PROFILES_ARGUMENTS_H
#define GS_PROFILES_ARGUMENTS_H

#include "gyrospark/engine.h"
#if GS_SHORT_REAL
#include "gyrospark/linear_algebra/product_sums.h"
#endif

/* In the memory of a trajectory that was begun, in place of the 0 of memory of zeros. */
#define GS_BEGUN 0x6E756762U

/* Whether all numbers are finite */
static bool are_finite(int count, const real *x)
{
    bool finite = true;
    for (int a = 0; a < count; ++a) {
        finite = finite && (MATH(fabs)(x[a]) <= LIMIT(MAX));
    }
    return finite;
}

/*
 * Whether q is finite and its quaternions have a length: |q|^2 is below the largest number, and so
 * far above the smallest that squares that underflow are lost beside it.
 */
static bool is_position(const real q[N])
{
    bool valid = are_finite(N, q);
    for (int b = 0; b < QUATERNIONS; ++b) {
        real square = (real)0;
        for (int e = 0; e < 4; ++e) {
            const real x = q[quaternion[b][e]];
            square += x*x;
        }
        valid = valid && (square >= (LIMIT(MIN)/epsilon)) && (square <= LIMIT(MAX));
    }
    return valid;
}

/* Whether a trajectory can be at (q, p). */
static bool is_state(const real q[N], const real p[N])
{
    return is_position(q) && are_finite(N, p);
}

/* Whether h and 1/h are finite numbers. */
static bool is_step(real h)
{
    const real numbers[2] = { h, (real)1/h };
    return are_finite(2, numbers);
}

/* Whether an iteration can obey these options */
static bool is_option(const options_t *options)
{
    return (options->max_iterations > 0) && (options->tolerance >= (real)0);
}

#if GS_SHORT_REAL
/*
 * start + n h, rounded once although the type has fewer digits than n: n is cut into parts of 22
 * bits, and their products with h are summed in twice the precision.
 */
static real time_after(real start, int64_t n, real h)
{
    const uint64_t count = (uint64_t)n;
    /* 2^44 */
    real sum[2] = { start, 0 };
    real unit = (real)17592186044416;
    for (unsigned shift = 44U; shift <= 44U; shift -= 22U) {
        const uint32_t part = (uint32_t)(count >> shift) & 0x3FFFFFU;
        const real factors[2] = { (real)part*unit, h };
        add_product(sum, 2, factors);
        unit /= (real)4194304; /* 2^22 */
    }
    return sum[0] + sum[1];
}
#else
/* start + n h, as in profiles run and full */
static real time_after(real start, int64_t n, real h)
{
    return start + ((real)n*h);
}
#endif

#endif
