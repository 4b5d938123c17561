/* There is no constraint that a drive could move. */
INLINE void RUN(add_drive)(RUN(t) *w)
{
    (void)w;
}

INLINE void RUN(add_last_drive)(RUN(t) *w)
{
    (void)w;
}
