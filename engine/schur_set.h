/* (h W)^-1 of the run */
static void RUN(set_schur)(RUN(t) *w)
{
    lanes_schur_inverse(&w->constants, w->bound.W_inverse);
    for (int mu = 0; mu < M; ++mu)
        for (int nu = 0; nu < M; ++nu)
            w->bound.W_inverse[mu][nu] *= w->h_inverse;
}
