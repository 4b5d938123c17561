/* H_p and H_q - F of a state. */
static void RUN(rates_of)(const RUN(t) *w, const lanes q[N], const lanes p[N], lanes H_p[N],
    lanes H_q[N])
{
    lanes shared[SHARED];
    first_rates(&w->constants, q, p, H_p, shared);
    second_rates(&w->constants, q, p, &w->t, shared, H_p, H_q);
}
