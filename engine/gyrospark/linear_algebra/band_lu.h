/* Banded LU factorisation with threshold pivoting. */
#ifndef GS_LINEAR_ALGEBRA_BAND_LU_H
#define GS_LINEAR_ALGEBRA_BAND_LU_H

#include "gyrospark/linear_algebra/norms.h"

/*
 * Band storage: row r holds the columns r - band .. r + band, and `band` more for the fill-in of
 * row exchanges. The factors L follow all rows, `band` numbers a column, so that every inner loop
 * but the choice of a pivot runs along memory. position[] permutes unknowns and equations alike, to
 * reduce the bandwidth.
 */
enum { WIDTH = 4*BAND + 1 }; /* and the L of a row */

/* Row r, indexed by columns. */
static inline real *band_row(real *J, int band, int r)
{
    return J + (size_t)r*(size_t)(3*band + 1) + band - r;
}

/* Column k of L, indexed by rows. */
static inline real *band_lower(real *J, int count, int band, int k)
{
    return J + (size_t)count*(size_t)(3*band + 1) + (size_t)k*(size_t)band - k - 1;
}

/* Address of dr[equation]/dx[unknown]; both indices are in the scheme's order. */
static inline real *entry(real *J, int equation, int unknown)
{
    return band_row(J, BAND, position[equation]) + position[unknown];
}

/* Sum of x[i] y[i], |x[i]| if y is NULL, in eight partial sums, which compilers vectorise. */
static inline real sum_products(int count, const real *restrict x, const real *restrict y)
{
    real sums[8] = { 0 }, rest = 0;
    int i = 0;
    for (; i + 8 <= count; i += 8)
        for (int e = 0; e < 8; ++e)
            sums[e] += y ? x[i + e]*y[i + e] : MATH(fabs)(x[i + e]);
    for (; i < count; ++i)
        rest += y ? x[i]*y[i] : MATH(fabs)(x[i]);
    return (((sums[0] + sums[1]) + (sums[2] + sums[3]))
        + ((sums[4] + sums[5]) + (sums[6] + sums[7]))) + rest;
}

/*
 * LU factorisation in place; entries beyond the band need no value. Candidates for pivots are
 * compared relative to the norms of their rows at the start, so that units do not matter. Threshold
 * pivoting (Duff, Erisman and Reid) exchanges rows only if another entry is ten times the diagonal
 * one: exchanges fill the band. `pivots` has three parts: the row exchanged with each row, the last
 * column of each row of U, the last row of each column of L. `products` counts the multiplications,
 * whose number depends on the zeros; `scales` and `rows` are work space.
 */
static inline int band_factorise(int count, int band, real *restrict J, int *restrict pivots,
    real *restrict scales, int *restrict rows, long *products)
{
    const real threshold = (real)0.1;
    int *const last_column = pivots + count, *const last_row = last_column + count;
    *products = 0;
    for (int r = 0; r < count; ++r)
        last_row[r] = 0;
    for (int r = 0; r < count; ++r) {
        const real *row = band_row(J, band, r);
        int first = r > band ? r - band : 0, last = r + band < count ? r + band : count - 1;
        while (first < last && row[first] == 0)
            ++first;
        while (last > first && row[last] == 0)
            --last;
        const real size = sum_products(last - first + 1, row + first, NULL);
        if (!isfinite(size))
            return NOT_FINITE;
        if (!(size > 0))
            return SINGULAR;
        scales[r] = 1/size;
        last_column[r] = last;
        last_row[first] = r;
    }
    for (int k = 0; k < count; ++k) {
        real *restrict upper = band_row(J, band, k), *restrict lower = band_lower(J, count, band, k);
        const real diagonal = MATH(fabs)(upper[k])*scales[k];
        real largest = diagonal;
        int pivot = k, nonzero = 0;
        if (k > 0 && last_row[k] < last_row[k - 1])
            last_row[k] = last_row[k - 1];
        for (int i = k + 1; i <= last_row[k]; ++i) {
            lower[i] = 0;
            rows[nonzero] = i;
            nonzero += band_row(J, band, i)[k] != 0;
        }
        for (int e = 0; e < nonzero; ++e) {
            const real size = MATH(fabs)(band_row(J, band, rows[e])[k])*scales[rows[e]];
            pivot = size > largest ? rows[e] : pivot;
            largest = size > largest ? size : largest;
        }
        if (!(largest > 0))
            return isfinite(largest) ? SINGULAR : NOT_FINITE;
        if (diagonal >= threshold*largest)
            pivot = k;
        pivots[k] = pivot;
        if (pivot != k) {
            real *other = band_row(J, band, pivot);
            const int last = last_column[pivot];
            for (int j = k; j <= last || j <= last_column[k]; ++j) {
                const real swap = upper[j];
                upper[j] = other[j];
                other[j] = swap;
            }
            last_column[pivot] = last_column[k];
            last_column[k] = last;
            scales[pivot] = scales[k];
        }
        const real inverse = 1/upper[k];
        const int last = last_column[k];
        for (int e = 0; e < nonzero; ++e) {
            real *restrict row = band_row(J, band, rows[e]);
            const real factor = lower[rows[e]] = row[k]*inverse;
            if (factor == 0)
                continue;
            while (last_column[rows[e]] < last)
                row[++last_column[rows[e]]] = 0;
            *products += last - k;
            for (int j = k + 1; j <= last; ++j)
                row[j] -= factor*upper[j];
        }
    }
    return OK;
}

/* x <- J^-1 x from the factors, in the order of the band */
static inline int band_substitute(int count, int band, const real *J, const int *restrict pivots,
    real *restrict x)
{
    const int *last_column = pivots + count, *last_row = last_column + count;
    for (int k = 0; k < count; ++k) {
        const real *restrict lower = band_lower((real *)J, count, band, k);
        const real value = x[pivots[k]];
        if (!isfinite(value))
            return NOT_FINITE;
        x[pivots[k]] = x[k];
        x[k] = value;
        for (int i = k + 1; i <= last_row[k]; ++i)
            x[i] -= lower[i]*value;
    }
    for (int k = count - 1; k >= 0; --k) {
        const real *upper = band_row((real *)J, band, k) + k;
        x[k] = (x[k] - sum_products(last_column[k] - k, upper + 1, x + k + 1))/upper[0];
    }
    return OK;
}

/* b <- J^-1 b from the factors; b is in the scheme's order, `forward` is work space. */
static int band_solve(const real *J, const int *pivots, real *restrict b, real *restrict forward)
{
    for (int e = 0; e < U; ++e)
        forward[position[e]] = b[e];
    const int status = band_substitute(U, BAND, J, pivots, forward);
    for (int e = 0; e < U; ++e)
        b[e] = forward[position[e]];
    return status;
}

/* Copies the band matrix to dense row-major storage, in the scheme's order. */
static void band_spread(const real *J, real *dense)
{
    for (size_t i = 0; i < U; ++i)
        for (size_t j = 0; j < U; ++j) {
            const int offset = position[j] - position[i];
            dense[i*U + j] = offset < -BAND || offset > BAND ? 0 : *entry((real *)J, (int)i, (int)j);
        }
}

#endif
