/*
 * T2: dp becomes such that p + dp is on the constraint on the momenta at q; w->bound.last are the
 * impulses that bring it there.
 */
INLINE void RUN(land)(RUN(t) *w, const lanes q[N], lanes dp[N])
{
    lanes G[M][N];
    lanes_constraint_jacobian(&w->constants, q, G);
    for (int mu = 0; mu < M; ++mu)
        w->bound.last[mu] = splat(0);
    for (int round = 0; round < ROUNDS; ++round) {
        lanes f[M], p[N];
        schur_t matrix;
        for (int a = 0; a < N; ++a)
            p[a] = w->p[a] + dp[a];
        lanes_hidden_constraint(&w->constants, q, p, f);
        lanes_hidden_matrix(&w->constants, q, p, matrix);
        lanes_factor(matrix);
        lanes_substitute(matrix, f);
        for (int mu = 0; mu < M; ++mu) {
            w->bound.last[mu] += f[mu];
            for (int a = 0; a < N; ++a)
                dp[a] -= G[mu][a]*f[mu];
        }
    }
}
