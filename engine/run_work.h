/* The work of the step that sweeps have just done, from their unknowns. */
static void note_sweeps(work_t *w, const real q[N], const real p[N])
{
    unscale(&w->state, w->x);
    note_work(w, w->state.h, q, p, w->x);
}
