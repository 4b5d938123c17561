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
