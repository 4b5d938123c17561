/* Adds h sum b_i F(Q_i, P_i, t_i).k_i, the work of the forces. */
INLINE void RUN(add_work)(RUN(t) *w)
{
    const lanes *L = w->now.x;
    lanes Q[RUN(S)*N], momentum[RUN(S)*N], parts[RUN(S)], done, total;
    RUN(places)(w, L, Q);
    RUN(momenta)(w, L + RUN(HAT), momentum);
    for (int i = 0; i < RUN(S); ++i) {
        lanes F[N];
        CARRIED(lanes v[N];)
        const lanes t = w->t + w->late[i];
        lanes_applied_force(LANES_AT(&w->constants, t), Q + i*N, momentum + i*N, &t, F);
        parts[i] = splat(0);
        for (int a = 0; a < N; ++a)
            parts[i] += F[a]*L[i*N + a];
        CARRIED(lanes_carried(&w->constants, Q + i*N, v));
        CARRIED(for (int a = 0; a < N; ++a))
            CARRIED(parts[i] += w->hb[i]*F[a]*v[a]);
        TIMED(parts[i] += w->hb[i]*lanes_drive(&w->constants, Q + i*N, momentum + i*N);)
    }
    RUN(total)(S, 1, parts, &done);
    two_sum(w->work, done + w->work_low, &total, &w->work_low);
    w->work = total;
    TIMED(RUN(add_drive)(w);)
}
