/* W is constant where g = 0: there is nothing to factorise, and its inverse multiplies. */
INLINE void RUN(factor)(RUN(t) *w)
{
    (void)w;
}

/* impulse += (h W)^-1 defect at the nodes */
INLINE void RUN(correct)(const RUN(t) *w, const lanes *defect, lanes *impulse)
{
    for (int j = 0; j < RUN(P); ++j)
        for (int mu = 0; mu < M; ++mu)
            for (int nu = 0; nu < M; ++nu)
                impulse[j*M + mu] += w->bound.W_inverse[mu][nu]*defect[j*M + nu];
}
