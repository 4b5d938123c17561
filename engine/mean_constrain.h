INLINE void RUN(begin)(RUN(t) *w)
{
    RUN(factor)(w);
}

/*
 * Corrects the impulses, so that the end is on the constraints; w->bound.defect is how far from
 * g = 0 it was before.
 */
INLINE void RUN(constrain)(RUN(t) *w, lanes *x)
{
    lanes g[M];
    lanes_constraint_increment(&w->constants, w->q, x, g);
    w->bound.defect = splat(0);
    for (int mu = 0; mu < M; ++mu) {
        g[mu] += w->bound.g[mu];
        w->bound.defect += g[mu]*g[mu]*w->bound.shortness[mu];
    }
    w->bound.defect *= w->q_size;
    RUN(correct)(w, g, x + RUN(IMPULSE));
}

/* The multipliers of lane i, from its impulses. */
static void RUN(multipliers)(const RUN(t) *w, int lane, real *multipliers)
{
    for (int mu = 0; mu < M; ++mu)
        multipliers[mu] = part(&w->now.x[RUN(IMPULSE) + mu], lane)/part(&w->h, lane);
}
