NOINLINE void RUN(nodes_of_stages)(const lanes *base, int stride, const real *table,
    const lanes *x, lanes *y)
{
    RUN(product)(RUN(P), S, N, base, stride, table, x, y);
}

NOINLINE void RUN(stages_of_nodes)(const lanes *base, int stride, const real *table,
    const lanes *x, lanes *y)
{
    RUN(product)(RUN(S), P, N, base, stride, table, x, y);
}
