/* LU factors of the matrices of derivatives, and solutions with them and their transposes. */
#ifndef GS_DERIVATIVES_LU_H
#define GS_DERIVATIVES_LU_H

#include "gyrospark/linear_algebra/dense_lu.h"

/* Exponents of the row scales, then row exchanges: as many of both as rows. */
typedef int pivots_t;

/* A = P L U in place, with partial pivoting. */
static inline int factorise(int n, real *A, pivots_t *pivots)
{
    long products;
    return lu_factorise(n, A, pivots, pivots + n, &products);
}

/* b <- A^-1 b */
static inline void solve_with(int n, const real *A, const pivots_t *pivots, real *b)
{
    (void)lu_substitute(n, A, pivots, pivots + n, b);
}

/* b <- A^-T b: the transposes of the factors in reverse order, at a stride between entries. */
static inline void substitute_transposed(int n, const real *A, int stride, const int *exponents,
    const int *exchanges, real *b)
{
    for (int i = 0; i < n; ++i) {
        const real value = b[i] /= A[(i*n + i)*stride];
        for (int j = i + 1; j < n; ++j)
            b[j] -= A[(i*n + j)*stride]*value;
    }
    for (int i = n - 1; i > 0; --i)
        for (int j = 0; j < i; ++j)
            b[j] -= A[(i*n + j)*stride]*b[i];
    for (int k = n - 1; k >= 0; --k) {
        const real value = b[exchanges[k]];
        b[exchanges[k]] = b[k];
        b[k] = value;
    }
    for (int i = 0; i < n; ++i)
        b[i] = MATH(ldexp)(b[i], -exponents[i]);
}

static inline void solve_transposed_with(int n, const real *A, const pivots_t *pivots, real *b)
{
    substitute_transposed(n, A, 1, pivots, pivots + n, b);
}

#if GS_DERIVATIVES_IN_LANES
/* Largest growth of a row in an elimination without pivoting; a lane beyond is pivoted. */
#define MAX_GROWTH 1000

/* The same for each lane, and whether this lane was pivoted: in row 0. */
typedef struct {
    int pivoted[LANES], exponent[LANES], exchange[LANES];
} lanes_pivots_t;

/* Pivoted factors of one lane of A, which is the matrix. */
NOINLINE int factorise_lane(int n, const lanes *A, int lane, real *dense, lanes *factors,
    lanes_pivots_t *pivots)
{
    int exponents[U], exchanges[U];
    long products;
    for (int e = 0; e < n*n; ++e)
        dense[e] = lane_get(&A[e], lane);
    const int status = lu_factorise(n, dense, exponents, exchanges, &products);
    for (int e = 0; e < n*n && status == OK; ++e)
        lane_set(&factors[e], lane, dense[e]);
    for (int i = 0; i < n; ++i) {
        pivots[i].exponent[lane] = exponents[i];
        pivots[i].exchange[lane] = exchanges[i];
    }
    pivots[0].pivoted[lane] = 1;
    return status;
}

/*
 * A = L U without pivoting: J is the unit matrix plus O(h), and the Schur complement of the
 * multipliers is regular. The diagonal holds the inverse pivots. A lane in which a row grows by more
 * than MAX_GROWTH is factorised with pivoting.
 */
static int lanes_factorise_growing(int n, lanes *A, lanes_pivots_t *pivots, lanes *copy,
    real *dense)
{
    lanes_mask grown = splat(0) > splat(1);
    for (int e = 0; e < n*n; ++e)
        copy[e] = A[e];
    for (int k = 0; k < n; ++k) {
        const lanes inverse = 1/A[k*n + k];
        for (int i = k + 1; i < n; ++i) {
            lanes *restrict row = A + i*n;
            const lanes *restrict upper = A + k*n, factor = row[k]*inverse;
            row[k] = factor;
            for (int j = k + 1; j < n; ++j)
                row[j] -= factor*upper[j];
        }
        lanes before = splat(0), after = splat(0);
        for (int j = 0; j < n; ++j) {
            before = lanes_larger(before, lanes_larger(copy[k*n + j], -copy[k*n + j]));
            if (j >= k)
                after = lanes_larger(after, lanes_larger(A[k*n + j], -A[k*n + j]));
        }
        grown |= lanes_mask_not(after <= MAX_GROWTH*before);
        A[k*n + k] = inverse;
        for (int j = 0; j < n; ++j)
            grown |= lanes_mask_not(A[k*n + j] - A[k*n + j] >= splat(0)); /* not finite */
    }
    int status = OK;
    for (int lane = 0; lane < LANES; ++lane) {
        pivots[0].pivoted[lane] = 0;
        if (mask_get(&grown, lane)) {
            const int found = factorise_lane(n, copy, lane, dense, A, pivots);
            status = status == OK ? found : status;
        }
    }
    return status;
}

/* b <- A^-1 b or A^-T b in the lanes that were pivoted; `given` is the right-hand side. */
NOINLINE void solve_pivoted(int n, const lanes *A, const lanes_pivots_t *pivots, int transposed,
    const lanes *given, lanes *b)
{
    for (int lane = 0; lane < LANES; ++lane) {
        int exponents[U], exchanges[U];
        real dense[U];
        if (!pivots[0].pivoted[lane])
            continue;
        for (int i = 0; i < n; ++i) {
            exponents[i] = pivots[i].exponent[lane];
            exchanges[i] = pivots[i].exchange[lane];
            dense[i] = lane_get(&given[i], lane);
        }
        const real *factors = (const real *)A + lane;
        if (transposed)
            substitute_transposed(n, factors, LANES, exponents, exchanges, dense);
        else
            for (int i = 0; i < n; ++i)
                dense[i] = NAN; /* only transposed systems are solved in lanes */
        for (int i = 0; i < n; ++i)
            lane_set(&b[i], lane, dense[i]);
    }
}
#endif

#endif
