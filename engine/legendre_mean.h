/* D_q, D_p: the gradient at the midpoint */
static inline void mean_gradient(const constants *c, const real qm[N], const real pm[N],
    const real dq[N], const real dp[N], const real t[1], real D_q[N], real D_p[N])
{
    (void)dq, (void)dp;
    gradient(c, qm, pm, t, D_q, D_p);
}

/* Their derivatives by dq and dp: half of those by the midpoint */
static inline void mean_jacobian(const constants *c, const real qm[N], const real pm[N],
    const real dq[N], const real dp[N], const real t[1], real D_qq[N][N], real D_qp[N][N],
    real D_pq[N][N], real D_pp[N][N])
{
    (void)dq, (void)dp;
    rates_by_state(c, qm, pm, t, D_qq, D_qp, D_pq, D_pp);
    for (int a = 0; a < N; ++a)
        for (int b = 0; b < N; ++b) {
            D_qq[a][b] /= 2;
            D_qp[a][b] /= 2;
            D_pq[a][b] /= 2;
            D_pp[a][b] /= 2;
        }
}
