/* There is no constraint that a drive could move. */
static real drive_of_nodes(work_t *w, real dt, const real q[N], const real p[N], const real x[U])
{
    (void)w, (void)dt, (void)q, (void)p, (void)x;
    return 0;
}
