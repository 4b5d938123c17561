/* dr/dx at the mean values of the last residual. */
static void jacobian(work_t *w, real dt, const real q[N], const real p[N], const real x[U],
    real J[U*U])
{
    real D_qq[N][N], D_qp[N][N], D_pq[N][N], D_pp[N][N];
    const real t = w->t + dt/2;
    (void)p;
    mean_jacobian(BETWEEN(&w->constants,
        w->t, w->span), w->q_mean, w->p_mean, x, x + DP, &t, D_qq, D_qp, D_pq, D_pp);
    for (int e = 0; e < U*U; ++e)
        J[e] = 0;
    for (int a = 0; a < N; ++a)
        for (int b = 0; b < N; ++b) {
            const real rate = a == b ? 1/dt : 0;
            J[a*U + b] = rate - D_pq[a][b];
            J[a*U + DP + b] = -D_pp[a][b];
            J[(DP + a)*U + b] = D_qq[a][b];
            J[(DP + a)*U + DP + b] = rate + D_qp[a][b];
        }
    constraint_columns(w, q, x, J);
}
