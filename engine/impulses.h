/* Multipliers of lane i, from its impulses. */
static void RUN(multipliers)(const RUN(t) *w, int lane, real *multipliers)
{
    const lanes *impulse = w->now.x + RUN(IMPULSE);
    for (int mu = 0; mu < M; ++mu) {
        for (int l = 0; l < P; ++l) {
            const int node = l == 0 ? P - 1 : l - 1, at = lane + node % RUN(PER);
            multipliers[l*M + mu] = part(&impulse[node/RUN(PER)*M + mu], at)
                /(part(&w->h, lane)*tableau.b_tilde[l]);
        }
        multipliers[P*M + mu] = part(&w->bound.last[mu], lane)
            /(part(&w->h, lane)*tableau.b_tilde[P]);
    }
}

/* The impulses of a lane from its multipliers. */
static void RUN(load_impulses)(RUN(t) *w, int lane, const real *multipliers)
{
    lanes *impulse = w->now.x + RUN(IMPULSE);
    for (int mu = 0; mu < M; ++mu)
        for (int l = 0; l < P; ++l) {
            const int node = l == 0 ? P - 1 : l - 1, at = lane + node % RUN(PER);
            set_part(&impulse[node/RUN(PER)*M + mu], at,
                multipliers[l*M + mu]*part(&w->h, lane)*tableau.b_tilde[l]);
        }
}
