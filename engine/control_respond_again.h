/* The impulses, what they change of P_i, and H_p once more for these. */
static void respond(state_t *w, const real Q[S*N], real momentum[S*N], real L[S*N])
{
    real C[S*N], H_p[N], shared[SHARED];
    constrain(w, L, C);
    for (int e = 0; e < S*N; ++e) {
        momentum[e] += C[e] - w->C[e];
        w->C[e] = C[e];
    }
    for (int i = 0; i < S; ++i) {
        first_rates(&w->constants, Q + i*N, momentum + i*N, H_p, shared);
        for (int a = 0; a < N; ++a)
            L[i*N + a] = w->h*weights[i]*H_p[a];
    }
}
