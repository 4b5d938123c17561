/* Coefficients of four rows stand together; rows are the stages of L, then those of L^. */
enum { RUN(ROWS) = 2*RUN(S), RUN(BLOCK) = 4 };

/* Where the coefficient of regressor k for a stage of L (group 0) or L^ (1) stands. */
INLINE int RUN(coefficient)(int k, int group, int item)
{
    const int row = group*RUN(S) + item, first = row - row % RUN(BLOCK);
    const int rows = RUN(ROWS) - first < RUN(BLOCK) ? RUN(ROWS) - first : RUN(BLOCK);
    return first*KNOWN + k*rows + row % RUN(BLOCK);
}

/*
 * Numbers start..start + count - 1 of the rows row..row + rows - 1 of the next step: sums in
 * registers, each coefficient read once.
 */
INLINE void RUN(block_ahead)(const lanes *next, const lanes *const *before, int lags, int row,
    int rows, int start, int count, lanes *y)
{
    lanes sum[RUN(BLOCK)][4];
    LOAD_AGAIN(next);
    for (int i = 0; i < rows; ++i)
        for (int a = 0; a < count; ++a)
            sum[i][a] = splat(0);
    for (int k = 0; k < 2*LAST; ++k, next += rows) {
        const lanes *x = before[0] + k % 2*RUN(HAT) + stage_regarded(k/2)*N + start;
        for (int i = 0; i < rows; ++i)
            for (int a = 0; a < count; ++a)
                sum[i][a] += next[i]*x[a];
    }
    for (int m = 1; m <= lags; ++m)
        for (int group = 0; group < 2; ++group, next += rows) {
            const lanes *x = before[m] + group*RUN(HAT) + start;
            for (int i = 0; i < rows; ++i)
                for (int a = 0; a < count; ++a)
                    sum[i][a] += next[i]*x[a];
        }
    for (int i = 0; i < rows; ++i)
        for (int a = 0; a < count; ++a)
            y[(row + i)*N + start + a] = sum[i][a];
}

INLINE void RUN(rows_ahead)(const lanes *next, const lanes *const *before, int lags, int row,
    int rows, lanes *y)
{
    int start = 0;
    next += row*KNOWN;
    for (; start + 4 <= N; start += 4)
        RUN(block_ahead)(next, before, lags, row, rows, start, 4, y);
    if (N % 4 > 0)
        RUN(block_ahead)(next, before, lags, row, rows, start, N % 4, y);
}

INLINE void RUN(stages_ahead)(const lanes *next, const lanes *const *before, int lags, lanes *y)
{
    int row = 0;
    for (; row + RUN(BLOCK) <= RUN(ROWS); row += RUN(BLOCK))
        RUN(rows_ahead)(next, before, lags, row, RUN(BLOCK), y);
    if (RUN(ROWS) % RUN(BLOCK) > 0)
        RUN(rows_ahead)(next, before, lags, row, RUN(ROWS) % RUN(BLOCK), y);
}
