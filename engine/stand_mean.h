/* H_p and H_q - F of a state. */
static void RUN(rates_of)(const RUN(t) *w, const lanes q[N], const lanes p[N], lanes H_p[N],
    lanes H_q[N])
{
    lanes zero[N];
    for (int a = 0; a < N; ++a)
        zero[a] = splat(0);
    lanes_mean_velocity(&w->constants, q, p, zero, zero, H_p);
    lanes_mean_force(&w->constants, q, p, zero, zero, &w->t, H_q);
}
