/* Adds the work of a step to the record, in a compensated sum. */
static void add_work(report_t *report, real done)
{
    const real share = done + report->work_low, total = report->work + share;
    const real part = total - report->work;
    report->work_low = (report->work - (total - part)) + (share - part);
    report->work = total;
}

/* The work of the step with the unknowns x is kept until the step is counted. */
static void note_work(work_t *w, real dt, const real q[N], const real p[N], const real x[U])
{
    w->work_done = step_work(w, dt, q, p, x);
}

static void count_work(const work_t *w, report_t *report)
{
    add_work(report, w->work_done);
}

/* What the forces have done since the start. */
static inline real work_so_far(const report_t *report)
{
    return report->work;
}

/* The record's work is what lanes have summed up. */
static inline void set_work(report_t *report, real work, real low)
{
    report->work = work;
    report->work_low = low;
}

/* Takes back the work of a step that came to nothing. */
static inline void restore_work(report_t *report, real work)
{
    report->work = work;
}

void NAME(step_work)(const parameters_t *parameters, real dt, const real q[N], const real p[N],
    const real x[U], real work_done[1], work_t *work)
{
    prepare(parameters, &work->constants);
    work->t = start_time(parameters);
    TIMED(work->span = dt;)
    *work_done = step_work(work, dt, q, p, x);
}
