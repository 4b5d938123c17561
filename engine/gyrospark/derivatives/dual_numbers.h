/*
 * Dual numbers: a value with its derivative along a direction, the slope.
 *
 * A dual number is a complex one whose imaginary part is the slope times SLOPE_UNIT, which is so
 * small that products of two slopes vanish beside values: the operators of C are those of dual
 * numbers. Functions are not the complex ones: each is f(a) + f'(a) b.
 */
#ifndef GS_DERIVATIVES_DUAL_NUMBERS_H
#define GS_DERIVATIVES_DUAL_NUMBERS_H

#if !GS_SPLITTING
#include "gyrospark/derivatives/lu.h"

typedef pivots_t dual_pivots_t;
#endif

/* 2^(two fifths of the least exponent): neither squares nor slopes of results leave the range. */
static inline real slope_unit(void)
{
    return MATH(ldexp)(1, LIMIT(MIN_EXP)/5*2);
}

/* A dual number from its value and its slope times SLOPE_UNIT */
static inline dual make_dual(real value, real scaled_slope)
{
    dual z;
    ((real *)&z)[0] = value;
    ((real *)&z)[1] = scaled_slope;
    return z;
}

static inline real value_of(dual z)
{
    return ((const real *)&z)[0];
}

/* The slope times SLOPE_UNIT */
static inline real scaled_slope_of(dual z)
{
    return ((const real *)&z)[1];
}

/* A number, whose slope is 0 */
static inline dual dual_broadcast(real x)
{
    return make_dual(x, 0);
}

#if GS_SPLITTING
static inline void dual_sine_cosine(dual x, dual *sine, dual *cosine)
{
    const real slope = scaled_slope_of(x);
    real s, c;
    sine_cosine(value_of(x), &s, &c);
    *sine = make_dual(s, c*slope);
    *cosine = make_dual(c, -s*slope);
}
#else
/* Values <- the LU factors of values; slopes stay those of the matrix. */
static int dual_factorise_matrix(int n, dual *A, pivots_t *pivots)
{
    real factors[U*U];
    for (int e = 0; e < n*n; ++e)
        factors[e] = value_of(A[e]);
    const int status = factorise_matrix(n, factors, pivots);
    for (int e = 0; e < n*n; ++e)
        A[e] = make_dual(factors[e], scaled_slope_of(A[e]));
    return status;
}

/* A x = b has A x' = b' - A' x: the same factors twice. */
static inline void dual_solve(int n, const dual *A, const pivots_t *pivots, int transposed,
    dual *b)
{
    real factors[U*U], value[U], slope[U];
    void (*const substitute_in)(int, const real *, const pivots_t *, real *)
        = transposed ? solve_transposed_with : solve_with;
    for (int e = 0; e < n*n; ++e)
        factors[e] = value_of(A[e]);
    for (int i = 0; i < n; ++i) {
        value[i] = value_of(b[i]);
        slope[i] = scaled_slope_of(b[i]);
    }
    substitute_in(n, factors, pivots, value);
    for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j)
            slope[i] -= scaled_slope_of(A[transposed ? j*n + i : i*n + j])*value[j];
    substitute_in(n, factors, pivots, slope);
    for (int i = 0; i < n; ++i)
        b[i] = make_dual(value[i], slope[i]);
}

/* b <- A^-1 b, b <- A^-T b */
static inline void dual_solve_with(int n, const dual *A, const pivots_t *pivots, dual *b)
{
    dual_solve(n, A, pivots, 0, b);
}

static inline void dual_solve_transposed_with(int n, const dual *A, const pivots_t *pivots,
    dual *b)
{
    dual_solve(n, A, pivots, 1, b);
}
#endif

#endif
