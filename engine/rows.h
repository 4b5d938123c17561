/* Where a run stores its rows; NULL where they are not wanted. */
typedef struct {
    real *q, *p, *multipliers;
    int *iterations;
    real *work;
} rows_t;

/* A row: the state, what the last step took, and the most iterations since the row before. */
static void store(rows_t out, long row, const real q[N], const real p[N], work_t *w,
    const options_t *options, real forces[ROOM], int most, const report_t *report)
{
    if (out.multipliers != NULL)
        multipliers_of_run(w, options, forces);
    for (int a = 0; a < N && out.q != NULL; ++a)
        out.q[row*N + a] = q[a];
    for (int a = 0; a < N && out.p != NULL; ++a)
        out.p[row*N + a] = p[a];
    for (int l = 0; l < MULTIPLIERS && out.multipliers != NULL; ++l)
        out.multipliers[row*MULTIPLIERS + l] = forces[l];
    if (out.iterations != NULL)
        out.iterations[row] = most;
    if (out.work != NULL)
        out.work[row] = work_so_far(report);
}
