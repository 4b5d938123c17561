/* The second half of a sweep: the impulses, both increments corrected, dp from them. */
INLINE void RUN(follow)(RUN(t) *w, lanes *x, lanes *q_change, lanes *p_change)
{
    lanes more[M], pull[N], at[N], q_mean[N], p_mean[N], rate[N];
    RUN(means)(w, x, q_mean, p_mean);
    RUN(constrain)(w, x);
    for (int mu = 0; mu < M; ++mu)
        more[mu] = x[RUN(IMPULSE) + mu] - w->now.x[RUN(IMPULSE) + mu];
    lanes_mean_pull(&w->constants, q_mean, x, more, pull);
    for (int a = 0; a < N; ++a)
        x[RUN(HAT) + a] -= pull[a];
    RUN(move_again)(w, x);
    RUN(kick)(w, x, rate);
    RUN(means)(w, x, at, p_mean);
    lanes_mean_pull(&w->constants, at, x, x + RUN(IMPULSE), pull);
    for (int a = 0; a < N; ++a)
        RUN(take)(w, a, -w->h*rate[a] - pull[a], x, q_change, p_change);
}
