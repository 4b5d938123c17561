/* LU factors of the matrices of derivatives, and solutions with them and their transposes. */
#ifndef GS_DERIVATIVES_LU_H
#define GS_DERIVATIVES_LU_H

#include "gyrospark/linear_algebra/dense_lu.h"
#include "gyrospark/simd/vector.h"

/* Exponents of the row scales, then row exchanges: as many of both as rows. */
typedef int pivots_t;

/* A = P L U in place, with partial pivoting. */
static inline int factorise_matrix(int n, real *A, pivots_t *pivots)
{
    long products;
    return lu_factorise(n, A, pivots, pivots + n, &products);
}

/* b <- A^-1 b */
static inline void solve_with(int n, const real *A, const pivots_t *pivots, real *b)
{
    (void)lu_substitute(n, A, pivots, pivots + n, b);
}

/* b <- A^-T b: the transposes of the factors in reverse order */
static inline void solve_transposed_with(int n, const real *A, const pivots_t *pivots, real *b)
{
    const pivots_t *exchanges = pivots + n;
    for (int i = 0; i < n; ++i) {
        const real value = b[i] /= A[i*n + i];
        for (int j = i + 1; j < n; ++j)
            b[j] -= A[i*n + j]*value;
    }
    for (int i = n - 1; i > 0; --i)
        for (int j = 0; j < i; ++j)
            b[j] -= A[i*n + j]*b[i];
    for (int k = n - 1; k >= 0; --k) {
        const real value = b[exchanges[k]];
        b[exchanges[k]] = b[k];
        b[k] = value;
    }
    for (int i = 0; i < n; ++i)
        b[i] = MATH(ldexp)(b[i], -pivots[i]);
}

#if GS_DERIVATIVES_IN_LANES
/* Largest growth of a row in an elimination without pivoting; a lane beyond is pivoted. */
enum { MAX_GROWTH = 1000 };

/* Of each row: exponents and exchanges of the lanes that were pivoted; which these are, in row 0. */
typedef struct {
    int pivoted[LANES], exponent[LANES], exchange[LANES];
} lanes_pivots_t;

/* Copies lane i of the factors to `dense`, and its pivots. */
static void copy_lane(int n, const lanes *A, int i, const lanes_pivots_t *rows, real *dense,
    pivots_t *pivots)
{
    for (int e = 0; e < n*n; ++e)
        dense[e] = lane_get(&A[e], i);
    for (int k = 0; k < n; ++k) {
        pivots[k] = rows[k].exponent[i];
        pivots[n + k] = rows[k].exchange[i];
    }
}

/* Factorises one lane of A with pivoting. */
NOINLINE int factorise_lane(int n, const lanes *A, int i, lanes *factors, lanes_pivots_t *rows)
{
    real dense[U*U];
    pivots_t pivots[2*U] = { 0 };
    for (int e = 0; e < n*n; ++e)
        dense[e] = lane_get(&A[e], i);
    const int status = factorise_matrix(n, dense, pivots);
    for (int e = 0; e < n*n; ++e)
        lane_set(&factors[e], i, dense[e]);
    for (int k = 0; k < n; ++k) {
        rows[k].exponent[i] = pivots[k];
        rows[k].exchange[i] = pivots[n + k];
    }
    rows[0].pivoted[i] = 1;
    return status;
}

/* Subtracts multiples of row k from the rows from..to - 1. */
INLINE void eliminate(int n, lanes *A, int k, int from, int to)
{
    for (int i = from; i < to; ++i) {
        lanes *restrict row = A + i*n;
        const lanes *restrict upper = A + k*n;
        const lanes factor = row[k]*upper[k];
        row[k] = factor;
        for (int j = k + 1; j < n; ++j)
            row[j] -= factor*upper[j];
    }
}

/*
 * A = L U without pivoting; the diagonal holds the inverse pivots. J is the unit matrix plus O(h),
 * and the Schur complement of the multipliers is regular, so that rows grow little. A lane in which
 * one grows by more than MAX_GROWTH is factorised with pivoting.
 */
