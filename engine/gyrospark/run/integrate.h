/* Integration of one trajectory over many steps. */
#ifndef GS_RUN_INTEGRATE_H
#define GS_RUN_INTEGRATE_H

#include "gyrospark/run/record.h"

#if GS_INPUTS
#include "gyrospark/run/inputs.h"
#endif

#if GS_SPLITTING
#include "gyrospark/splitting/run.h"
#elif GS_PROFILE_RUN
#include "gyrospark/profiles/run.h"
#else
#include "gyrospark/run/advance.h"
#endif

/* Output arrays of a run, one row per stored step; each may be NULL. */
typedef struct {
    real *q, *p;
#if !GS_PROFILE_RUN
    real *multipliers;
#endif
    int *iterations;
    real *work;
} rows_t;

/* Stores a row: state, multipliers of the last step, most iterations since the previous row. */
static void store(rows_t out, long row, const real q[N], const real p[N], work_t *w,
    const options_t *options, real forces[ROOM], int most, const report_t *report)
{
    (void)w, (void)options, (void)forces, (void)report; /* in the profile run, and without forces */
#if GS_FIXED_POINT && GS_CONSTRAINED && !GS_PROFILE_RUN
    if (out.multipliers != NULL && !BY_NEWTON(options)) /* Newton's method has stored them */
        SINGLE(multipliers)(&fixed_point_of(w)->solver, 0, forces);
#endif
    for (int a = 0; a < N && out.q != NULL; ++a)
        out.q[row*N + a] = q[a];
    for (int a = 0; a < N && out.p != NULL; ++a)
        out.p[row*N + a] = p[a];
#if !GS_PROFILE_RUN
    for (int l = 0; l < MULTIPLIERS && out.multipliers != NULL; ++l)
        out.multipliers[row*MULTIPLIERS + l] = forces[l];
#endif
    if (out.iterations != NULL)
        out.iterations[row] = most;
    IF_FORCES(if (out.work != NULL))
        IF_FORCES(out.work[row] = report->work;)
}

#if !GS_PROFILE_RUN
int NAME(step)(const parameters_t *parameters, const options_t *options, real dt,
    const real q[N], const real p[N], real q1[N], real p1[N], real multipliers[ROOM],
    int *iterations, work_t *work)
{
    begin_step(work, parameters, dt);
    const int status = single_step(work, options, dt, q, p, q1, p1, multipliers, iterations);
    IF_FRAME(if (status == OK)
        rotate_step(parameters, dt, q1, p1, multipliers);)
    return status;
}
#endif

/* Begins a run: initialises its report, which includes the initial state, and its solver. */
static void begin(work_t *work, const options_t *options, real dt, const real q[N],
    const real p[N], report_t *report)
{
    const report_t nothing = { 0 };
    *report = nothing;
    report->energy_start = hamiltonian(AT(&work->constants, work->t), q, p);
    observe(&work->constants, q, p, report);
#if GS_SPLITTING
    report->recorded = 1;
#endif
    begin_run(work, options, dt, q, p);
}

#if GS_SPLITTING
/* Takes the steps first + 1 to last; returns the number of those whose state is finite. */
static long take_steps(IF_INPUTS(inputs_t inputs,) real start, real dt, long first, long last,
    work_t *w)
{
    flows *s = flows_of(w);
    kept_state kept;
    keep_state(s, &kept);
    for (long n = first; n < last; ++n) {
        IF_INPUTS(set_step_inputs(&w->constants, &inputs, 0, n);)
        step_on(w, start + (real)n*dt);
    }
    if (are_finite(&s->now))
        return last - first;
    restore_state(s, &kept); /* once more, up to the step that fails */
    for (long n = first;; ++n) {
        keep_state(s, &kept);
        IF_INPUTS(set_step_inputs(&w->constants, &inputs, 0, n);)
        step_on(w, start + (real)n*dt);
        if (are_finite(&s->now))
            continue;
        restore_state(s, &kept);
        return n - first;
    }
}

/* Continues a run that began at the time `start` by `steps` steps. */
static int run_on(const options_t *options, IF_INPUTS(
    inputs_t inputs,) real start, real dt, long steps, long every,
    real q[N], real p[N], rows_t out, report_t *report, work_t *work)
{
    const long begun = report->steps, end = begun + steps;
    int status = OK;
    while (status == OK && report->steps < end) {
        const long first = report->steps;
        long last = first + 1; /* the next step that is recorded or stored */
        while (last < end && !is_observed(last) && (last - begun) % every != 0)
            ++last;
        report->steps += take_steps(IF_INPUTS(inputs,) start, dt, first, last, work);
        if (report->steps < last)
            status = NOT_FINITE;
        const int stored = status == OK && (last - begun) % every == 0;
        if (!stored && status == OK && last < end && !is_observed(last))
            continue;
        real none[ROOM];
        get_state(work, q, p, report);
        if (status == OK && is_observed(last)) {
            observe(AT(&work->constants, start + (real)last*dt), q, p, report);
            ++report->recorded;
        }
        if (stored)
            store(out, (last - begun)/every - 1, q, p, work, options, none, 0, report);
    }
    return status;
}
#else
/* Continues a run that began at the time `start` by `steps` steps. */
static int run_on(const options_t *options, IF_INPUTS(
    inputs_t inputs,) real start, real dt, long steps, long every,
    real q[N], real p[N], rows_t out, report_t *report, work_t *work)
{
    int most = 0;
    for (long k = 1; k <= steps; ++k) {
        real forces[ROOM];
        int taken;
        work->t = start + (real)report->steps*dt;
        IF_TIME(work->step = start + (real)(report->steps + 1)*dt - work->t;)
        IF_INPUTS(set_step_inputs(&work->constants, &inputs, 0, report->steps);)
        IF_CLOCK(const real time = q[N - 1];)
        const int status = advance_run(work, options, dt, q, p, forces, &taken, report);
        if (status != OK)
            return status;
        IF_CLOCK(record_time_step(report, q[N - 1] - time);)
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
#endif

/* Integrates from (q, p) in place; the public header documents the arguments. */
static int integrate(const parameters_t *parameters, const options_t *options, IF_INPUTS(
    inputs_t inputs,) real dt, long steps,
    long every, real q[N], real p[N], rows_t out, report_t *report, work_t *work)
{
    prepare(parameters, &work->constants);
    IF_TIME(work->t = start_time(parameters);)
    if (report->steps == 0)
        begin(work, options, dt, q, p, report);
    return run_on(options, IF_INPUTS(
        inputs,) start_time(parameters), dt, steps, every, q, p, out, report, work);
}

#endif
