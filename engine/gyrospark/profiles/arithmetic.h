/* Profiles control and run: compensated sums, factors of W. */
#ifndef GS_PROFILES_ARITHMETIC_H
#define GS_PROFILES_ARITHMETIC_H

#include "gyrospark/engine.h"

/* sum_j x_j, rows of N numbers */
static void total(int rows, const real *x, real sum[N])
{
    for (int a = 0; a < N; ++a) {
        sum[a] = x[a];
        for (int j = 1; j < rows; ++j) {
            sum[a] += x[(j*N) + a];
        }
    }
}

/* two-sum: old + change = end + low exactly; low is added to the next change. */
static void add_compensated(const real old[N], const real change[N], real end[N], real low[N])
{
    for (int a = 0; a < N; ++a) {
        const real sum = old[a] + change[a];
        const real share = sum - old[a];
        low[a] = (old[a] - (sum - share)) + (change[a] - share);
        end[a] = sum;
    }
}

#if GS_FACTORS
#if GS_SEVERAL_CONSTRAINTS
/* W <- its LU factors, without pivoting: W = G H_pp G^T is positive definite. */
static void factorise(real W[M][M])
{
    for (int k = 0; k < M; ++k) {
        W[k][k] = (real)1/W[k][k];
        for (int i = k + 1; i < M; ++i) {
            W[i][k] *= W[k][k];
            for (int j = k + 1; j < M; ++j) {
                W[i][j] -= W[i][k]*W[k][j];
            }
        }
    }
}

/* b <- W^-1 b from the factors */
static void substitute(real W[M][M], real b[M])
{
    for (int i = 1; i < M; ++i) {
        for (int j = 0; j < i; ++j) {
            b[i] -= W[i][j]*b[j];
        }
    }
    for (int i = M - 1; i >= 0; --i) {
        for (int j = i + 1; j < M; ++j) {
            b[i] -= W[i][j]*b[j];
        }
        b[i] *= W[i][i];
    }
}
#else
/* W <- 1/W, one number */
static void factorise(real W[M][M])
{
    W[0][0] = (real)1/W[0][0];
}

static void substitute(real W[M][M], real b[M])
{
    b[0] *= W[0][0];
}
#endif
#endif

#endif
