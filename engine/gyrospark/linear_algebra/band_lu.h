/* Banded LU factorisation with partial pivoting. */
#ifndef GS_LINEAR_ALGEBRA_BAND_LU_H
#define GS_LINEAR_ALGEBRA_BAND_LU_H

#include "gyrospark/linear_algebra/norms.h"

/*
 * Band storage: row r holds the columns r - BAND .. r + BAND, and BAND more for the fill-in of row
 * exchanges. position[] permutes unknowns and equations alike, to reduce the bandwidth.
 */
enum { WIDTH = 3*BAND + 1 };

/* Address of dr[equation]/dx[unknown]; both indices are in the scheme's order. */
static real *entry(real *J, int equation, int unknown)
{
    const int row = position[equation], column = position[unknown];
    return J + (size_t)row*WIDTH + (size_t)(column - row + BAND);
}

/*
 * LU factorisation in place, with partial pivoting. Row equilibration by powers of two makes the
 * choice of pivots independent of units; it is exact. `products` counts the multiplications, whose
 * number depends on the zeros.
 */
static int band_factorise(real *restrict J, int *restrict exponents, int *restrict pivots,
    long *products)
{
    *products = 0;
    for (int r = 0; r < U; ++r) {
        real *row = J + (size_t)r*WIDTH;
        const real size = norm(2*BAND + 1, row);
        if (!isfinite(size))
            return NOT_FINITE;
        if (!(size > 0))
            return SINGULAR;
        (void)MATH(frexp)(size, &exponents[r]);
        const real scale = MATH(ldexp)(1, -exponents[r]);
        for (int e = 0; e <= 2*BAND; ++e)
            row[e] *= scale;
        for (int e = 2*BAND + 1; e < WIDTH; ++e)
            row[e] = 0;
    }
    for (int k = 0; k < U; ++k) {
        const int below = k + BAND < U ? k + BAND : U - 1;
        const int right = k + 2*BAND < U ? 2*BAND : U - 1 - k;
        real *upper = J + (size_t)k*WIDTH + BAND; /* row k from column k on */
        int pivot = k;
        real largest = MATH(fabs)(upper[0]);
        for (int i = k + 1; i <= below; ++i) {
            const real size = MATH(fabs)(J[(size_t)i*WIDTH + (size_t)(BAND + k - i)]);
            if (size > largest) {
                largest = size;
                pivot = i;
            }
        }
        pivots[k] = pivot;
        if (!(largest > 0))
            return isfinite(largest) ? SINGULAR : NOT_FINITE;
        if (pivot != k) {
            real *lower = J + (size_t)pivot*WIDTH + (size_t)(BAND + k - pivot);
            for (int e = 0; e <= right; ++e) {
                const real swap = upper[e];
                upper[e] = lower[e];
                lower[e] = swap;
            }
        }
        int width = right;
        while (width > 0 && upper[width] == 0)
            --width;
        for (int i = k + 1; i <= below; ++i) {
            real *lower = J + (size_t)i*WIDTH + (size_t)(BAND + k - i);
            if (lower[0] == 0)
                continue;
            const real factor = lower[0]/upper[0];
            lower[0] = factor;
            *products += width;
            for (int e = 1; e <= width; ++e)
                lower[e] -= factor*upper[e];
        }
    }
    return OK;
}

/* b <- J^-1 b from the factors; b is in the scheme's order, `forward` is work space. */
static int band_substitute(const real *restrict J, const int *restrict exponents,
    const int *restrict pivots, real *restrict b, real *restrict forward)
{
    for (int e = 0; e < U; ++e) {
        if (!isfinite(b[e]))
            return NOT_FINITE;
        forward[position[e]] = MATH(ldexp)(b[e], -exponents[position[e]]);
    }
    for (int k = 0; k < U; ++k) {
        const int below = k + BAND < U ? k + BAND : U - 1;
        const real value = forward[pivots[k]];
        forward[pivots[k]] = forward[k];
        forward[k] = value;
        for (int i = k + 1; i <= below; ++i)
            forward[i] -= J[(size_t)i*WIDTH + (size_t)(BAND + k - i)]*value;
    }
    for (int k = U - 1; k >= 0; --k) {
        const int right = k + 2*BAND < U ? 2*BAND : U - 1 - k;
        const real *upper = J + (size_t)k*WIDTH + BAND;
        real sum = forward[k];
        for (int e = 1; e <= right; ++e)
            sum -= upper[e]*forward[k + e];
        forward[k] = sum/upper[0];
    }
    for (int e = 0; e < U; ++e)
        b[e] = forward[position[e]];
    return OK;
}

/* Copies the band matrix to dense row-major storage, in the scheme's order. */
static void band_spread(const real *J, real *dense)
{
    for (size_t i = 0; i < U; ++i)
        for (size_t j = 0; j < U; ++j) {
            const int offset = position[j] - position[i];
            dense[i*U + j] = offset < -BAND || offset > BAND ? 0
                : J[(size_t)position[i]*WIDTH + (size_t)(offset + BAND)];
        }
}

#endif
