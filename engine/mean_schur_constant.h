/* W is constant where g = 0: there is nothing to factorise, and its inverse multiplies. */
INLINE void RUN(factor)(RUN(t) *w)
{
    (void)w;
}

/* impulse += 2 (h W)^-1 g */
INLINE void RUN(correct)(const RUN(t) *w, lanes g[M], lanes *impulse)
{
    for (int mu = 0; mu < M; ++mu)
        for (int nu = 0; nu < M; ++nu)
            impulse[mu] += 2*w->bound.W_inverse[mu][nu]*g[nu];
}
