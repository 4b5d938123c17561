/* A run begins: its record, in which the start counts once, and what its steps keep. */
static void begin(work_t *work, const options_t *options, real dt, const real q[N],
    const real p[N], report_t *report)
{
    const report_t nothing = { 0 };
    *report = nothing;
    report->energy_start = hamiltonian(AT(&work->constants, work->t), q, p);
    observe(&work->constants, q, p, report);
    begin_run(work, options, dt, q, p);
}

/* Steps of a run that has begun at the time `start`. */
static int run_on(const options_t *options, INPUT(
    inputs_t inputs,) real start, real dt, long steps, long every,
    real q[N], real p[N], rows_t out, report_t *report, work_t *work)
{
    int most = 0;
    for (long k = 1; k <= steps; ++k) {
        real forces[ROOM];
        int taken;
        work->t = start + (real)report->steps*dt;
        TIMED(work->span = start + (real)(report->steps + 1)*dt - work->t;)
        INPUT(take_inputs(&work->constants, &inputs, 0, report->steps);)
        const int status = advance_run(work, options, dt, q, p, forces, &taken, report);
        if (status != OK)
            return status;
        ++report->steps;
        report->iterations += taken;
        if (taken > report->iterations_max)
            report->iterations_max = taken;
        if (taken > most)
            most = taken;
        if (k % every != 0)
            continue;
        store(out, k/every - 1, q, p, work, options, forces, most, report);
        most = 0;
    }
    return OK;
}

/* Steps from the state (q, p), which becomes the end; see the header. */
static int integrate(const parameters_t *parameters, const options_t *options, INPUT(
    inputs_t inputs,) real dt, long steps,
    long every, real q[N], real p[N], rows_t out, report_t *report, work_t *work)
{
    prepare(parameters, &work->constants);
    TIMED(work->t = start_time(parameters);)
    if (report->steps == 0)
        begin(work, options, dt, q, p, report);
    return run_on(options, INPUT(
        inputs,) start_time(parameters), dt, steps, every, q, p, out, report, work);
}
