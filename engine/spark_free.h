/* Without constraints no force acts at the nodes, and nothing is asked for there. */
static void node_forces(work_t *w, const real q[N], const real x[U])
{
    (void)w, (void)q, (void)x;
}

static inline real less_node_forces(const work_t *w, const real a_tilde[P + 1], int a, real force)
{
    (void)w, (void)a_tilde, (void)a;
    return force;
}

static void node_residuals(work_t *w, const real q[N], real *r)
{
    (void)w, (void)q, (void)r;
}
