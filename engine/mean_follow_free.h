/* Without constraints there is nothing to begin with, to correct, or to look at. */
INLINE void RUN(begin)(RUN(t) *w)
{
    (void)w;
}

INLINE void RUN(factor)(RUN(t) *w)
{
    (void)w;
}

INLINE void RUN(look)(RUN(t) *w)
{
    w->bound.defect = splat(0);
}

static void RUN(set_schur)(RUN(t) *w)
{
    (void)w;
}

static void RUN(multipliers)(const RUN(t) *w, int lane, real *multipliers)
{
    (void)w, (void)lane, (void)multipliers;
}

/* The second half of a sweep: dp from dq. */
INLINE void RUN(follow)(RUN(t) *w, lanes *x, lanes *q_change, lanes *p_change)
{
    lanes rate[N];
    RUN(kick)(w, x, rate);
    for (int a = 0; a < N; ++a)
        RUN(take)(w, a, -w->h*rate[a], x, q_change, p_change);
}
