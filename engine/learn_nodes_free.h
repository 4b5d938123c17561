/* Without constraints there are no multipliers to learn of. */
static void RUN(learn_nodes)(const RUN(t) *w, const lesson_t *l, int track)
{
    (void)w, (void)l, (void)track;
}

INLINE void RUN(nodes_ahead)(const RUN(t) *w, const lanes *x)
{
    (void)w, (void)x;
}
