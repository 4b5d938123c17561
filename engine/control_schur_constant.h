/* From starting values: the nodes Q~_l = q + D_l, D_l = sum_j nu_lj L_j, and the forces there. */
static void begin_sweeps(state_t *w)
{
    combine(P, S, N, NULL, 0, &table_nu[0][0], w->x, w->D);
    constraint_forces(w, w->C);
}

/* impulse += (h W)^-1 defect at node j: W is constant where g = 0. */
static void correct(const state_t *w, int j, const real defect[M], real impulse[M])
{
    (void)j;
    for (int mu = 0; mu < M; ++mu)
        for (int nu = 0; nu < M; ++nu)
            impulse[mu] += w->h_inverse*w->constants.W_inverse[mu][nu]*defect[nu];
}
