/*
 * The second half of a sweep, Gauss-Seidel: H_pq = 0, and H_q at the new places squares the
 * contraction.
 */
INLINE void RUN(follow)(RUN(t) *w, lanes *Q, lanes *momentum, lanes *L_new,
    lanes (*shared)[SHARED], lanes *q_change, lanes *p_change)
{
    RUN(places)(w, L_new, Q);
    for (int i = 0; i < RUN(S); ++i) {
        lanes H_q[N], H_p[N];
        const lanes t = w->t + w->late[i];
        second_rates(LANES_AT(&w->constants, t), Q + i*N, momentum + i*N, &t, shared[i], H_p, H_q);
        RUN(take)(w, i, L_new + i*N, H_q, q_change, p_change);
    }
}
