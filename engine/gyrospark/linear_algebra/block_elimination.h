/* Sparse L D L^T factorisation of W = G H_pp G^T, assembled from element blocks. */

/* Gathers the arguments of an element instance: y[a] = x[from[a]]. */
static inline void TYPED(gather)(int count, const int *from, const NUMBER *x, NUMBER *y)
{
    for (int a = 0; a < count; ++a)
        y[a] = x[from[a]];
}

#if GS_CONSTRAINED
/* W += G X G^T for one block of n momenta and `rows` rows of G; slot[] lists the target entries. */
static inline void TYPED(add_cell)(int n, int rows, const NUMBER *G, const NUMBER *X,
    const int *slot, NUMBER *W)
{
    for (int r = 0; r < rows; ++r) {
        NUMBER v[LARGEST_CELL];
        for (int a = 0; a < n; ++a) {
            v[a] = X[a*n]*G[r*n];
            for (int b = 1; b < n; ++b)
                v[a] += X[a*n + b]*G[r*n + b];
        }
        for (int s = 0; s <= r; ++s) {
            NUMBER sum = G[s*n]*v[0];
            for (int a = 1; a < n; ++a)
                sum += G[s*n + a]*v[a];
            W[*slot++] += sum;
        }
    }
}

/*
 * W <- L and D^-1 in place: first D^-1 (M entries), then the columns of L one after another. W is
 * positive definite, so that elimination needs no pivoting.
 */
static void TYPED(factor)(NUMBER W[FACTOR])
{
    const int *row = below_row, *target = below_target;
    int below = M;
    for (int k = 0; k < M; ++k) {
        const int pivot = pivot_order[k], rows = pivot_rows[k];
        const NUMBER inverse = 1/W[pivot];
        W[pivot] = inverse;
        for (int i = below; i < below + rows; ++i) {
            const NUMBER value = W[i], l = value*inverse;
            for (int j = below; j < i; ++j)
                W[*target++] -= l*W[j];
            W[*row++] -= l*value;
        }
        for (int i = below; i < below + rows; ++i)
            W[i] *= inverse;
        below += rows;
    }
}

/*
 * b <- W^-1 b from the factors. The sums are accumulated in registers, and the most recent entry of
 * b is added last, because it has the longest latency.
 */
static void TYPED(substitute)(const NUMBER W[FACTOR], NUMBER b[M])
{
    const int *before = before_row, *slot = before_slot, *row = below_row + (FACTOR - M);
    const NUMBER *below = W + FACTOR;
    for (int k = 0; k < M; ++k) {
        NUMBER x = b[pivot_order[k]];
        for (int i = 0; i < before_rows[k]; ++i)
            x -= W[*slot++]*b[*before++];
        b[pivot_order[k]] = x;
    }
    for (int k = M - 1; k >= 0; --k) {
        NUMBER x = b[pivot_order[k]]*W[pivot_order[k]];
        for (int i = 0; i < pivot_rows[k]; ++i)
            x -= *--below*b[*--row];
        b[pivot_order[k]] = x;
    }
}
#endif
