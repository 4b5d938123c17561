/* Numbers start..start + count - 1 of the stages of the next step, `count` of each. */
INLINE void RUN(four_ahead)(const lanes *next, const lanes *const *before, int lags, int start,
    int count, lanes *y)
{
    lanes sum[2][4][RUN(S)]; /* even and odd regressors */
    for (int a = 0; a < count; ++a)
        for (int i = 0; i < RUN(S); ++i)
            sum[0][a][i] = sum[1][a][i] = splat(0);
    for (int j = 0; j < S; ++j, next += RUN(S))
        for (int a = 0; a < count; ++a) {
            const lanes value = splat(part(&before[0][j/LANES*N + start + a], j % LANES));
            for (int i = 0; i < RUN(S); ++i)
                sum[j % 2][a][i] += next[i]*value;
        }
    for (int m = 1; m <= lags; ++m)
        for (int pick = 0; pick < PICKS; ++pick, next += RUN(S))
            for (int a = 0; a < count; ++a) {
                const int j = pick*(S/2);
                const lanes value = splat(part(&before[m][j/LANES*N + start + a], j % LANES));
                for (int i = 0; i < RUN(S); ++i)
                    sum[pick % 2][a][i] += next[i]*value;
            }
    for (int a = 0; a < count; ++a)
        for (int i = 0; i < RUN(S); ++i)
            y[i*N + start + a] = sum[0][a][i] + sum[1][a][i];
}

INLINE void RUN(stages_ahead)(const lanes *next, const lanes *const *before, int lags, lanes *y)
{
    int start = 0;
    for (; start + 4 <= N; start += 4)
        RUN(four_ahead)(next, before, lags, start, 4, y);
    if (N % 4 > 0)
        RUN(four_ahead)(next, before, lags, start, N % 4, y);
}
