/* One step of a run: fixed-point iteration or Newton's method. */
#ifndef GS_RUN_ADVANCE_H
#define GS_RUN_ADVANCE_H

#include "gyrospark/newton/step.h"

#if GS_FIXED_POINT
#include "gyrospark/run/objects.h"

#include "gyrospark/fixed_point/fallback.h"
#endif

#if GS_VELOCITY_CONSTRAINTS
#include "gyrospark/velocity_constraints/advance.h"
#else
/* Begins a run at (q, p) with the constants of w. */
static void begin_run(work_t *w, const options_t *options, real dt, const real q[N],
    const real p[N])
{
    (void)w, (void)options, (void)dt, (void)q, (void)p; /* of Newton's method */
#if GS_FIXED_POINT
    if (!BY_NEWTON(options))
        begin_fixed_point(w, dt, q, p);
#endif
}

/* Advances a run by one step, and updates its report. */
static int advance_run(work_t *w, const options_t *options, real dt, real q[N], real p[N],
    real multipliers[ROOM], int *iterations, report_t *report)
{
#if GS_FIXED_POINT
    if (!BY_NEWTON(options)) {
        const int status = advance_fixed_point(w, options, dt, iterations, report);
        if (status != OK)
            return status;
        observe_fixed_point(w, report);
        get_state(w, q, p);
        return OK;
    }
#endif
#if GS_EXACT_ENERGY
    w->energy_target = report->energy_start IF_FORCES(+ report->work);
#endif
    const int status = advance(w, options, dt, q, p, q, p, multipliers, iterations);
    if (status != OK)
        return status;
#if GS_EXACT_ENERGY
    report->energy_waits += w->energy_waits;
#endif
    IF_FORCES(add_work(report, w->work_done);)
    observe(AT(&w->constants, w->t + w->step), q, p, report);
    return OK;
}
#endif

/* A step without history: the result does not depend on earlier calls. */
static int single_step(work_t *w, const options_t *options, real dt, const real q[N],
    const real p[N], real q1[N], real p1[N], real multipliers[ROOM], int *iterations)
{
#if GS_FIXED_POINT
    if (!BY_NEWTON(options)) {
        report_t report = { 0 };
        begin_fixed_point(w, dt, q, p);
        const int status = advance_fixed_point(w, options, dt, iterations, &report);
        if (status == OK) {
            get_state(w, q1, p1);
            IF_CONSTRAINED(SINGLE(multipliers)(&fixed_point_of(w)->solver, 0, multipliers);)
        }
        return status;
    }
#endif
#if GS_EXACT_ENERGY
    w->energy_target = hamiltonian(AT(&w->constants, w->t), q, p);
#endif
    return advance(w, options, dt, q, p, q1, p1, multipliers, iterations);
}

#endif
