/* W <- its factors: L below the diagonal, 1/D on it. W is positive definite: no pivoting. */
static void ON(factor)(NUMBER W[FACTOR])
{
    const int *row = below_row, *slot = below_slot, *target = below_target;
    for (int k = 0; k < M; ++k) {
        const int pivot = pivot_order[k], rows = pivot_rows[k];
        const NUMBER inverse = 1/W[pivot];
        W[pivot] = inverse;
        for (int i = 0; i < rows; ++i) {
            const NUMBER l = W[slot[i]]*inverse;
            for (int j = 0; j < i; ++j)
                W[*target++] -= l*W[slot[j]];
            W[row[i]] -= l*W[slot[i]];
        }
        for (int i = 0; i < rows; ++i)
            W[slot[i]] *= inverse;
        row += rows;
        slot += rows;
    }
}

/* b <- W^-1 b from the factors */
static void ON(substitute)(const NUMBER W[FACTOR], NUMBER b[M])
{
    const int *row = below_row, *slot = below_slot;
    for (int k = 0; k < M; ++k) {
        const NUMBER x = b[pivot_order[k]];
        for (int i = 0; i < pivot_rows[k]; ++i)
            b[*row++] -= W[*slot++]*x;
    }
    for (int k = M - 1; k >= 0; --k) {
        const int pivot = pivot_order[k];
        NUMBER x = b[pivot]*W[pivot];
        row -= pivot_rows[k];
        slot -= pivot_rows[k];
        for (int i = 0; i < pivot_rows[k]; ++i)
            x -= W[slot[i]]*b[row[i]];
        b[pivot] = x;
    }
}
