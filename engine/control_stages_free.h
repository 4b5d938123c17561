/* C_i = p: no impulses change the momenta. */
static void begin_sweeps(state_t *w)
{
    for (int e = 0; e < S*N; ++e)
        w->C[e] = w->p[e % N];
}

static void respond(state_t *w, const real Q[S*N], real momentum[S*N], real L[S*N])
{
    (void)w, (void)Q, (void)momentum, (void)L;
}

static void land(const state_t *w, const real q[N], real dp[N])
{
    (void)q;
    for (int a = 0; a < N; ++a)
        dp[a] += w->p_low[a];
}
