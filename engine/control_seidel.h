/* H_pq = 0: H_q at the places just found squares the contraction (Gauss-Seidel). */
static void follow(const state_t *w, const real L[S*N], real Q[S*N])
{
    combine(S, S, N, w->q, 0, &table_mu[0][0], L, Q);
}
