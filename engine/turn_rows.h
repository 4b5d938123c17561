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
