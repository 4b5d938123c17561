/* Without forces no work is done. */
INLINE void RUN(add_work)(RUN(t) *w)
{
    (void)w;
}
