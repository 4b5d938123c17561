/* force += G^T lambda, with G between two states */
static void add_mean_pull(const constants *c, const real qm[N], const real dq[N],
    const real lambda[M], real force[N])
{
    real pull[N];
    mean_pull(c, qm, dq, lambda, pull);
    for (int a = 0; a < N; ++a)
        force[a] += pull[a];
}
