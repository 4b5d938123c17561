/* Factorisation of the mass matrix M(q) of a Lagrangian. */

#if GS_INDEFINITE_MASS
/*
 * A <- M(q), followed by M = Q R from modified Gram-Schmidt: the columns of Q, then R with
 * 1/|q_k|^2 on its diagonal. L D L^T without pivoting is unstable for an indefinite M. Gram-Schmidt
 * has no branches, so that all lanes execute it alike, and the right-hand side as an additional
 * column makes the solution backward stable (Bjorck, 1967).
 */
static void TYPED(factor_mass)(const TYPED(constants) *c, const NUMBER q[N], NUMBER A[MASS])
{
    const NUMBER zero = { 0 };
    const int *row = mass_row, *slot = mass_slot;
    NUMBER *Q = A + MASS_ENTRIES, *R = Q + N*N;
    TYPED(mass_matrix)(c, q, A);
    for (int e = 0; e < N*N; ++e)
        Q[e] = zero;
    for (int k = 0; k < N; ++k) {
        const int pivot = mass_order[k];
        Q[pivot*N + pivot] = A[pivot];
        for (int i = 0; i < mass_rows[k]; ++i, ++row, ++slot) {
            Q[pivot*N + *row] = A[*slot];
            Q[*row*N + pivot] = A[*slot];
        }
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

/* x <- M^-1 x from the factors of M */
static void TYPED(solve_mass)(const NUMBER A[MASS], NUMBER x[N])
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
#else
/* A <- the sparse factors M(q) = L D L^T: D^-1 on the diagonal, the non-zeros of L below it. */
static void TYPED(factor_mass)(const TYPED(constants) *c, const NUMBER q[N], NUMBER A[MASS])
{
    const int *row = mass_row, *slot = mass_slot, *target = mass_target;
    TYPED(mass_matrix)(c, q, A);
    for (int k = 0; k < N; ++k) {
        const int pivot = mass_order[k], rows = mass_rows[k];
        const NUMBER inverse = 1/A[pivot];
        A[pivot] = inverse;
        for (int i = 0; i < rows; ++i) {
            const NUMBER l = A[slot[i]]*inverse;
            for (int j = 0; j < i; ++j)
                A[*target++] -= l*A[slot[j]];
            A[row[i]] -= l*A[slot[i]];
        }
        for (int i = 0; i < rows; ++i)
            A[slot[i]] *= inverse;
        row += rows;
        slot += rows;
    }
}

/* x <- M^-1 x from the factors of M */
static void TYPED(solve_mass)(const NUMBER A[MASS], NUMBER x[N])
{
    const int *row = mass_row, *slot = mass_slot;
    for (int k = 0; k < N; ++k) {
        const NUMBER x_k = x[mass_order[k]];
        for (int i = 0; i < mass_rows[k]; ++i)
            x[*row++] -= A[*slot++]*x_k;
    }
    for (int k = N - 1; k >= 0; --k) {
        const int pivot = mass_order[k];
        NUMBER sum = x[pivot]*A[pivot];
        row -= mass_rows[k];
        slot -= mass_rows[k];
        for (int i = 0; i < mass_rows[k]; ++i)
            sum -= A[slot[i]]*x[row[i]];
        x[pivot] = sum;
    }
}
#endif

/* v = M^-1 (p - b) from the factors A of M */
static void TYPED(velocities)(const TYPED(constants) *c, const NUMBER q[N], const NUMBER p[N],
    const NUMBER A[MASS], NUMBER v[N])
{
    TYPED(rest_momentum)(c, q, v);
    for (int a = 0; a < N; ++a)
        v[a] = p[a] - v[a];
    TYPED(solve_mass)(A, v);
}
