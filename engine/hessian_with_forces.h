/* H_qq and H_qp are those of H_q - F: H_qp is no transpose. */
static inline void rates_by_state(const constants *c, const real q[N], const real p[N],
    const real t[1], real H_qq[N][N], real H_qp[N][N], real H_pq[N][N], real H_pp[N][N])
{
    hessian(c, q, p, t, H_qq, H_qp, H_pq, H_pp);
}
