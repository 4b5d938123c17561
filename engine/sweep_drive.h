INLINE void RUN(count_drive)(RUN(t) *w, lanes done)
{
    lanes total;
    two_sum(w->work, done + w->work_low, &total, &w->work_low);
    w->work = total;
}

/* Adds the impulses times g_t at the nodes 0..P-1: what a drive does through the constraints. */
INLINE void RUN(add_drive)(RUN(t) *w)
{
    const lanes *impulse = w->now.x + RUN(IMPULSE);
    lanes parts[RUN(P)], done;
    RUN(displace)(w, w->now.x, w->now.D);
    for (int j = 0; j < RUN(P); ++j) {
        lanes place[N], rate[M];
        RUN(node)(w, j, place);
        lanes_constraint_rate(LANES_AT(&w->constants, w->t + w->act[j]*w->span), place, rate);
        parts[j] = splat(0);
        for (int mu = 0; mu < M; ++mu)
            parts[j] += impulse[j*M + mu]*rate[mu];
    }
    RUN(total)(P, 1, parts, &done);
    RUN(count_drive)(w, done);
}

/* The same of the last impulse, at the end of the step. */
INLINE void RUN(add_last_drive)(RUN(t) *w)
{
    lanes rate[M], done = splat(0);
    lanes_constraint_rate(&w->constants, w->q, rate);
    for (int mu = 0; mu < M; ++mu)
        done += w->bound.last[mu]*rate[mu];
    RUN(count_drive)(w, done);
}
