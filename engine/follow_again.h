/* The second half of a sweep: H_p once more, for the corrected impulses, and H_q. */
INLINE void RUN(follow)(RUN(t) *w, lanes *Q, lanes *momentum, lanes *L_new,
    lanes (*shared)[SHARED], lanes *q_change, lanes *p_change)
{
    lanes C[RUN(S)*N];
    RUN(constrain)(w, L_new, C);
    for (int i = 0; i < RUN(S); ++i) {
        lanes H_q[N], H_p[N];
        for (int a = 0; a < N; ++a) {
            momentum[i*N + a] += C[i*N + a] - w->now.C[i*N + a];
            w->now.C[i*N + a] = C[i*N + a];
        }
        const lanes t = w->t + w->late[i];
        second_rates(LANES_AT(&w->constants, t), Q + i*N, momentum + i*N, &t, shared[i], H_p, H_q);
        for (int a = 0; a < N; ++a)
            L_new[i*N + a] = w->hb[i]*H_p[a];
        RUN(take)(w, i, L_new + i*N, H_q, q_change, p_change);
    }
}
