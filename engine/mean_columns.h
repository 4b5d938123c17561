/* What constraints add to the Jacobian. */
static void constraint_columns(work_t *w, const real q[N], const real x[U], real J[U*U])
{
    real K[N][N], q1[N], G[M][N], G1[M][N];
    mean_curvature(&w->constants, w->q_mean, x, x + LAMBDA, K);
    mean_constraint(&w->constants, w->q_mean, x, G);
    for (int a = 0; a < N; ++a)
        q1[a] = q[a] + x[a];
    constraint_jacobian(AT(&w->constants, w->t + w->span), q1, G1);
    for (int a = 0; a < N; ++a) {
        for (int b = 0; b < N; ++b)
            J[(DP + a)*U + b] += K[a][b];
        for (int mu = 0; mu < M; ++mu) {
            J[(DP + a)*U + LAMBDA + mu] = G[mu][a];
            J[(LAMBDA + mu)*U + a] = G1[mu][a];
        }
    }
}
