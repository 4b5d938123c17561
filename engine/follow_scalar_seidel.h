/*
 * The second half of a sweep, Gauss-Seidel: H_pq = 0, and H_q at the new places squares the
 * contraction. H_pp G^T = c G^T: what the corrected impulses change of H_p is c times what they
 * change of the momenta.
 */
INLINE void RUN(follow)(RUN(t) *w, lanes *Q, lanes *momentum, lanes *L_new,
    lanes (*shared)[SHARED], lanes *q_change, lanes *p_change)
{
    lanes C[RUN(S)*N];
    RUN(constrain)(w, L_new, C);
    for (int e = 0; e < RUN(S)*N; ++e)
        L_new[e] += w->hb[e/N]*w->bound.correction*(C[e] - w->now.C[e]);
    RUN(places)(w, L_new, Q);
    for (int i = 0; i < RUN(S); ++i) {
        lanes H_q[N], H_p[N];
        for (int a = 0; a < N; ++a) {
            momentum[i*N + a] += C[i*N + a] - w->now.C[i*N + a];
            w->now.C[i*N + a] = C[i*N + a];
        }
        const lanes t = w->t + w->late[i];
        second_rates(LANES_AT(&w->constants, t), Q + i*N, momentum + i*N, &t, shared[i], H_p, H_q);
        RUN(take)(w, i, L_new + i*N, H_q, q_change, p_change);
    }
}
