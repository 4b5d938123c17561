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
