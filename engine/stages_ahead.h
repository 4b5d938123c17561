/* Where the coefficient of regressor k for an item of L (group 0) or L^ (1) stands. */
INLINE int RUN(coefficient)(int k, int group, int item)
{
    return (2*k + group)*RUN(S) + item;
}

/* Numbers start..start + count - 1 of the stages of the next step, `count` of each. */
INLINE void RUN(four_ahead)(const lanes *next, const lanes *const *before, int lags, int start,
    int count, lanes *y)
{
    lanes sum[2][4][2*RUN(S)]; /* of L and of L^ as regressors */
    for (int a = 0; a < count; ++a)
        for (int i = 0; i < 2*RUN(S); ++i)
            sum[0][a][i] = sum[1][a][i] = splat(0);
    for (int k = 0; k < 2*LAST; ++k, next += 2*RUN(S))
        for (int a = 0; a < count; ++a) {
            const int j = stage_regarded(k/2), item = k % 2*RUN(HAT) + j/LANES*N;
            const lanes value = splat(part(&before[0][item + start + a], j % LANES));
            for (int i = 0; i < 2*RUN(S); ++i)
                sum[k % 2][a][i] += next[i]*value;
        }
    for (int m = 1; m <= lags; ++m)
        for (int group = 0; group < 2; ++group, next += 2*RUN(S))
            for (int a = 0; a < count; ++a) {
                const lanes value = splat(part(&before[m][group*RUN(HAT) + start + a], 0));
                for (int i = 0; i < 2*RUN(S); ++i)
                    sum[group][a][i] += next[i]*value;
            }
    for (int a = 0; a < count; ++a)
        for (int i = 0; i < 2*RUN(S); ++i)
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
