/* Adds F.dq, the work of the forces. For a discrete gradient it is what H gains, exactly. */
INLINE void RUN(add_work)(RUN(t) *w)
{
    lanes q_mean[N], p_mean[N], F[N], done = splat(0), total;
    CARRIED(lanes v[N];)
    const lanes t = w->t + (real)0.5*w->h;
    RUN(means)(w, w->now.x, q_mean, p_mean);
    lanes_applied_force(LANES_BETWEEN(&w->constants, w->t, w->span), q_mean, p_mean, &t, F);
    for (int a = 0; a < N; ++a)
        done += F[a]*w->now.x[a];
    CARRIED(lanes_carried(&w->constants, q_mean, v));
    CARRIED(for (int a = 0; a < N; ++a))
        CARRIED(done += w->h*F[a]*v[a]);
    TIMED(done += w->span*lanes_mean_drive(&w->constants, q_mean, p_mean, w->now.x,
        w->now.x + RUN(HAT));)
    TIMED(done += w->span*RUN(drive_of_constraints)(w, q_mean);)
    two_sum(w->work, done + w->work_low, &total, &w->work_low);
    w->work = total;
}
