/* Sums of products in twice the working precision. */
#ifndef GS_LINEAR_ALGEBRA_PRODUCT_SUMS_H
#define GS_LINEAR_ALGEBRA_PRODUCT_SUMS_H

#include "gyrospark/engine.h"

/*
 * Rounds a product: volatile prevents its contraction into a fused multiply-add. Where the compiler
 * has an option for that, define ROUNDED(x) as (x): on a graphics card volatile numbers are stored.
 */
#ifndef ROUNDED
static real rounded(volatile real value)
{
    return value;
}
#define ROUNDED(value) rounded(value)
#endif

/* sum += prod_i factors[i] in twice the working precision, by two-product and two-sum. */
static void add_product(real sum[2], int count, const real *factors)
{
    real high = factors[0];
    real low = (real)0;
    for (int i = 1; i < count; ++i) {
        const real product = ROUNDED(high*factors[i]);
        low = (low*factors[i]) + MATH(fma)(high, factors[i], -product);
        high = product;
    }
    const real total = sum[0] + high;
    const real part = total - sum[0];
    sum[1] += low + ((sum[0] - (total - part)) + (high - part));
    sum[0] = total;
}

#endif
