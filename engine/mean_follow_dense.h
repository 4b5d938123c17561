/* The second half of a sweep: the impulses, both increments corrected, dp from them. */
INLINE void RUN(follow)(RUN(t) *w, lanes *x, lanes *q_change, lanes *p_change)
{
    lanes G[M][N], q_mean[N], p_mean[N], rate[N];
    RUN(means)(w, x, q_mean, p_mean);
    lanes_mean_constraint(&w->constants, q_mean, x, G);
    RUN(constrain)(w, x);
    for (int mu = 0; mu < M; ++mu)
        for (int a = 0; a < N; ++a) {
            const int e = RUN(IMPULSE) + mu;
            const lanes pull = G[mu][a]*(x[e] - w->now.x[e]);
            x[RUN(HAT) + a] -= pull;
            RUN(respond)(w, a, pull, x);
        }
    RUN(move_again)(w, x);
    RUN(kick)(w, x, rate);
    for (int a = 0; a < N; ++a) {
        lanes force = -w->h*rate[a];
        for (int mu = 0; mu < M; ++mu)
            force -= G[mu][a]*x[RUN(IMPULSE) + mu];
        RUN(take)(w, a, force, x, q_change, p_change);
    }
}
