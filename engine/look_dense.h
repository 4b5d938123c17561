/* g at the state, with what rounding left of q, and 1/|G_mu|^2 of each row of G. */
INLINE void RUN(look)(RUN(t) *w)
{
    lanes G[M][N];
    lanes_constraint(&w->constants, w->q, w->bound.g_rounded);
    lanes_constraint_jacobian(&w->constants, w->q, G);
    for (int mu = 0; mu < M; ++mu) {
        lanes square = splat(LIMIT(MIN));
        w->bound.g[mu] = w->bound.g_rounded[mu];
        for (int a = 0; a < N; ++a) {
            w->bound.g[mu] += G[mu][a]*w->q_low[a];
            square += G[mu][a]*G[mu][a];
        }
        w->bound.shortness[mu] = 1/square;
    }
}
