/* The place of the node where impulse l acts: of the last it is the start of the step. */
static void node(const state_t *w, int l, real place[N])
{
    for (int a = 0; a < N; ++a)
        place[a] = w->q[a] + (l < P - 1 ? w->D[l*N + a] : 0);
}

/* C_i = p + sum_j nu~_ij Y_j with Y_j = -G(Q~_j)^T (impulse j) */
static void constraint_forces(state_t *w, real C[S*N])
{
    for (int j = 0; j < P; ++j) {
        const real *impulse = w->x + IMPULSE + j*M;
        real place[N], G[M][N];
        node(w, j, place);
        ON(constraint_jacobian)(&w->constants, place, G);
        for (int a = 0; a < N; ++a) {
            w->Y[j*N + a] = 0;
            for (int mu = 0; mu < M; ++mu)
                w->Y[j*N + a] -= G[mu][a]*impulse[mu];
        }
    }
    combine(S, P, N, w->p, 0, &table_nu_tilde[0][0], w->Y, C);
}
