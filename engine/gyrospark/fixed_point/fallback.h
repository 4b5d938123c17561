/* One step: fixed-point iteration, or Newton's method where it fails or costs more. */
#ifndef GS_FIXED_POINT_FALLBACK_H
#define GS_FIXED_POINT_FALLBACK_H

#include "gyrospark/fixed_point/single.h"
#include "gyrospark/newton/simplified.h"
#include "gyrospark/run/record.h"
#include "gyrospark/tuning.h"

/* -------------------------------- one trajectory: fixed-point iteration, Newton as the fallback */

/* Method of a step: fixed-point iteration with Newton as its fallback, or Newton at once. */
enum { FIXED_POINT_FIRST, NEWTON_FIRST };

/* State of the solver in the work memory of the caller. */
typedef struct {
    SINGLE(t) solver;
    int failures;          /* successive steps without convergence of the iteration */
    int newton_steps_left; /* Newton steps until the next fixed-point iteration */
    int method;            /* FIXED_POINT_FIRST or NEWTON_FIRST */
    int steps;             /* number of steps with this method */
    int retry_after;       /* steps until the other method is tried again */
    real effort[2];        /* mean cost of a step by each method; 0: unknown */
} fixed_point_t;

_Static_assert(sizeof(fixed_point_t) + 64 <= sizeof(((work_t *)0)->memory),
    "work memory is too small");
_Static_assert(_Alignof(fixed_point_t) <= 64, "fixed_point_of aligns to 64 bytes only");

/* The state of the fixed-point iteration in its memory. */
static fixed_point_t *fixed_point_of(work_t *w)
{
    return ALIGNED(w->memory);
}

/* Status of a failed iteration, from its last two changes (squared). */
static int failure_reason(real change, real previous)
{
    return failure_status(MATH(sqrt)(change), previous > 0 ? MATH(sqrt)(change/previous) : 0);
}

/*
 * Not inlined: otherwise compilers hold vectors in registers across iterations, which causes
 * spills.
 */
NOINLINE void iterate_noinline(SINGLE(t) *w)
{
    SINGLE(iterate_once)(w);
}

/* Iterates from the starting values; returns OK, or the status of the failure. */
static int solve_fixed_point(SINGLE(t) *w, const options_t *options, int start,
    int *iteration_count)
{
    const int predicted = start == PREDICTED;
    progress_t progress = initial_progress();
    const real far = FAR_CHANGE;
    convergence_t result;
    int iteration = 0;
    SINGLE(start_iteration)(w, start);
    for (; start == QUARTER_STEP && iteration < SHORT_STEP_ITERATIONS; ++iteration) {
        iterate_noinline(w);
        if (iteration % (SHORT_STEP_ITERATIONS/2) == SHORT_STEP_ITERATIONS/2 - 1)
            SINGLE(start_iteration)(w, FROM_HALF_STEP);
    }
    *iteration_count += iteration;
    iteration = 0;
    do {
        iterate_noinline(w);
        const real change = SINGLE(sum_lanes)(&w->change);
        const real defect = SINGLE(sum_lanes)(&w->constraint_state.defect);
        ++iteration;
        if (needs_round_off_estimate(&progress, change)) {
            SEPARATE(estimate_round_off)(w);
            set_round_off_floor(&progress, 1, SINGLE(sum_lanes)(&w->round_off));
        }
        result = test_convergence(&progress, change, defect, lane_get(&w->step_squared, 0),
            options->tolerance, options->max_iterations, updates_rates(&w->predictor),
            (real *)w->predictor.rate + rate_index(iteration));
        for (int i = 0; i < LANES && predicted && iteration == 1; ++i)
            w->predictor.first[i] = change;
        if (predicted && iteration == 1 && change > far*far)
            result.ended = result.failed = 1; /* the iteration may converge to another root */
        if (!predicted && !result.ended && (iteration == 1 || iteration == 3)) {
            SINGLE(update_scales)(w); /* a state at rest has no scale before its first increment */
            IF_FACTORISED(SINGLE(factorise_schur)(w);)
        }
    } while (!result.ended);
    *iteration_count += iteration;
    return result.failed ? failure_reason(progress.change, progress.previous) : OK;
}

/* Copies the state in the work memory, rounded. */
static void get_state(work_t *w, real q[N], real p[N])
{
    const SINGLE(t) *s = &fixed_point_of(w)->solver;
    for (int a = 0; a < N; ++a) {
        q[a] = lane_get(&s->q[a], 0);
        p[a] = lane_get(&s->p[a], 0);
    }
}

/*
 * Solves the step by Newton's method: simplified Newton from the prediction, and if it fails, full
 * Newton from the rates at the start of the step, as with the solver NEWTON. A poor prediction may
 * lead to another root.
 */
static int solve_by_newton(work_t *w, const options_t *options, real dt, int *iterations)
{
    SINGLE(t) *s = &fixed_point_of(w)->solver;
    real q[N], p[N];
    int count, status = NOT_CONVERGED;
    get_state(w, q, p);
    if (s->predictor.count > 0) {
        SINGLE(start_iteration)(s, PREDICTED);
        SINGLE(get_unknowns)(s, w->x);
        status = simplified_newton(w, options, dt, q, p, w->x, &count);
        *iterations += count;
    }
    if (status != OK) {
        status = newton(w, options, dt, q, p, w->x, &count);
        *iterations += count;
    }
    if (status != OK)
        return status;
    SINGLE(set_unknowns)(s, 0, w->x);
    IF_CONSTRAINED(SINGLE(begin_iteration)(s);)
    return OK;
}

