/* Dense LU factorisation with partial pivoting. */
#ifndef GS_LINEAR_ALGEBRA_DENSE_LU_H
#define GS_LINEAR_ALGEBRA_DENSE_LU_H

#include "gyrospark/linear_algebra/norms.h"

/*
 * A = P L U in place, with partial pivoting. Row equilibration by powers of two makes the choice of
 * pivots independent of units; it is exact. `products` counts the multiplications, whose number
 * depends on the zeros.
 */
static int lu_factorise(int n, real *restrict A, int *restrict exponents, int *restrict pivots,
    long *products)
{
    *products = 0;
    for (int i = 0; i < n; ++i) {
        const real size = norm(n, A + i*n);
        if (!isfinite(size))
            return NOT_FINITE;
        if (!(size > 0))
            return SINGULAR;
        (void)MATH(frexp)(size, &exponents[i]);
        const real scale = MATH(ldexp)(1, -exponents[i]);
        for (int j = 0; j < n; ++j)
            A[i*n + j] *= scale;
    }
    for (int k = 0; k < n; ++k) {
        int pivot = k;
        for (int i = k + 1; i < n; ++i)
            if (MATH(fabs)(A[i*n + k]) > MATH(fabs)(A[pivot*n + k]))
                pivot = i;
        pivots[k] = pivot;
        if (!(MATH(fabs)(A[pivot*n + k]) > 0))
            return isfinite(A[pivot*n + k]) ? SINGULAR : NOT_FINITE;
        for (int j = 0; j < n && pivot != k; ++j) {
            const real swap = A[k*n + j];
            A[k*n + j] = A[pivot*n + j];
            A[pivot*n + j] = swap;
        }
        for (int i = k + 1; i < n; ++i) {
            const real factor = A[i*n + k]/A[k*n + k]; /* a quotient: equal rows cancel exactly */
            A[i*n + k] = factor;
            if (factor == 0) /* most rows: few entries couple the stages */
                continue;
            *products += n - k;
            for (int j = k + 1; j < n; ++j)
                A[i*n + j] -= factor*A[k*n + j];
        }
    }
    return OK;
}

/* b <- A^-1 b from the factors of A. */
static int lu_substitute(int n, const real *restrict A, const int *restrict exponents,
    const int *restrict pivots, real *restrict b)
{
    for (int i = 0; i < n; ++i) {
        if (!isfinite(b[i]))
            return NOT_FINITE;
        b[i] = MATH(ldexp)(b[i], -exponents[i]);
    }
    for (int k = 0; k < n; ++k) {
        const real value = b[pivots[k]];
        b[pivots[k]] = b[k];
        b[k] = value;
    }
    for (int i = 1; i < n; ++i) {
        real sum = b[i];
        for (int j = 0; j < i; ++j)
            sum -= A[i*n + j]*b[j];
        b[i] = sum;
    }
    for (int i = n - 1; i >= 0; --i) {
        real sum = b[i];
        for (int j = i + 1; j < n; ++j)
            sum -= A[i*n + j]*b[j];
        b[i] = sum/A[i*n + i];
    }
    return OK;
}

#if (GS_CONSTRAINED && !GS_PROFILE_CONTROL) || GS_VELOCITY_CONSTRAINTS
#if !GS_ELEMENTS || GS_VELOCITY_CONSTRAINTS /* W of element templates is a band matrix */
/* b <- A^-1 b; overwrites A with its factors. */
static int solve(int n, real *restrict A, real *restrict b, int *restrict exponents,
    int *restrict pivots)
{
    long products;
    const int status = lu_factorise(n, A, exponents, pivots, &products);
    return status == OK ? lu_substitute(n, A, exponents, pivots, b) : status;
}
#endif
#endif

#endif
