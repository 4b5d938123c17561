/* g at the state, with what rounding left of q, and 1/|G_mu|^2 of each row of G. */
INLINE void RUN(look)(RUN(t) *w)
{
    RUN(bound) *at = &w->bound;
    lanes_constraint(&w->constants, w->q, at->g_rounded);
    lanes_constraint_change(&w->constants, w->q, w->q_low, at->g, at->shortness);
    for (int mu = 0; mu < M; ++mu) {
        at->g[mu] += at->g_rounded[mu];
        at->shortness[mu] = 1/at->shortness[mu];
    }
}
