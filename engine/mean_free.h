/* Without constraints nothing pulls, and no multiplier is found. */
static void constraint_rows(work_t *w, const real q[N], const real x[U], real r[U])
{
    (void)w, (void)q, (void)x, (void)r;
}

static void step_multipliers(const real x[U], real multipliers[ROOM])
{
    (void)x, (void)multipliers;
}
