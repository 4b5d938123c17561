/* D_t between the ends */
static inline NUMBER ON(mean_drive)(const HELD *c, const NUMBER qm[N], const NUMBER pm[N],
    const NUMBER dq[N], const NUMBER dp[N])
{
    NUMBER q1[N], A[MASS], v0[N], v1[N];
    ON(ends)(c, qm, pm, dq, dp, q1, A, v0, v1);
    return ON(mean_drive_of_velocities)(c, qm, dq, v0, v1);
}
