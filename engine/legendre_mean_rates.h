/* D_p = v at the midpoint */
static inline void lanes_mean_velocity(const lane_constants *c, const lanes qm[N],
    const lanes pm[N], const lanes dq[N], const lanes dp[N], lanes D_p[N])
{
    lanes A[MASS];
    (void)dq, (void)dp;
    lanes_factor_mass(c, qm, A);
    lanes_velocities(c, qm, pm, A, D_p);
}

/* D_q - F = -R(q, v, t) at the midpoint */
static void lanes_mean_force(const lane_constants *c, const lanes qm[N], const lanes pm[N],
    const lanes dq[N], const lanes dp[N], const lanes t[1], lanes D_q[N])
{
    lanes v[N];
    lanes_mean_velocity(c, qm, pm, dq, dp, v);
    lanes_push(c, qm, v, t, D_q);
    for (int a = 0; a < N; ++a)
        D_q[a] = -D_q[a];
}
