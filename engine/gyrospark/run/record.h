/* The report of an integration: energy error, constraint errors, work. */
#ifndef GS_RUN_RECORD_H
#define GS_RUN_RECORD_H

#include "gyrospark/linear_algebra/norms.h"

#if GS_CONSTRAINED || GS_VELOCITY_CONSTRAINTS
#include "gyrospark/constraints/projection.h"
#endif

#if !GS_PROFILE_RUN
/* Sets constants and times for functions of a single step. */
static void begin_step(work_t *work, const parameters_t *parameters, real dt)
{
    (void)dt; /* if the system does not depend on time */
    prepare(parameters, &work->constants);
    work->t = start_time(parameters);
    IF_TIME(work->step = dt;)
#if GS_EXACT_ENERGY
    work->theta[0] = work->theta[1] = 0;
#endif
}

void NAME(hamiltonian)(const parameters_t *parameters, long count, IF_TIME(
    const real *t,) const real *q, const real *p,
    real *H)
{
    constants c;
    prepare(parameters, &c);
    for (long i = 0; i < count; ++i)
        H[i] = hamiltonian(AT(&c, time_of(parameters, t, i)), q + i*N, p + i*N);
}
#endif

#if GS_FORCES && !GS_SPLITTING
#if GS_SPARK
#include "gyrospark/spark/step_end.h"
#else
#include "gyrospark/midpoint/step_end.h"
#endif

/* Adds the work of a step to the report by compensated summation. */
static void add_work(report_t *report, real done)
{
    const real share = done + report->work_low, total = report->work + share;
    const real part = total - report->work;
    report->work_low = (report->work - (total - part)) + (share - part);
    report->work = total;
}

#if !GS_PROFILE_RUN
void NAME(step_work)(const parameters_t *parameters, real dt, const real q[N], const real p[N],
    const real x[U], real work_done[1], work_t *work)
{
    begin_step(work, parameters, dt);
    *work_done = step_work(work, dt, q, p, x);
}
#endif
#endif

#if GS_CLOCK
/* The smallest and the largest step of t; before the first step both are 0. */
static void record_time_step(report_t *report, real step)
{
    const real size = MATH(fabs)(step);
    if (report->steps == 0 || size < report->time_step_min)
        report->time_step_min = size;
    report->time_step_max = larger(size, report->time_step_max);
}
#endif

/* Adds the energy error |H - H_0 - W| of a state with the energy H to the report. */
static void observe_energy(real H, report_t *report)
{
    const real gain = H - report->energy_start;
    const real error = MATH(fabs)(gain IF_FORCES(- report->work));
    report->energy_error_max = larger(error, report->energy_error_max);
    report->energy_error_sum += error;
}

#if GS_CONSTRAINED || GS_VELOCITY_CONSTRAINTS
/* Adds the constraint errors max |g| and max |f| of a state to the report. */
static void observe_constraint_errors(real g_size, real f_size, report_t *report)
{
    report->constraint_max = larger(g_size, report->constraint_max);
    report->constraint_sum += g_size;
    report->hidden_max = larger(f_size, report->hidden_max);
    report->hidden_sum += f_size;
}

#endif

/* Adds the errors of the state (q, p) to the report. */
static void observe(const constants *c, const real q[N], const real p[N], report_t *report)
{
    observe_energy(hamiltonian(c, q, p), report);
#if GS_CONSTRAINED || GS_VELOCITY_CONSTRAINTS
    real g[M + 1] = { 0 }, f[HIDDEN];
    IF_CONSTRAINED(constraint(c, q, g);)
    observed_defect(c, q, p, f);
    observe_constraint_errors(norm(M, g), norm(HIDDEN, f), report);
#endif
}

#endif
