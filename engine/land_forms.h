/*
 * T2: dp becomes such that p + dp is on the constraint on the momenta at q; w->bound.last are the
 * impulses that bring it there.
 */
INLINE void RUN(land)(RUN(t) *w, const lanes q[N], lanes dp[N])
{
    for (int mu = 0; mu < M; ++mu)
        w->bound.last[mu] = splat(0);
    for (int round = 0; round < ROUNDS; ++round) {
        lanes f[M], p[N], pull[N];
        schur_t matrix;
        for (int a = 0; a < N; ++a)
            p[a] = w->p[a] + dp[a];
        lanes_hidden_constraint(&w->constants, q, p, f);
        lanes_schur(&w->constants, q, p, matrix);
        lanes_factor(matrix);
        lanes_substitute(matrix, f);
        lanes_constraint_force(&w->constants, q, f, pull);
        for (int mu = 0; mu < M; ++mu)
            w->bound.last[mu] += f[mu];
        for (int a = 0; a < N; ++a)
            dp[a] -= pull[a];
    }
}
