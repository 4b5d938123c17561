/*
 * The second half of a sweep. H_pp G^T = c G^T: what the corrected impulses change of H_p is c
 * times what they change of the momenta.
 */
INLINE void RUN(follow)(RUN(t) *w, lanes *Q, lanes *momentum, lanes *L_new,
    lanes (*shared)[SHARED], lanes *q_change, lanes *p_change)
{
    lanes C[RUN(S)*N];
    RUN(constrain)(w, L_new, C);
    for (int i = 0; i < RUN(S); ++i) {
        lanes H_q[N], H_p[N], P[N], L[N]; /* kept in registers: stores take longer than sums */
        const lanes pull = w->hb[i]*w->bound.correction;
        for (int a = 0; a < N; ++a) {
            const lanes more = C[i*N + a] - w->now.C[i*N + a];
            P[a] = momentum[i*N + a] + more;
            w->now.C[i*N + a] = C[i*N + a];
            L[a] = L_new[i*N + a] + pull*more;
        }
        const lanes t = w->t + w->late[i];
        second_rates(LANES_AT(&w->constants, t), Q + i*N, P, &t, shared[i], H_p, H_q);
        RUN(take)(w, i, L, H_q, q_change, p_change);
    }
}
