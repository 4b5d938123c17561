/* LU factors of W, m x m, in its place, without pivoting: W = G H_pp G^T is positive definite. */
static void factorise(real W[M][M])
{
    for (int k = 0; k < M; ++k) {
        W[k][k] = 1/W[k][k];
        for (int i = k + 1; i < M; ++i) {
            W[i][k] *= W[k][k];
            for (int j = k + 1; j < M; ++j)
                W[i][j] -= W[i][k]*W[k][j];
        }
    }
}

/* b <- W^-1 b from the factors */
static void substitute(real W[M][M], real b[M])
{
    for (int i = 1; i < M; ++i)
        for (int j = 0; j < i; ++j)
            b[i] -= W[i][j]*b[j];
    for (int i = M - 1; i >= 0; --i) {
        for (int j = i + 1; j < M; ++j)
            b[i] -= W[i][j]*b[j];
        b[i] *= W[i][i];
    }
}
