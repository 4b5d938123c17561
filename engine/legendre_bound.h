/* f = G v, and g_t where time stands in L or g */
static inline void ON(hidden_constraint)(const HELD *c, const NUMBER q[N], const NUMBER p[N],
    NUMBER f[M])
{
    NUMBER A[MASS], v[N], G[M][N];
    TIMED(NUMBER rate[M];)
    ON(factor_mass)(c, q, A);
    ON(velocities)(c, q, p, A, v);
    ON(constraint_jacobian)(c, q, G);
    TIMED(ON(constraint_rate)(c, q, rate);)
    for (int mu = 0; mu < M; ++mu) {
        f[mu] = G[mu][0]*v[0];
        for (int a = 1; a < N; ++a)
            f[mu] += G[mu][a]*v[a];
        TIMED(f[mu] += rate[mu];)
    }
}

/* W = G M^-1 G^T */
static inline void ON(hidden_matrix)(const HELD *c, const NUMBER q[N], const NUMBER p[N],
    NUMBER W[M][M])
{
    NUMBER A[MASS], G[M][N];
    (void)p;
    ON(factor_mass)(c, q, A);
    ON(constraint_jacobian)(c, q, G);
    for (int mu = 0; mu < M; ++mu) {
        NUMBER v[N];
        for (int a = 0; a < N; ++a)
            v[a] = G[mu][a];
        ON(solve_mass)(A, v);
        for (int nu = 0; nu <= mu; ++nu) {
            NUMBER sum = G[nu][0]*v[0];
            for (int a = 1; a < N; ++a)
                sum += G[nu][a]*v[a];
            W[mu][nu] = W[nu][mu] = sum;
        }
    }
}
