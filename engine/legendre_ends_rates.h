/* D_p = (v0 + v1)/2 */
static void lanes_mean_velocity(const lane_constants *c, const lanes qm[N],
    const lanes pm[N], const lanes dq[N], const lanes dp[N], lanes D_p[N])
{
    lanes q1[N], A[MASS], v0[N], v1[N];
    lanes_ends(c, qm, pm, dq, dp, q1, A, v0, v1);
    for (int a = 0; a < N; ++a)
        D_p[a] = (real)0.5*(v0[a] + v1[a]);
}

/* D_q - F = -R between the ends */
static void lanes_mean_force(const lane_constants *c, const lanes qm[N], const lanes pm[N],
    const lanes dq[N], const lanes dp[N], const lanes t[1], lanes D_q[N])
{
    lanes q1[N], A[MASS], v0[N], v1[N];
    lanes_ends(c, qm, pm, dq, dp, q1, A, v0, v1);
    lanes_mean_push(c, qm, dq, v0, v1, t, D_q);
    for (int a = 0; a < N; ++a)
        D_q[a] = -D_q[a];
}
