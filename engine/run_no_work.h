/* Without forces no work is done. */
static void note_sweeps(work_t *w, const real q[N], const real p[N])
{
    (void)w, (void)q, (void)p;
}
