PRODUCT void RUN(nodes_of_stages)(const lanes *base, int stride, const lanes *table,
    const lanes *x, lanes *y)
{
    RUN(product)(RUN(P), S, N, base, stride, table, x, y);
}

PRODUCT void RUN(stages_of_nodes)(const lanes *base, int stride, const lanes *table,
    const lanes *x, lanes *y)
{
    RUN(product)(RUN(S), P, N, base, stride, table, x, y);
}

PRODUCT void RUN(nodes_of_nodes)(const lanes *base, int stride, const lanes *table,
    const lanes *x, lanes *y)
{
    RUN(product)(RUN(P), P, M, base, stride, table, x, y);
}

/* The place of the nodes of item j, where multipliers act: node 0 is at q. */
INLINE void RUN(node)(const RUN(t) *w, int j, lanes *place)
{
    for (int a = 0; a < N; ++a)
        place[a] = w->q[a] + w->moves[j]*w->now.D[j*N + a];
}

static void RUN(set_nodes)(RUN(t) *w)
{
    RUN(fill)(w->nu, P, S, &fast_nu[0][0]);
    RUN(fill)(w->nu_tilde, S, P, &fast_nu_tilde[0][0]);
    RUN(fill)(w->inverse, P, P, &fast_inverse[0][0]);
    RUN(fill)(w->onward_nodes, P, P, &fast_onward_nodes[0][0]);
    for (int l = 0; l < RUN(P)*LANES; ++l)
        set_part(&w->moves[l/LANES], l % LANES, l < P - 1);
    TIMED(for (int l = 0; l < RUN(P)*LANES; ++l) {)
        TIMED(const real late = l < P ? tableau.c_tilde[l + 1] : 0;)
        TIMED(set_part(&w->ask[l/LANES], l % LANES, late);)
        TIMED(set_part(&w->act[l/LANES], l % LANES, l < P - 1 ? late : 0);)
    TIMED(})
}
