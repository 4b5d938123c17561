/* ---------------------------------------------------------------- constraints: G as m rows of n */

/* A criterion of the projections: how much of round-off may be left where nothing shrinks. */
enum { SLACK_OF_PLACE = 2, SLACK_OF_MOMENTUM = 4 };

/* G^T lambda */
static void constraint_force(const constants *c, const real q[N], const real lambda[M],
    real force[N])
{
    real G[M][N];
    constraint_jacobian(c, q, G);
    for (int a = 0; a < N; ++a) {
        force[a] = 0;
        for (int mu = 0; mu < M; ++mu)
            force[a] += G[mu][a]*lambda[mu];
    }
}

/* The largest entry of each row of G. */
static void constraint_reach(const constants *c, const real q[N], real reach[M])
{
    real G[M][N];
    constraint_jacobian(c, q, G);
    for (int mu = 0; mu < M; ++mu)
        reach[mu] = norm(N, G[mu]);
}

/* f <- W^-1 f with W = (df/dp) G^T */
static int solve_momentum(const constants *c, const real q[N], const real p[N], real f[M])
{
    real W[M][M];
    int exponents[M], pivots[M];
    hidden_matrix(c, q, p, W);
    return solve(M, &W[0][0], f, exponents, pivots);
}

/* g <- (G G^T)^-1 g */
static int solve_place(const constants *c, const real q[N], real g[M])
{
    real G[M][N], W[M][M];
    int exponents[M], pivots[M];
    constraint_jacobian(c, q, G);
    for (int mu = 0; mu < M; ++mu)
        for (int nu = 0; nu < M; ++nu) {
            W[mu][nu] = 0;
            for (int a = 0; a < N; ++a)
                W[mu][nu] += G[mu][a]*G[nu][a];
        }
    return solve(M, &W[0][0], g, exponents, pivots);
}
