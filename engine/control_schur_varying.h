/*
 * From starting values: the nodes Q~_l = q + D_l, D_l = sum_j nu_lj L_j, and the forces and factors
 * of W = G H_pp G^T there.
 */
static void begin_sweeps(state_t *w)
{
    combine(P, S, N, NULL, 0, &table_nu[0][0], w->x, w->D);
    constraint_forces(w, w->C);
    for (int j = 0; j < P; ++j) {
        real place[N];
        node(w, j, place);
        schur(&w->constants, place, w->p, w->factors[j]);
        factorise(w->factors[j]);
    }
}

/* impulse += (h W)^-1 defect at node j */
static void correct(state_t *w, int j, real defect[M], real impulse[M])
{
    substitute(w->factors[j], defect);
    for (int mu = 0; mu < M; ++mu)
        impulse[mu] += w->h_inverse*defect[mu];
}
