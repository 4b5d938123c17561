/* The end of one step. */
static void turn_step(const parameters_t *parameters, real dt, real q[N], real p[N],
    real *multipliers)
{
    const frame_t frame = frame_of(parameters);
    turn_state(&frame, dt, 1, q, p);
    turn_multipliers_of(&frame, dt, 1, multipliers);
}

/* Rows of states, every so many steps after the first `before`; NULL where there are none. */
static void turn_rows(const frame_t *frame, real dt, long before, long every, long rows, real *q,
    real *p, real *multipliers)
{
    for (long row = 0; row < rows; ++row) {
        const long k = before + (row + 1)*every;
        turn_state(frame, dt, k, q == NULL ? NULL : q + row*N, p == NULL ? NULL : p + row*N);
        if (multipliers != NULL)
            turn_multipliers_of(frame, dt, k, multipliers + row*MULTIPLIERS);
    }
}

/* Whole runs, up to where they came. */
static void turn_runs(long count, const parameters_t *parameters, const real *dt, long rows,
    long every, real *q, real *p, real *q_out, real *p_out, const report_t *reports)
{
    for (long i = 0; i < count; ++i) {
        const frame_t frame = frame_of(parameters + i);
        const long done = reports[i].steps;
        turn_state(&frame, dt[i], done, q + i*N, p + i*N);
        turn_rows(&frame, dt[i], 0, every, done/every, q_out == NULL ? NULL : q_out + i*rows*N,
            p_out == NULL ? NULL : p_out + i*rows*N, NULL);
    }
}

/* A run goes on in the frame where it was. */
static void enter_frame(const report_t *report, const work_t *work, real q[N], real p[N])
{
    for (int a = 0; a < N && report->steps > 0; ++a) {
        q[a] = work->frame_q[a];
        p[a] = work->frame_p[a];
    }
}

/* It stays there; what the caller sees is turned back. */
static void leave_frame(const parameters_t *parameters, real dt, long before, long every,
    const report_t *report, work_t *work, real q[N], real p[N], real *q_out, real *p_out,
    real *multipliers)
{
    const frame_t frame = frame_of(parameters);
    for (int a = 0; a < N; ++a) {
        work->frame_q[a] = q[a];
        work->frame_p[a] = p[a];
    }
    turn_state(&frame, dt, report->steps, q, p);
    turn_rows(&frame, dt, before, every, (report->steps - before)/every, q_out, p_out,
        multipliers);
}