/*
 * Selects the method with the smaller mean cost of a step. The cost of a Newton step is assumed to
 * be NEWTON_RESIDUALS residuals and a Jacobian until it is measured. The intervals between retries
 * of the other method double.
 */
static void choose_method(fixed_point_t *f, long effort)
{
    real *mean = &f->effort[f->method];
    *mean = *mean > 0 ? *mean + ((real)effort - *mean)/EFFORT_MEMORY : (real)effort;
    if (++f->steps < (f->solver.predictor.fitted ? FITTED_TRIAL_STEPS : TRIAL_STEPS))
        return;
    const real other = f->method == FIXED_POINT_FIRST && !(f->effort[NEWTON_FIRST] > 0)
        ? NEWTON_RESIDUALS*RESIDUAL_COST + JACOBIAN_COST : f->effort[!f->method];
    const int retry = f->steps >= f->retry_after;
    if (*mean > SWITCH_RATIO*other || (f->method == NEWTON_FIRST && retry)) {
        f->method = !f->method;
        f->steps = 0;
        f->effort[f->method] = 0;
        if (f->retry_after < MAX_RETRY)
            f->retry_after *= 2;
    } else if (retry) { /* an old measurement of Newton is discarded */
        f->effort[NEWTON_FIRST] = 0;
        f->steps = 0;
    }
}

/*
 * One step of the state in the work memory: fixed-point iteration, or Newton where the iteration
 * fails or costs more.
 */
static int advance_fixed_point(work_t *w, const options_t *options, real dt, int *iterations,
    report_t *report)
{
    fixed_point_t *f = fixed_point_of(w);
    *iterations = 0;
    w->effort = 0;
    f->solver.t = splat(w->t);
    IF_INPUTS(for (int i = 0; i < LANES; ++i))
        IF_INPUTS(lanes_set_inputs(&f->solver.constants, i, &w->constants);)
    IF_TIME(f->solver.step = splat(w->step);)
    const int predicted = f->solver.predictor.count > 0,
        only_fixed_point = options->solver == FIXED_POINT;
    const int iterates = only_fixed_point
        || (f->method == FIXED_POINT_FIRST && f->newton_steps_left == 0);
    int status = NOT_CONVERGED;
    if (iterates && predicted)
        status = solve_fixed_point(&f->solver, options, PREDICTED, iterations);
    if (iterates && status != OK)
        status = solve_fixed_point(&f->solver, options, EULER, iterations);
#if GS_SPARK
    if (iterates && status != OK && !predicted
        && solve_fixed_point(&f->solver, options, QUARTER_STEP, iterations) == OK)
        status = OK;
#endif
    const long iteration_count = *iterations;
    if (status != OK) {
        if (!only_fixed_point)
            status = solve_by_newton(w, options, dt, iterations);
        if (status != OK)
            return status;
        ++report->newton_steps;
        if (f->newton_steps_left > 0)
            --f->newton_steps_left;
        else if (iterates)
            f->newton_steps_left = (1 << (f->failures < MAX_BACKOFF ? f->failures++
                : MAX_BACKOFF)) - 1;
    } else
        f->failures = 0;
    choose_method(f, iteration_count*ITERATION_COST + w->effort);
    SINGLE(t) *s = &f->solver;
    IF_CLOCK(if (!SINGLE(time_advances)(s, 0))
        return TIME_STOPPED;)
    SEPARATE(record_step)(s);
    SINGLE(finish)(s);
    real size = 0;
    for (int a = 0; a < N; ++a)
        size += lane_get(&s->q[a], 0) + lane_get(&s->p[a], 0);
    return isfinite(size) ? OK : NOT_FINITE;
}

/* Begins a run at (q, p) with the constants of w: no history, no work, fixed point first. */
static void begin_fixed_point(work_t *w, real dt, const real q[N], const real p[N])
{
    fixed_point_t *f = fixed_point_of(w);
    f->failures = f->newton_steps_left = f->method = f->steps = 0;
    f->retry_after = FIRST_RETRY;
    f->effort[FIXED_POINT_FIRST] = f->effort[NEWTON_FIRST] = 0;
    f->solver.constants._used = SINGLE(used_lanes)();
    for (int i = 0; i < LANES; ++i)
        SINGLE(prepare)(&f->solver, i, &w->constants, dt);
    for (int a = 0; a < N; ++a) {
        f->solver.q[a] = splat(q[a]);
        f->solver.p[a] = splat(p[a]);
    }
    IF_TIME(f->solver.t = splat(w->t);)
    SEPARATE(initialise)(&f->solver);
}

/* Updates the report with the errors of the state in the work memory, as observe does. */
static void observe_fixed_point(work_t *w, report_t *report)
{
    SINGLE(t) *s = &fixed_point_of(w)->solver;
    const lanes H = lanes_hamiltonian(&s->constants, s->q, s->p);
    IF_FORCES(report->work = lane_get(&s->work, 0);)
    IF_FORCES(report->work_low = lane_get(&s->work_low, 0);)
    observe_energy(lane_get(&H, 0), report);
    IF_CONSTRAINED(SINGLE(observe_constraint_errors)(s, report);)
}

#endif
