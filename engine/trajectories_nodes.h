NOINLINE void RUN(nodes_of_stages)(const lanes *base, int stride, const real *table,
    const lanes *x, lanes *y)
{
    int start = 0;
    for (; start + 4 <= N; start += 4)
        RUN(four)(RUN(P), S, N, 4, base + start, stride, table, x + start, y + start);
    if (N % 4 > 0)
        RUN(four)(RUN(P), S, N, N % 4, base + start, stride, table, x + start,
            y + start);
}

NOINLINE void RUN(stages_of_nodes)(const lanes *base, int stride, const real *table,
    const lanes *x, lanes *y)
{
    int start = 0;
    for (; start + 4 <= N; start += 4)
        RUN(four)(RUN(S), P, N, 4, base + start, stride, table, x + start, y + start);
    if (N % 4 > 0)
        RUN(four)(RUN(S), P, N, N % 4, base + start, stride, table, x + start,
            y + start);
}

NOINLINE void RUN(nodes_of_nodes)(const lanes *base, int stride, const real *table,
    const lanes *x, lanes *y)
{
    int start = 0;
    for (; start + 4 <= M; start += 4)
        RUN(four)(RUN(P), P, M, 4, base + start, stride, table, x + start, y + start);
    if (M % 4 > 0)
        RUN(four)(RUN(P), P, M, M % 4, base + start, stride, table, x + start,
            y + start);
}

/* The place of node j, where multipliers act: node 0 comes last, and is at q. */
INLINE void RUN(node)(const RUN(t) *w, int j, lanes *place)
{
    for (int a = 0; a < N; ++a)
        place[a] = j < P - 1 ? w->q[a] + w->now.D[j*N + a] : w->q[a];
}

static void RUN(set_nodes)(RUN(t) *w)
{
    (void)w;
}
