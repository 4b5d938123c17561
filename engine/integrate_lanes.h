static void observe_lanes(batch_t *b)
{
    MANY(t) *run = &b->run;
    const lanes error = lanes_size(lanes_hamiltonian(&run->constants, run->q, run->p)
        - b->energy_start - run->work);
    b->energy_error_max = lanes_larger(error, b->energy_error_max);
    b->energy_error_sum += error;
    observe_lane_defects(b);
}

/* The record of a lane, between memory and report. */
static void write_report(const batch_t *b, int lane, report_t *report)
{
    set_work(report, part(&b->run.work, lane), part(&b->run.work_low, lane));
    report->energy_error_max = part(&b->energy_error_max, lane);
    report->energy_error_sum = part(&b->energy_error_sum, lane);
    report->constraint_max = part(&b->g_max, lane);
    report->constraint_sum = part(&b->g_sum, lane);
    report->hidden_max = part(&b->f_max, lane);
    report->hidden_sum = part(&b->f_sum, lane);
}

/* State and record of a lane, for the caller. */
static void keep_state(const batch_t *b, int lane, const lanes *from_q, const lanes *from_p,
    real *q, real *p, report_t *report)
{
    write_report(b, lane, report);
    for (int a = 0; a < N; ++a) {
        q[lane*N + a] = part(&from_q[a], lane);
        p[lane*N + a] = part(&from_p[a], lane);
    }
}

static int is_finite_lane(const MANY(t) *run, int lane)
{
    real size = 0;
    for (int a = 0; a < N; ++a)
        size += part(&run->q[a], lane) + part(&run->p[a], lane);
    return isfinite(size);
}

/* Lanes beyond the last trajectory repeat the first: they cost nothing and disturb nobody. */
static void begin_batch(batch_t *b, int count, const parameters_t *parameters, const real *dt,
    const real *q, const real *p)
{
    b->run.constants._used = count < LANES ? count : LANES;
    for (int i = 0; i < LANES; ++i) {
        const int from = i < count ? i : 0;
        constants c;
        prepare(&parameters[from], &c);
        MANY(prepare)(&b->run, i, &c, dt[from]);
        set_part(&b->start, i, start_time(&parameters[from]));
        for (int a = 0; a < N; ++a) {
            set_part(&b->run.q[a], i, q[from*N + a]);
            set_part(&b->run.p[a], i, p[from*N + a]);
        }
    }
    TIMED(b->run.t = b->start;)
    MANY(set_up)(&b->run);
    b->done = 0;
    b->energy_start = lanes_hamiltonian(&b->run.constants, b->run.q, b->run.p);
    b->energy_error_max = b->energy_error_sum = splat(0);
    b->g_max = b->g_sum = b->f_max = b->f_sum = splat(0);
    observe_lanes(b);
}

int NAME(lanes)(void)
{
    return LANES;
}

static void integrate_lanes(int count, const parameters_t *parameters, const options_t *options,
    INPUT(inputs_t inputs,)
    const real *dt, long steps, long every, long rows, real *q, real *p, rows_t out,
    report_t *reports, int *status, batch_memory *batch, work_t *work)
{
    batch_t *b = batch_of(batch);
    MANY(t) *run = &b->run;
    int alive[LANES], most[LANES] = { 0 }, living = 0;
    if (count <= 0)
        return;
    if (reports[0].steps == 0 && status[0] == OK) {
        begin_batch(b, count, parameters, dt, q, p);
        for (int i = 0; i < count; ++i) {
            reports[i].energy_start = part(&b->energy_start, i);
            write_report(b, i, &reports[i]);
        }
    }
    for (int i = 0; i < LANES; ++i) {
        alive[i] = i < count && status[i] == OK;
        living += alive[i];
    }
    for (long k = 1; k <= steps && living > 0; ++k) {
        int lost[LANES], taken[LANES] = { 0 };
        INPUT(take_lane_inputs(b, &inputs, count);)
        run->t = b->start + (real)b->done++*run->h;
        TIMED(run->span = b->start + (real)b->done*run->h - run->t;)
        sweep_lanes(b, options, alive, lost, taken);
        for (int i = 0; i < LANES; ++i) {
            if (!lost[i])
                continue;
            if (options->solver != FIXED_POINT) {
                lost[i] = rescue(b, options, i, &taken[i], work);
                reports[i].newton_steps += lost[i] == OK;
            }
            if (lost[i] != OK) {
                status[i] = lost[i];
                alive[i] = 0;
                --living;
                keep_state(b, i, run->q, run->p, q, p, &reports[i]);
            }
        }
        lanes q_before[N], p_before[N];
        for (int a = 0; a < N; ++a) {
            q_before[a] = run->q[a];
            p_before[a] = run->p[a];
        }
        const lanes work_before = run->work;
        MANY(remember)(run);
        MANY(finish)(run);
        for (int i = 0; i < count; ++i)
            if (alive[i] && !is_finite_lane(run, i)) {
                status[i] = NOT_FINITE;
                alive[i] = 0;
                --living;
                keep_state(b, i, q_before, p_before, q, p, &reports[i]);
                restore_work(&reports[i], part(&work_before, i));
            }
        observe_lanes(b);
        for (int i = 0; i < count; ++i) {
            if (!alive[i])
                continue;
            report_t *report = &reports[i];
            ++report->steps;
            report->iterations += taken[i];
            if (taken[i] > report->iterations_max)
                report->iterations_max = taken[i];
            if (taken[i] > most[i])
                most[i] = taken[i];
            if (k == steps)
                keep_state(b, i, run->q, run->p, q, p, report);
            if (k % every != 0)
                continue;
            const long row = i*rows + k/every - 1;
            for (int a = 0; a < N && out.q != NULL; ++a)
                out.q[row*N + a] = part(&run->q[a], i);
            for (int a = 0; a < N && out.p != NULL; ++a)
                out.p[row*N + a] = part(&run->p[a], i);
            if (MULTIPLIERS > 0 && out.multipliers != NULL)
                MANY(multipliers)(run, i, out.multipliers + row*MULTIPLIERS);
            if (out.iterations != NULL)
                out.iterations[row] = most[i];
            if (out.work != NULL)
                out.work[row] = part(&run->work, i);
            most[i] = 0;
        }
    }
}
