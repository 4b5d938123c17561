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
