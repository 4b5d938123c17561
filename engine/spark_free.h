/* Without constraints no force acts at the nodes, and nothing is asked for there. */
enum { ACTING = 0 };

static void node_forces(work_t *w, const real q[N], const real x[U])
{
    (void)w, (void)q, (void)x;
}

static void node_residuals(work_t *w, const real q[N], real *r)
{
    (void)w, (void)q, (void)r;
}
