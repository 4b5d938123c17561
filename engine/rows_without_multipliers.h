/* Where a run stores its rows; NULL where they are not wanted. */
typedef struct {
    real *q, *p;
    int *iterations;
    real *work;
} rows_t;

/* A row: the state, and the most iterations since the row before. */
static void store(rows_t out, long row, const real q[N], const real p[N], work_t *w,
    const options_t *options, real forces[ROOM], int most, const report_t *report)
{
    (void)w, (void)options, (void)forces;
    for (int a = 0; a < N && out.q != NULL; ++a)
        out.q[row*N + a] = q[a];
    for (int a = 0; a < N && out.p != NULL; ++a)
        out.p[row*N + a] = p[a];
    if (out.iterations != NULL)
        out.iterations[row] = most;
    if (out.work != NULL)
        out.work[row] = work_so_far(report);
}
