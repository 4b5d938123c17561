/*
 * y = base + T x for a table that is symmetric in time, T_ij + T_i'j' = 1 where i', j' count from
 * the other end: half of the sum of x, and what differences x_j - x_j' and sums x_j + x_j' add to
 * it, with half as many coefficients. They stand row by row, those of differences first, then of
 * sums, then of the column in the middle. A column more is all ones, so is a row more.
 */
INLINE void RUN(half_of)(int rows, int columns, int more_columns, int more_rows, int count,
    const lanes *restrict base, int stride, const real *restrict table, const lanes *restrict x,
    lanes *restrict y)
{
    enum { PAIRS = S/2 > 0 ? S/2 : 1 };
    const int pairs = columns/2, last = columns*N, below = (rows - 1)*N;
    lanes odd[PAIRS][2], even[PAIRS][2], centre[2], sum[2], half[2];
    for (int a = 0; a < count; ++a) {
        centre[a] = columns % 2 > 0 ? x[pairs*N + a] : splat(0);
        sum[a] = centre[a];
        for (int j = 0; j < pairs; ++j) {
            odd[j][a] = x[j*N + a] - x[(columns - 1 - j)*N + a];
            even[j][a] = x[j*N + a] + x[(columns - 1 - j)*N + a];
            sum[a] += even[j][a];
        }
        half[a] = more_columns > 0 ? (real)0.5*sum[a] + x[last + a] : (real)0.5*sum[a];
    }
    for (int i = 0; i < rows/2; ++i, table += columns) {
        lanes by_odd[2], by_even[2];
        for (int a = 0; a < count; ++a) {
            by_odd[a] = half[a];
            by_even[a] = splat(0);
        }
        for (int j = 0; j < pairs; ++j)
            for (int a = 0; a < count; ++a) {
                by_odd[a] += splat(table[j])*odd[j][a];
                by_even[a] += splat(table[pairs + j])*even[j][a];
            }
        for (int a = 0; a < count; ++a) {
            if (columns % 2 > 0)
                by_even[a] += splat(table[2*pairs])*centre[a];
            y[i*N + a] = base[i*stride + a] + (by_odd[a] + by_even[a]);
            y[below - i*N + a] = base[(rows - 1 - i)*stride + a] + (by_odd[a] - by_even[a]);
        }
    }
    for (int a = 0; a < count; ++a) {
        lanes by_odd = half[a];
        for (int j = 0; j < pairs && rows % 2 > 0; ++j)
            by_odd += splat(table[j])*odd[j][a];
        if (rows % 2 > 0)
            y[rows/2*N + a] = base[rows/2*stride + a] + by_odd;
        if (more_rows > 0)
            y[rows*N + a] = base[rows*stride + a] + sum[a];
    }
}

/* Two numbers at a time: what sums and differences of more take is not in registers. */
INLINE void RUN(halves)(int rows, int columns, int more_columns, int more_rows, const lanes *base,
    int stride, const real *table, const lanes *x, lanes *y)
{
    for (int a = 0; a < N; a += 2) {
        const real *again = table;
        LOAD_AGAIN(again);
        if (a + 2 <= N)
            RUN(half_of)(rows, columns, more_columns, more_rows, 2, base + a, stride, again, x + a,
                y + a);
        else
            RUN(half_of)(rows, columns, more_columns, more_rows, 1, base + a, stride, again, x + a,
                y + a);
    }
}

NOINLINE void RUN(halves_of_stages)(const lanes *base, int stride, const real *table,
    const lanes *x, lanes *y)
{
    RUN(halves)(S, S, 0, 0, base, stride, table, x, y);
}

/* Q_i = q + sum_j mu_ij L_j */
INLINE void RUN(places)(const RUN(t) *w, const lanes *L, lanes *Q)
{
    RUN(halves_of_stages)(w->q, 0, &half_mu[0][0], L, Q);
}

/* base_i + sum_j mu^_ij L^_j */
INLINE void RUN(pushes)(const RUN(t) *w, const lanes *base, int stride, const lanes *L_hat,
    lanes *momentum)
{
    (void)w;
    RUN(halves_of_stages)(base, stride, &half_mu_hat[0][0], L_hat, momentum);
}
