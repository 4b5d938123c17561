/* The impulses, and what they change of P_i and L_i: H_pp G^T = c G^T, so of H_p c times that. */
static void respond(state_t *w, const real Q[S*N], real momentum[S*N], real L[S*N])
{
    real C[S*N];
    (void)Q;
    constrain(w, L, C);
    for (int e = 0; e < S*N; ++e) {
        const real more = C[e] - w->C[e];
        momentum[e] += more;
        w->C[e] = C[e];
        L[e] += w->h*weights[e/N]*w->constants.correction*more;
    }
}
