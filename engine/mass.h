/* A <- the factors of M(q) = L D L^T without its zeros: 1/D on the diagonal, L below it. */
static void ON(factor_mass)(const HELD *c, const NUMBER q[N], NUMBER A[MASS])
{
    const int *row = mass_row, *slot = mass_slot, *target = mass_target;
    ON(mass_matrix)(c, q, A);
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

/* x <- M^-1 x from the factors */
static void ON(solve_mass)(const NUMBER A[MASS], NUMBER x[N])
{
    const int *row = mass_row, *slot = mass_slot;
    for (int k = 0; k < N; ++k) {
        const NUMBER part_of_it = x[mass_order[k]];
        for (int i = 0; i < mass_rows[k]; ++i)
            x[*row++] -= A[*slot++]*part_of_it;
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
