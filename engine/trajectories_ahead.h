/*
 * Numbers start..start + count - 1 of the stages row..row + rows - 1 of the next step: sums in
 * registers, each coefficient read once.
 */
INLINE void RUN(block_ahead)(const lanes *next, const lanes *const *before, int lags, int row,
    int rows, int start, int count, lanes *y)
{
    lanes sum[4][4];
    LOAD_AGAIN(next);
    for (int i = 0; i < rows; ++i)
        for (int a = 0; a < count; ++a)
            sum[i][a] = splat(0);
    next += row;
    for (int j = 0; j < S; ++j, next += S)
        for (int i = 0; i < rows; ++i)
            for (int a = 0; a < count; ++a)
                sum[i][a] += next[i]*before[0][j*N + start + a];
    for (int m = 1; m <= lags; ++m)
        for (int pick = 0; pick < PICKS; ++pick, next += S)
            for (int i = 0; i < rows; ++i)
                for (int a = 0; a < count; ++a)
                    sum[i][a] += next[i]*before[m][pick*(S/2)*N + start + a];
    for (int i = 0; i < rows; ++i)
        for (int a = 0; a < count; ++a)
            y[(row + i)*N + start + a] = sum[i][a];
}

INLINE void RUN(rows_ahead)(const lanes *next, const lanes *const *before, int lags, int row,
    int rows, lanes *y)
{
    int start = 0;
    for (; start + 4 <= N; start += 4)
        RUN(block_ahead)(next, before, lags, row, rows, start, 4, y);
    if (N % 4 > 0)
        RUN(block_ahead)(next, before, lags, row, rows, start, N % 4, y);
}

INLINE void RUN(stages_ahead)(const lanes *next, const lanes *const *before, int lags, lanes *y)
{
    int row = 0;
    for (; row + 4 <= S; row += 4)
        RUN(rows_ahead)(next, before, lags, row, 4, y);
    if (S % 4 > 0)
        RUN(rows_ahead)(next, before, lags, row, S % 4, y);
}
