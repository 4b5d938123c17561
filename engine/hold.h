size_t NAME(work_size)(void)
{
    return sizeof(work_t);
}

const report_t *NAME(report_of)(const work_t *work)
{
    return &work->held.report;
}

void NAME(begin)(work_t *w, const parameters_t *parameters, const options_t *options, real dt,
    const real q[N], const real p[N])
{
    w->held.options = *options;
    w->held.dt = dt;
    w->held.start = start_time(parameters);
    w->held.is_new = 0;
    prepare(parameters, &w->constants);
    TIMED(w->t = w->held.start;)
    begin(w, options, dt, q, p, &w->held.report);
    for (int a = 0; a < N; ++a) {
        w->held.q[a] = q[a];
        w->held.p[a] = p[a];
    }
    TURNED(begin_frame(w, parameters));
}

void NAME(set_parameters)(work_t *w, const parameters_t *parameters)
{
    TIMED(w->t = w->held.start + (real)w->held.report.steps*w->held.dt;)
    const real before = hamiltonian(AT(&w->constants, w->t), w->held.q, w->held.p);
    prepare(parameters, &w->constants);
    w->held.report.energy_start += hamiltonian(AT(&w->constants,
        w->t), w->held.q, w->held.p) - before;
    w->held.is_new = 1;
    TURNED(change_frame(w, parameters));
}

int NAME(advance)(work_t *w, long steps, real q[N], real p[N])
{
    const rows_t none = { 0 };
    INPUT(const inputs_t kept = { 0 };)
    real *old_q = w->held.q, *old_p = w->held.p, jump = 0;
    const int sweeps = w->held.options.solver != NEWTON;
    int moved = 0;
    for (int a = 0; a < N; ++a)
        moved |= !(q[a] == old_q[a]) || !(p[a] == old_p[a]);
    TIMED(w->t = w->held.start + (real)w->held.report.steps*w->held.dt;)
    TIMED(at_time(&w->constants, w->t);)
    if (moved) /* by the caller: that is no error */
        jump = hamiltonian(&w->constants, q, p) - hamiltonian(&w->constants, old_q, old_p);
    w->held.report.energy_start += jump;
    TURNED(into_frame(w, q, p));
    if (sweeps && (moved || w->held.is_new))
        take_over(w, q, p);
    w->held.is_new = 0;
    const int status = run_on(&w->held.options, INPUT(
        kept,) w->held.start, w->held.dt, steps, 1, q, p, none,
        &w->held.report, w);
    TURNED(out_of_frame(w, q, p));
    for (int a = 0; a < N; ++a) {
        old_q[a] = q[a];
        old_p[a] = p[a];
    }
    if (status != OK) {
        w->held.is_new = 1;
        if (sweeps)
            recover(w);
    }
    return status;
}
