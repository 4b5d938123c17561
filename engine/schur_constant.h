/* W is constant where g = 0: there is nothing to factorise, and its inverse multiplies. */
INLINE void RUN(factor)(RUN(t) *w)
{
    (void)w;
}

/* impulse += (h W)^-1 defect at the nodes of item j */
INLINE void RUN(correct)(const RUN(t) *w, int j, lanes *defect, lanes *impulse)
{
    (void)j;
    for (int mu = 0; mu < M; ++mu)
        for (int nu = 0; nu < M; ++nu)
            impulse[mu] += w->bound.W_inverse[mu][nu]*defect[nu];
}
