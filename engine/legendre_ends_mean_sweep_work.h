/* Adds F.dq, the work of the forces at the mean velocity dq/h. It is what H gains, exactly. */
INLINE void RUN(add_work)(RUN(t) *w)
{
    lanes q_mean[N], p_mean[N], v[N], F[N], done = splat(0), total;
    const lanes t = w->t + (real)0.5*w->h;
    RUN(means)(w, w->now.x, q_mean, p_mean);
    for (int a = 0; a < N; ++a)
        v[a] = w->h_inverse*w->now.x[a];
    lanes_force_of_velocity(LANES_BETWEEN(&w->constants, w->t, w->span), q_mean, v, &t, F);
    for (int a = 0; a < N; ++a)
        done += F[a]*w->now.x[a];
    TIMED(done += w->span*lanes_mean_drive(&w->constants, q_mean, p_mean, w->now.x,
        w->now.x + RUN(HAT));)
    TIMED(done += w->span*RUN(drive_of_constraints)(w, q_mean);)
    two_sum(w->work, done + w->work_low, &total, &w->work_low);
    w->work = total;
}
