/* Without forces H_qp is the transpose of H_pq. */
static inline void rates_by_state(const constants *c, const real q[N], const real p[N],
    const real t[1], real H_qq[N][N], real H_qp[N][N], real H_pq[N][N], real H_pp[N][N])
{
    hessian(c, q, p, t, H_qq, H_pq, H_pp);
    for (int a = 0; a < N; ++a)
        for (int b = 0; b < N; ++b)
            H_qp[a][b] = H_pq[b][a];
}
