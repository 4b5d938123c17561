NOINLINE void RUN(nodes_of_nodes)(const lanes *base, int stride, const real *table,
    const lanes *x, lanes *y)
{
    RUN(product)(RUN(P), P, M, base, stride, table, x, y);
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
    TIMED(for (int l = 0; l < P; ++l) {)
        TIMED(w->ask[l] = splat(tableau.c_tilde[l + 1]);)
        TIMED(w->act[l] = splat(l < P - 1 ? tableau.c_tilde[l + 1] : 0);)
    TIMED(})
}
