/* T2 has nothing left to solve: the unknowns are the step. */
static int finish(work_t *w, real dt, const real q[N], const real p[N], const real x[U],
    real q1[N], real p1[N], real multipliers[ROOM])
{
    (void)w, (void)dt;
    for (int a = 0; a < N; ++a) {
        q1[a] = q[a] + x[a];
        p1[a] = p[a] + x[DP + a];
    }
    step_multipliers(x, multipliers);
    return isfinite(norm(N, q1) + norm(N, p1)) ? OK : NOT_FINITE;
}
