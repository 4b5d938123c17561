/* Factors of W = G H_pp G^T and constraint forces, on lanes. */
#ifndef GS_SIMD_SMALL_LU_H
#define GS_SIMD_SMALL_LU_H

#include "gyrospark/simd/vector.h"

#if GS_FACTORS
#if GS_ELEMENTS
/* W = G H_pp G^T without its zeros, and its factors in place of it. */
typedef lanes schur_t[FACTOR];

/*
 * lanes_substitute of `count` systems, to the bit, but side by side: where one waits for a sum,
 * others are computed.
 */
INLINE void lanes_substitute_all(int count, schur_t *W, lanes *b)
{
    const int *before = before_row, *slot = before_slot, *row = below_row + FACTOR - M;
    lanes x[P];
    for (int k = 0; k < M; ++k) {
        const int pivot = pivot_order[k];
        for (int j = 0; j < count; ++j)
            x[j] = b[j*M + pivot];
        for (int i = 0; i < before_rows[k]; ++i, ++slot, ++before)
            for (int j = 0; j < count; ++j)
                x[j] -= W[j][*slot]*b[j*M + *before];
        for (int j = 0; j < count; ++j)
            b[j*M + pivot] = x[j];
    }
    for (int k = M - 1, below = FACTOR; k >= 0; --k) {
        const int pivot = pivot_order[k];
        for (int j = 0; j < count; ++j)
            x[j] = b[j*M + pivot]*W[j][pivot];
        for (int i = 0; i < pivot_rows[k]; ++i) {
            --row, --below;
            for (int j = 0; j < count; ++j)
                x[j] -= W[j][below]*b[j*M + *row];
        }
        for (int j = 0; j < count; ++j)
            b[j*M + pivot] = x[j];
    }
}
#else
#if GS_SEVERAL_CONSTRAINTS
/* W = G H_pp G^T or what takes its place, and its LU factors in place of it. */
typedef lanes schur_t[M][M];

/* LU factors of A, m x m, without pivoting: W = G H_pp G^T is positive definite. */
INLINE void lanes_factor(schur_t A)
{
    for (int k = 0; k < M; ++k) {
        A[k][k] = 1/A[k][k];
        for (int i = k + 1; i < M; ++i) {
            A[i][k] *= A[k][k];
            for (int j = k + 1; j < M; ++j)
                A[i][j] -= A[i][k]*A[k][j];
        }
    }
}

/* b <- A^-1 b from the factors */
INLINE void lanes_substitute(schur_t A, lanes b[M])
{
    for (int i = 1; i < M; ++i)
        for (int j = 0; j < i; ++j)
            b[i] -= A[i][j]*b[j];
    for (int i = M - 1; i >= 0; --i) {
        for (int j = i + 1; j < M; ++j)
            b[i] -= A[i][j]*b[j];
        b[i] *= A[i][i];
    }
}

/* The same of `count` systems. */
INLINE void lanes_substitute_all(int count, schur_t *A, lanes *b)
{
    for (int j = 0; j < count; ++j)
        lanes_substitute(A[j], b + j*M);
}
#else
/* W = G H_pp G^T or what takes its place: one number, and its inverse in place of it. */
typedef lanes schur_t[M][M];

/* A one-by-one matrix is factorised by its inverse. */
INLINE void lanes_factor(schur_t A)
{
    A[0][0] = 1/A[0][0];
}

INLINE void lanes_substitute(schur_t A, lanes b[M])
{
    b[0] *= A[0][0];
}

/* The same of `count` systems. */
INLINE void lanes_substitute_all(int count, schur_t *A, lanes *b)
{
    for (int j = 0; j < count; ++j)
        lanes_substitute(A[j], b + j*M);
}
#endif
#endif

#if GS_SPARK && !GS_ELEMENTS
/* G^T lambda */
INLINE void lanes_constraint_force(const lanes_constants *c, const lanes q[N], const lanes lambda[M],
    lanes force[N])
{
    lanes G[M][N];
    lanes_constraint_jacobian(c, q, G);
    for (int a = 0; a < N; ++a) {
        lanes sum = G[0][a]*lambda[0];
        for (int mu = 1; mu < M; ++mu)
            sum += G[mu][a]*lambda[mu];
        force[a] = sum;
    }
}
#endif
#endif

#endif
