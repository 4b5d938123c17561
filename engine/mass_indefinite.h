/*
 * A <- M(q) and behind it M = Q R by modified Gram-Schmidt: the columns of Q, and R with 1/|q_k|^2
 * on its diagonal. For an indefinite M, L D L^T without pivots loses digits. Here nothing branches,
 * so that lanes do the same, and b as one more column makes it backward stable (Bjorck, 1967).
 */
static void ON(factor_mass)(const HELD *c, const NUMBER q[N], NUMBER A[MASS])
{
    const NUMBER zero = { 0 };
    const int *row = mass_row, *slot = mass_slot;
    NUMBER *Q = A + MASS_ENTRIES, *R = Q + N*N;
    ON(mass_matrix)(c, q, A);
    for (int e = 0; e < N*N; ++e)
        Q[e] = zero;
    for (int k = 0; k < N; ++k) {
        const int pivot = mass_order[k];
        Q[pivot*N + pivot] = A[pivot];
        for (int i = 0; i < mass_rows[k]; ++i, ++row, ++slot)
            Q[pivot*N + *row] = Q[*row*N + pivot] = A[*slot];
    }
    for (int k = 0; k < N; ++k)
        for (int j = k; j < N; ++j) {
            NUMBER sum = Q[k*N]*Q[j*N];
            for (int a = 1; a < N; ++a)
                sum += Q[k*N + a]*Q[j*N + a];
            R[k*N + j] = j == k ? 1/sum : sum*R[k*N + k];
            for (int a = 0; a < N && j != k; ++a)
                Q[j*N + a] -= R[k*N + j]*Q[k*N + a];
        }
}

/* x <- M^-1 x from the factors */
static void ON(solve_mass)(const NUMBER A[MASS], NUMBER x[N])
{
    const NUMBER *Q = A + MASS_ENTRIES, *R = Q + N*N;
    NUMBER y[N];
    for (int k = 0; k < N; ++k) {
        NUMBER sum = Q[k*N]*x[0];
        for (int a = 1; a < N; ++a)
            sum += Q[k*N + a]*x[a];
        y[k] = sum*R[k*N + k];
        for (int a = 0; a < N; ++a)
            x[a] -= y[k]*Q[k*N + a];
    }
    for (int k = N - 1; k >= 0; --k) {
        x[k] = y[k];
        for (int j = k + 1; j < N; ++j)
            x[k] -= R[k*N + j]*x[j];
    }
}
