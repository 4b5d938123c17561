/* There is no constraint that a drive could move. */
static real drive_of_constraints(work_t *w, const real x[U])
{
    (void)w, (void)x;
    return 0;
}
