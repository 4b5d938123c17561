/* A step of a run with velocity constraints: simplified Newton iteration from extrapolated values. */
#ifndef GS_VELOCITY_CONSTRAINTS_ADVANCE_H
#define GS_VELOCITY_CONSTRAINTS_ADVANCE_H

#include "gyrospark/newton/simplified.h"
#include "gyrospark/run/record.h"

/* Number of backward differences of the unknowns that a run stores. */
enum {
    DIFFERENCES = sizeof(((work_t *)0)->differences)/sizeof(((work_t *)0)->differences[0])
};

/* Discards history and factors: the next step is solved by full Newton, as a step by itself. */
static void begin_history(work_t *w)
{
    w->stored = w->order = w->has_factors = 0;
}

/* x <- polynomial extrapolation of the unknowns, the sum of the first `order` differences */
static void extrapolate(const work_t *w, real x[U])
{
    for (int e = 0; e < U; ++e) {
        x[e] = 0;
        for (int k = w->order - 1; k >= 0; --k)
            x[e] += w->differences[k][e];
    }
}

/*
 * Updates the differences with the solution x. Difference k is the error that extrapolation of
 * order k made in this step; the order with the smallest error is used for the next step.
 */
static void record_unknowns(work_t *w, real dt, const real q[N], const real p[N], const real x[U])
{
    real newest[U], smallest = HUGE_VAL;
    for (int e = 0; e < U; ++e)
        newest[e] = x[e];
    w->order = 1;
    for (int k = 0; ; ++k) {
        const real size = increment_size(w, dt, q, p, x, newest);
        if (k > 0 && size < smallest) {
            smallest = size;
            w->order = k;
        }
        if (k == DIFFERENCES)
            return;
        for (int e = 0; e < U; ++e) {
            const real older = w->differences[k][e];
            w->differences[k][e] = newest[e];
            newest[e] -= older;
        }
        if (k == w->stored) {
            ++w->stored;
            return;
        }
    }
}

static void begin_run(work_t *w, const options_t *options, real dt, const real q[N],
    const real p[N])
{
    (void)options, (void)dt, (void)q, (void)p;
    begin_history(w);
}

/*
 * Solves T1. The factors of J are used over steps and renewed where the contraction is slower than
 * 0.1; full Newton from the Euler start follows where the iteration fails.
 */
static int solve_run(work_t *w, const options_t *options, real dt, const real q[N], const real p[N],
    int *iterations, report_t *report)
{
    int count, status = NOT_CONVERGED;
    *iterations = 0;
    if (options->solver != NEWTON && w->stored > 0) {
        extrapolate(w, w->x);
        status = simplified_newton(w, options, dt, q, p, w->x, iterations);
        report->newton_steps += status != OK;
    }
    if (status != OK) {
        status = newton(w, options, dt, q, p, w->x, &count);
        *iterations += count;
    }
    w->has_factors = status == OK;
    if (status == OK)
        record_unknowns(w, dt, q, p, w->x);
    return status;
}

/* Advances a run by one step, and updates its report. */
static int advance_run(work_t *w, const options_t *options, real dt, real q[N], real p[N],
    real multipliers[ROOM], int *iterations, report_t *report)
{
    real q1[N], p1[N];
    int status = solve_run(w, options, dt, q, p, iterations, report);
    if (status == OK)
        status = finish(w, dt, q, p, w->x, q1, p1, multipliers);
    if (status != OK)
        return status;
    IF_FORCES(w->work_done = step_work(w, dt, q, p, w->x);)
    for (int a = 0; a < N; ++a) {
        q[a] = q1[a];
        p[a] = p1[a];
    }
    IF_FORCES(add_work(report, w->work_done);)
    observe(AT(&w->constants, w->t + w->step), q, p, report);
    return OK;
}

#endif
