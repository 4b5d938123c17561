/* W is constant where g = 0: there is nothing to factorise, and its inverse multiplies. */
static void begin_sweeps(state_t *w)
{
    (void)w;
}

/* impulse += 2 (h W)^-1 g */
static void correct(const state_t *w, const real g[M], real impulse[M])
{
    for (int mu = 0; mu < M; ++mu)
        for (int nu = 0; nu < M; ++nu)
            impulse[mu] += 2*w->h_inverse*w->constants.W_inverse[mu][nu]*g[nu];
}
