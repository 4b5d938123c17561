/* H_pp G^T = c G^T: a pull changes the velocity by c times what it changes the momenta by. */
INLINE void RUN(respond)(const RUN(t) *w, int a, lanes pull, lanes *x)
{
    x[a] -= (real)0.5*w->h*w->bound.correction*pull;
}

INLINE void RUN(move_again)(const RUN(t) *w, lanes *x)
{
    (void)w, (void)x;
}
