/* ------------------------------------------------------------------ a run: Newton at every step */

static void begin_run(work_t *w, const options_t *options, real dt, const real q[N],
    const real p[N])
{
    (void)w, (void)options, (void)dt, (void)q, (void)p;
}

/* One step of a run, counted and observed. */
static int advance_run(work_t *w, const options_t *options, real dt, real q[N], real p[N],
    real multipliers[ROOM], int *iterations, report_t *report)
{
    const int status = advance(w, options, dt, q, p, q, p, multipliers, iterations);
    if (status != OK)
        return status;
    count_work(w, report);
    observe(AT(&w->constants, w->t + w->span), q, p, report);
    return OK;
}

/* The multipliers of the last step are where it has put them. */
static void multipliers_of_run(work_t *w, const options_t *options, real multipliers[ROOM])
{
    (void)w, (void)options, (void)multipliers;
}

static int single_step(work_t *w, const options_t *options, real dt, const real q[N],
    const real p[N], real q1[N], real p1[N], real multipliers[ROOM], int *iterations)
{
    return advance(w, options, dt, q, p, q1, p1, multipliers, iterations);
}
