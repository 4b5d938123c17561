/* force += G^T lambda, with G between two states */
static void add_mean_pull(const constants *c, const real qm[N], const real dq[N],
    const real lambda[M], real force[N])
{
    real G[M][N];
    mean_constraint(c, qm, dq, G);
    for (int a = 0; a < N; ++a)
        for (int mu = 0; mu < M; ++mu)
            force[a] += G[mu][a]*lambda[mu];
}
