/* What the pulls change of the velocity is found by another look at it. */
INLINE void RUN(respond)(const RUN(t) *w, int a, lanes pull, lanes *x)
{
    (void)w, (void)a, (void)pull, (void)x;
}

INLINE void RUN(move_again)(const RUN(t) *w, lanes *x)
{
    RUN(move)(w, x);
}
