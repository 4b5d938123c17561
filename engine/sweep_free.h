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

INLINE void RUN(continue_nodes)(const RUN(t) *w, const lanes *values, lanes *through)
{
    (void)w, (void)values, (void)through;
}

static void RUN(set_nodes)(RUN(t) *w)
{
    (void)w;
}

static void RUN(set_schur)(RUN(t) *w)
{
    (void)w;
}

static void RUN(multipliers)(const RUN(t) *w, int lane, real *multipliers)
{
    (void)w, (void)lane, (void)multipliers;
}

static void RUN(load_impulses)(RUN(t) *w, int lane, const real *multipliers)
{
    (void)w, (void)lane, (void)multipliers;
}

/* P_i = p + sum_j mu^_ij L^_j */
INLINE void RUN(momenta)(const RUN(t) *w, const lanes *L_hat, lanes *momentum)
{
    RUN(pushes)(w, w->p, 0, L_hat, momentum);
}

/* dp += what rounding left of the last step */
INLINE void RUN(add_impulses)(const RUN(t) *w, lanes dp[N])
{
    for (int a = 0; a < N; ++a)
        dp[a] += w->p_low[a];
}

INLINE void RUN(land)(RUN(t) *w, const lanes q[N], lanes dp[N])
{
    (void)w, (void)q, (void)dp;
}
