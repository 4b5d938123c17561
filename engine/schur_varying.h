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

/* impulse += (h W)^-1 defect at the nodes */
INLINE void RUN(correct)(RUN(t) *w, lanes *defect, lanes *impulse)
{
    lanes_substitute_all(RUN(P), w->now.factor, defect);
    for (int e = 0; e < RUN(P)*M; ++e)
        impulse[e] += w->h_inverse*defect[e];
}

static void RUN(set_schur)(RUN(t) *w)
{
    (void)w;
}