static int lanes_factorise_matrix(int n, lanes *A, lanes_pivots_t *rows)
{
    lanes copy[U*U];
    lanes_mask grown = splat(0) > splat(1);
    for (int e = 0; e < n*n; ++e)
        copy[e] = A[e];
    for (int k = 0; k < n; ++k) {
        const lanes *restrict upper = A + k*n;
        lanes before = splat(0), after = splat(0);
        for (int j = 0; j < n; ++j) {
            before = lanes_larger(before, lanes_larger(copy[k*n + j], -copy[k*n + j]));
            if (j >= k)
                after = lanes_larger(after, lanes_larger(upper[j], -upper[j]));
        }
        const lanes inverse = 1/upper[k];
        grown |= lanes_mask_not(after <= MAX_GROWTH*before)
            | lanes_mask_not(inverse - inverse >= splat(0)); /* the latter is not finite */
        A[k*n + k] = inverse;
        if (k + 1 == n)
            break;
        if (k % 2 == 0) { /* the next row alone; the others with both rows at once */
            eliminate(n, A, k, k + 1, k + 2);
            continue;
        }
        for (int i = k + 1; i < n; ++i) {
            lanes *restrict row = A + i*n;
            const lanes *restrict one = A + (k - 1)*n, *restrict other = A + k*n;
            const lanes first = row[k - 1]*one[k - 1];
            const lanes second = (row[k] - first*one[k])*other[k];
            row[k - 1] = first;
            row[k] = second;
            for (int j = k + 1; j < n; ++j)
                row[j] -= first*one[j] + second*other[j];
        }
    }
    int status = OK;
    for (int i = 0; i < LANES; ++i) {
        rows[0].pivoted[i] = 0;
        if (mask_get(&grown, i)) {
            const int lane_status = factorise_lane(n, copy, i, A, rows);
            status = status == OK ? lane_status : status;
        }
    }
    return status;
}

/* The solutions of lanes that were pivoted, of the right-hand side `right_side`. */
NOINLINE void solve_pivoted(int n, const lanes *A, const lanes_pivots_t *rows, int transposed,
    const lanes *right_side, lanes *b)
{
    real dense[U*U], x[U];
    pivots_t pivots[2*U];
    for (int i = 0; i < LANES; ++i) {
        if (!rows[0].pivoted[i])
            continue;
        copy_lane(n, A, i, rows, dense, pivots);
        for (int e = 0; e < n; ++e)
            x[e] = lane_get(&right_side[e], i);
        if (transposed)
            solve_transposed_with(n, dense, pivots, x);
        else
            solve_with(n, dense, pivots, x);
        for (int e = 0; e < n; ++e)
            lane_set(&b[e], i, x[e]);
    }
}

/* Whether a lane of the factors was pivoted */
static int any_pivoted(const lanes_pivots_t *rows)
{
    int pivoted = 0;
    for (int i = 0; i < LANES; ++i)
        pivoted |= rows[0].pivoted[i];
    return pivoted;
}

/* b <- A^-1 b */
static void lanes_solve_with(int n, const lanes *A, const lanes_pivots_t *rows, lanes *b)
{
    lanes right_side[U];
    for (int i = 0; i < n; ++i)
        right_side[i] = b[i];
    for (int i = 1; i < n; ++i)
        for (int j = 0; j < i; ++j)
            b[i] -= A[i*n + j]*b[j];
    for (int i = n - 1; i >= 0; --i) {
        for (int j = i + 1; j < n; ++j)
            b[i] -= A[i*n + j]*b[j];
        b[i] *= A[i*n + i];
    }
    if (any_pivoted(rows))
        solve_pivoted(n, A, rows, 0, right_side, b);
}

/* b <- A^-T b of `width` right-hand sides, at most 4, whose sums are in registers */
INLINE void substitute_transposed(int n, const lanes *A, int width, int stride, lanes *b)
{
    for (int i = 0; i < n; ++i) {
        lanes sum[4];
        for (int r = 0; r < width; ++r)
            sum[r] = b[r*stride + i];
        for (int j = 0; j < i; ++j)
            for (int r = 0; r < width; ++r)
                sum[r] -= A[j*n + i]*b[r*stride + j];
        for (int r = 0; r < width; ++r)
            b[r*stride + i] = sum[r]*A[i*n + i];
    }
    for (int i = n - 2; i >= 0; --i) {
        lanes sum[4];
        for (int r = 0; r < width; ++r)
            sum[r] = b[r*stride + i];
        for (int j = i + 1; j < n; ++j)
            for (int r = 0; r < width; ++r)
                sum[r] -= A[j*n + i]*b[r*stride + j];
        for (int r = 0; r < width; ++r)
            b[r*stride + i] = sum[r];
    }
}

/* b <- A^-T b of `count` right-hand sides in rows of U */
static void lanes_solve_transposed_all(int n, const lanes *A, const lanes_pivots_t *rows,
    int count, lanes *b)
{
    const int pivoted = any_pivoted(rows);
    for (int r = 0; r < count; r += 4) {
        lanes right_side[4][U];
        const int width = count - r < 4 ? count - r : 4;
        for (int e = 0; e < width*n && pivoted; ++e)
            right_side[e/n][e % n] = b[(r + e/n)*U + e % n];
        if (width == 4)
            substitute_transposed(n, A, 4, U, b + r*U);
        else
            for (int e = 0; e < width; ++e)
                substitute_transposed(n, A, 1, U, b + (r + e)*U);
        for (int e = 0; e < width && pivoted; ++e)
            solve_pivoted(n, A, rows, 1, right_side[e], b + (r + e)*U);
    }
}

/* b <- A^-T b */
static void lanes_solve_transposed_with(int n, const lanes *A, const lanes_pivots_t *rows,
    lanes *b)
{
    lanes_solve_transposed_all(n, A, rows, 1, b);
}
#endif

#endif
