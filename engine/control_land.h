/* T2: dp, with the impulses, becomes such that p + dp is on the constraint on the momenta at q. */
static void land(const state_t *w, const real q[N], real dp[N])
{
    real G[M][N], pushed[N];
    ON(constraint_jacobian)(&w->constants, q, G);
    total(P, w->Y, pushed);
    for (int a = 0; a < N; ++a)
        dp[a] += pushed[a] + w->p_low[a];
    for (int round = 0; round < ROUNDS; ++round) {
        real f[M], p[N], W[M][M];
        for (int a = 0; a < N; ++a)
            p[a] = w->p[a] + dp[a];
        ON(hidden_constraint)(&w->constants, q, p, f);
        ON(hidden_matrix)(&w->constants, q, p, W);
        factorise(W);
        substitute(W, f);
        for (int mu = 0; mu < M; ++mu)
            for (int a = 0; a < N; ++a)
                dp[a] -= G[mu][a]*f[mu];
    }
}
