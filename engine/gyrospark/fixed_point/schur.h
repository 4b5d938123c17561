/* g and the inverse of h W, W = G H_pp G^T, in a fixed-point iteration with constraints. */

/* Evaluates g at q + q_low, to first order in q_low, and 1/|G_mu|^2 for each row of G. */
INLINE void SOLVER(evaluate_constraints)(SOLVER(t) *w)
{
    SOLVER(constraint_state) *at = &w->constraint_state;
    lanes_constraint(&w->constants, w->q, at->g_rounded);
#if GS_ELEMENTS
    lanes_constraint_change(&w->constants, w->q, w->q_low, at->g, at->row_weight);
    for (int mu = 0; mu < M; ++mu) {
        at->g[mu] += at->g_rounded[mu];
        at->row_weight[mu] = 1/at->row_weight[mu];
    }
#else
    lanes G[M][N];
    lanes_constraint_jacobian(&w->constants, w->q, G);
    for (int mu = 0; mu < M; ++mu) {
        lanes square = splat(LIMIT(MIN));
        at->g[mu] = at->g_rounded[mu];
        for (int a = 0; a < N; ++a) {
            at->g[mu] += G[mu][a]*w->q_low[a];
            square += G[mu][a]*G[mu][a];
        }
        at->row_weight[mu] = 1/square;
    }
#endif
}

#if GS_CONSTANT_SCHUR
/* Computes (h W)^-1 and, where H_pp G^T = c G^T, c. */
static void SOLVER(prepare_schur)(SOLVER(t) *w)
{
    lanes_schur_inverse(&w->constants, w->constraint_state.W_inverse);
    for (int mu = 0; mu < M; ++mu)
        for (int nu = 0; nu < M; ++nu)
            w->constraint_state.W_inverse[mu][nu] *= w->h_inverse;
#if GS_SCALAR_SCHUR
    w->constraint_state.correction = lanes_correction(&w->constants);
#endif
}
#endif
