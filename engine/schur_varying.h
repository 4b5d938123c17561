/* W = G H_pp G^T at the nodes, factorised */
INLINE void RUN(factor)(RUN(t) *w)
{
    for (int j = 0; j < RUN(P); ++j) {
        lanes place[N];
        RUN(node)(w, j, place);
        lanes_schur(LANES_AT(&w->constants,
            w->t + w->act[j]*w->span), place, w->p, w->now.factor[j]);
        lanes_factor(w->now.factor[j]);
    }
}

/* impulse += (h W)^-1 defect at the nodes of item j */
INLINE void RUN(correct)(RUN(t) *w, int j, lanes *defect, lanes *impulse)
{
    lanes_substitute(w->now.factor[j], defect);
    for (int mu = 0; mu < M; ++mu)
        impulse[mu] += w->h_inverse*defect[mu];
}

static void RUN(set_schur)(RUN(t) *w)
{
    (void)w;
}
