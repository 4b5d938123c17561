/* LU factors of W = G H_pp G^T and constraint forces, on lanes. */
#ifndef GS_SIMD_SMALL_LU_H
#define GS_SIMD_SMALL_LU_H

#include "gyrospark/simd/vector.h"

#if GS_FACTORS
#if GS_ELEMENTS
/* Sparse W = G H_pp G^T, overwritten by its factors. */
typedef lanes schur_t[FACTOR];

/*
 * Solves `count` systems, with results bitwise equal to lanes_substitute. The systems are
 * interleaved, which hides the latency of dependent additions.
 */
INLINE void lanes_substitute_all(int count, schur_t *W, lanes *b)
{
    const int *before = before_row, *slot = before_slot, *row = below_row + (FACTOR - M);
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
/* W = G H_pp G^T, or the matrix of the hidden constraints; overwritten by its LU factors. */
typedef lanes schur_t[M][M];

/* LU factors of the m x m matrix A, without pivoting: W = G H_pp G^T is positive definite. */
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

/* Solves `count` systems. */
INLINE void lanes_substitute_all(int count, schur_t *A, lanes *b)
{
    for (int j = 0; j < count; ++j)
        lanes_substitute(A[j], b + j*M);
}
#else
/* One-by-one W = G H_pp G^T, or matrix of the hidden constraint; overwritten by its inverse. */
typedef lanes schur_t[M][M];

/* The factor is 1/A. */
INLINE void lanes_factor(schur_t A)
{
    A[0][0] = 1/A[0][0];
}

INLINE void lanes_substitute(schur_t A, lanes b[M])
{
    b[0] *= A[0][0];
}

/* Solves `count` systems. */
INLINE void lanes_substitute_all(int count, schur_t *A, lanes *b)
{
    for (int j = 0; j < count; ++j)
        lanes_substitute(A[j], b + j*M);
}
#endif
#endif

#if GS_SPARK && !GS_ELEMENTS
/* G^T lambda */
INLINE void lanes_constraint_force(const lanes_constants *c, const lanes q[N],
    const lanes lambda[M], lanes force[N])
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
