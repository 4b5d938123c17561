/*
 * Corrects the impulses, so that places that L leads to are on the constraints; C are their forces.
 * w->defect is how far from g = 0 the nodes were before.
 */
static void constrain(state_t *w, const real L[S*N], real C[S*N])
{
    real g[P*M], defect[P*M];
    combine(P, S, N, NULL, 0, &table_nu[0][0], L, w->D);
    w->defect = 0;
    for (int l = 0; l < P; ++l) {
        ON(constraint_increment)(&w->constants, w->q, w->D + l*N, g + l*M);
        for (int mu = 0; mu < M; ++mu) {
            const real rest = g[l*M + mu] += w->g[mu];
            w->defect += rest*rest*w->shortness[mu]*w->q_size;
        }
    }
    combine(P, P, M, NULL, 0, &table_inverse[0][0], g, defect);
    for (int j = 0; j < P; ++j)
        correct(w, j, defect + j*M, w->x + IMPULSE + j*M);
    constraint_forces(w, C);
}
