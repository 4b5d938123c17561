/* W = G H_pp G^T at the end of the step, factorised */
INLINE void RUN(factor)(RUN(t) *w)
{
    lanes q[N], p[N];
    for (int a = 0; a < N; ++a) {
        q[a] = w->q[a] + w->now.x[a];
        p[a] = w->p[a] + w->now.x[RUN(HAT) + a];
    }
    lanes_schur(LANES_AT(&w->constants, w->t + w->span), q, p, w->now.factor);
    lanes_factor(w->now.factor);
}

/* impulse += 2 (h W)^-1 g */
INLINE void RUN(correct)(RUN(t) *w, lanes g[M], lanes *impulse)
{
    lanes_substitute(w->now.factor, g);
    for (int mu = 0; mu < M; ++mu)
        impulse[mu] += 2*w->h_inverse*g[mu];
}

static void RUN(set_schur)(RUN(t) *w)
{
    (void)w;
}
