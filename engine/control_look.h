/* g at the state, with what rounding left of q, and 1/|G_mu|^2 of each row of G. */
static void look(state_t *w)
{
    real G[M][N];
    ON(constraint)(&w->constants, w->q, w->g);
    ON(constraint_jacobian)(&w->constants, w->q, G);
    for (int mu = 0; mu < M; ++mu) {
        real square = LIMIT(MIN);
        for (int a = 0; a < N; ++a) {
            w->g[mu] += G[mu][a]*w->q_low[a];
            square += G[mu][a]*G[mu][a];
        }
        w->shortness[mu] = 1/square;
    }
}
