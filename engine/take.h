/* New rates of item i take the place of the old ones; the squares of their changes are added up. */
INLINE void RUN(take)(RUN(t) *w, int i, const lanes *L_new, const lanes *H_q, lanes *q_change,
    lanes *p_change)
{
    lanes *L = w->now.x + i*N, *L_hat = w->now.x + RUN(HAT) + i*N;
    lanes dq_square = splat(0), dp_square = splat(0); /* apart: sums wait for one another */
    for (int a = 0; a < N; ++a) {
        const lanes force = -w->hb_hat[i]*H_q[a];
        const lanes dq = L_new[a] - L[a], dp = force - L_hat[a];
        dq_square += dq*dq;
        dp_square += dp*dp;
        L[a] = L_new[a];
        L_hat[a] = force;
    }
    *q_change += dq_square;
    *p_change += dp_square;
}
