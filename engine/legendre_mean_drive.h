/* D_t: H_t at the midpoint */
static inline NUMBER ON(mean_drive)(const HELD *c, const NUMBER qm[N], const NUMBER pm[N],
    const NUMBER dq[N], const NUMBER dp[N])
{
    (void)dq, (void)dp;
    return ON(drive)(c, qm, pm);
}
