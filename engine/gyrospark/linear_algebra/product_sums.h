/* Sums of products in twice the working precision. */
#ifndef GS_LINEAR_ALGEBRA_PRODUCT_SUMS_H
#define GS_LINEAR_ALGEBRA_PRODUCT_SUMS_H

#include "gyrospark/engine.h"

/* A rounded value: volatile keeps the compiler from contracting its product into a sum. */
static real rounded(volatile real value)
{
    return value;
}

/* sum += the product of the factors, in twice the working precision (two-product, two-sum). */
static void add_product(real sum[2], int count, const real *factors)
{
    real high = factors[0], low = 0;
    for (int i = 1; i < count; ++i) {
        const real product = rounded(high*factors[i]);
        low = low*factors[i] + MATH(fma)(high, factors[i], -product);
        high = product;
    }
    const real total = sum[0] + high, part = total - sum[0];
    sum[1] += low + ((sum[0] - (total - part)) + (high - part));
    sum[0] = total;
}

#endif
