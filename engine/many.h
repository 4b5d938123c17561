/* ------------------------------------------------------- any number of trajectories, whole runs */

void NAME(integrate_many)(long count, const parameters_t *parameters, const options_t *options,
    INPUT(const real *inputs, long hold, long input_rows,)
    const real *dt, long steps, long every, real *q, real *p, real *q_out, real *p_out,
    report_t *reports, int *status, batch_memory *batch, work_t *work)
{
    const long rows = steps/every, together = options->solver == NEWTON ? 1 : LANES;
    for (long i = 0; i < count; i += together) {
        const rows_t out = { .q = q_out == NULL ? NULL : q_out + i*rows*N,
            .p = p_out == NULL ? NULL : p_out + i*rows*N };
        INPUT(const inputs_t own = { inputs == NULL ? NULL : inputs + i*input_rows*INPUTS,)
            INPUT(hold, input_rows };)
        if (options->solver == NEWTON)
            status[i] = integrate(parameters + i, options, INPUT(
                own,) dt[i], steps, every, q + i*N, p + i*N,
                out, reports + i, work);
        else
            integrate_lanes(count - i < LANES ? (int)(count - i) : LANES, parameters + i, options,
                INPUT(own,)
                dt + i, steps, every, rows, q + i*N, p + i*N, out, reports + i, status + i, batch,
                work);
    }
    TURNED(turn_runs(count, parameters, dt, rows, every, q, p, q_out, p_out, reports));
}
