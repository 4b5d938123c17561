/* Without forces no work is done. */
static inline void note_work(work_t *w, real dt, const real q[N], const real p[N],
    const real x[U])
{
    (void)w, (void)dt, (void)q, (void)p, (void)x;
}

static inline void count_work(const work_t *w, report_t *report)
{
    (void)w, (void)report;
}

static inline real work_so_far(const report_t *report)
{
    (void)report;
    return 0;
}

static inline void set_work(report_t *report, real work, real low)
{
    (void)report, (void)work, (void)low;
}

static inline void restore_work(report_t *report, real work)
{
    (void)report, (void)work;
}
