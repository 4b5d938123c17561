/* A step by fixed-point iteration, with Newton's method where it fails or costs more. */
#ifndef GS_FIXED_POINT_FALLBACK_H
#define GS_FIXED_POINT_FALLBACK_H

#include "gyrospark/fixed_point/single.h"
#include "gyrospark/newton/simplified.h"
#include "gyrospark/run/record.h"

/* --------------------------------------------------- one trajectory: sweeps, Newton behind them */

/* Two ways to take a step: sweeps first, Newton if they fail; or Newton at once. */
enum { SWEEPS_FIRST, NEWTON_FIRST };

/* What a caller's work memory holds of the fast path. */
typedef struct {
    SINGLE(t) run;
    int failures; /* steps in a row whose sweeps gave up */
    int wait;     /* steps to take with Newton before sweeping again */
    int way;      /* SWEEPS_FIRST or NEWTON_FIRST */
    int steps;    /* done in this way */
    int patience; /* steps until the other way is tried again */
    real effort[2]; /* of a step, lately, in either way; 0 where that is not known */
} fast_t;

_Static_assert(sizeof(fast_t) + 64 <= sizeof(((work_t *)0)->memory), "work memory is too small");

static fast_t *fast_of(work_t *w)
{
    return (fast_t *)(((size_t)w->memory + 63) & ~(size_t)63);
}

/* Why sweeps were given up after a change and the one before, squares. */
static int why(real change, real before)
{
    return failure(MATH(sqrt)(change), before > 0 ? MATH(sqrt)(change/before) : 0);
}

/* Apart from its loop: else compilers carry vectors from one sweep to the next, and spill them. */
NOINLINE void sweep_once(SINGLE(t) *w)
{
    SINGLE(sweep)(w);
}

/* Sweeps from the starting values until they have converged: OK, or why they have not. */
static int sweep(SINGLE(t) *w, const options_t *options, int predicted, int *sweeps)
{
    progress_t progress = start_of_sweeps();
    const real far = (real)0.02;
    verdict_t verdict;
    int round = 0;
    SINGLE(start)(w, predicted);
    do {
        sweep_once(w);
        const real change = SINGLE(of_lanes)(&w->change);
        const real defect = SINGLE(of_lanes)(&w->bound.defect);
        ++round;
        if (calls_for_look(&progress, change)) {
            SEPARATE(noise)(w);
            look(&progress, 1, SINGLE(of_lanes)(&w->noise));
        }
        verdict = judge(&progress, change, defect, part(&w->moved, 0), options->tolerance,
            options->max_iterations, watches_rates(&w->predictor),
            (real *)w->predictor.rate + rate_of(round));
        for (int i = 0; i < LANES && predicted && round == 1; ++i)
            w->predictor.first[i] = change;
        if (predicted && round == 1 && change > far*far)
            verdict.ended = verdict.failed = 1; /* a far prediction may lead to another root */
        if (!predicted && !verdict.ended && (round == 1 || round == 3)) {
            SINGLE(sizes)(w); /* what is at rest has none before it moves */
            SINGLE(factor)(w);
        }
    } while (!verdict.ended);
    *sweeps += round;
    return verdict.failed ? why(progress.change, progress.before) : OK;
}

/*
 * The step's unknowns by Newton: from the prediction if that is close, else in full from the rates
 * at the start of the step, as solver NEWTON does: a far prediction may lead to another root.
 */
static int solve_by_newton(work_t *w, const options_t *options, real dt, int *iterations)
{
    SINGLE(t) *s = &fast_of(w)->run;
    real q[N], p[N];
    int taken, status = NOT_CONVERGED;
    for (int a = 0; a < N; ++a) {
        q[a] = part(&s->q[a], 0);
        p[a] = part(&s->p[a], 0);
    }
    if (s->predictor.count > 0) {
        SINGLE(start)(s, 1);
        SINGLE(unscale)(s, w->x);
        status = simplified_newton(w, options, dt, q, p, w->x, &taken);
        *iterations += taken;
    }
    if (status != OK) {
        status = newton(w, options, dt, q, p, w->x, &taken);
        *iterations += taken;
    }
    if (status != OK)
        return status;
    SINGLE(load)(s, 0, w->x);
    SINGLE(begin)(s);
    return OK;
}

/*
 * Chooses the way that costs less, from what steps cost lately. What Newton costs is first assumed
 * to be three residuals and a Jacobian. The other way is tried again ever more rarely.
 */
static void choose_way(fast_t *f, long effort)
{
    real *known = &f->effort[f->way];
    *known = *known > 0 ? *known + ((real)effort - *known)/8 : (real)effort;
    if (++f->steps < (f->run.predictor.fitted ? 8 : 80)) /* first steps say little of later ones */
        return;
    const real other = f->way == SWEEPS_FIRST && !(f->effort[NEWTON_FIRST] > 0)
        ? 3*RESIDUAL_COST + JACOBIAN_COST : f->effort[!f->way];
    const int retry = f->steps >= f->patience;
    if (*known > (real)1.5*other || (f->way == NEWTON_FIRST && retry)) {
        f->way = !f->way;
        f->steps = 0;
        f->effort[f->way] = 0;
        if (f->patience < 1 << 16)
            f->patience *= 2;
    } else if (retry) { /* what was once seen of Newton is forgotten */
        f->effort[NEWTON_FIRST] = 0;
        f->steps = 0;
    }
}

/*
 * One step of the state in the work memory: sweeps, and Newton where they do not converge or cost
 * more.
 */
static int fast_advance(work_t *w, const options_t *options, real dt, int *iterations,
    report_t *report)
{
    fast_t *f = fast_of(w);
    *iterations = 0;
    w->effort = 0;
    f->run.t = splat(w->t);
    IF_INPUTS(for (int i = 0; i < LANES; ++i))
        IF_INPUTS(lanes_set_inputs(&f->run.constants, i, &w->constants);)
    IF_TIME(f->run.span = splat(w->span);)
    const int past = f->run.predictor.count > 0, only_sweeps = options->solver == FIXED_POINT;
    const int tries = only_sweeps || (f->way == SWEEPS_FIRST && f->wait == 0);
    int status = NOT_CONVERGED;
    if (tries && past)
        status = sweep(&f->run, options, 1, iterations);
    if (tries && status != OK)
        status = sweep(&f->run, options, 0, iterations);
    const long sweeps = *iterations;
    if (status != OK) {
        if (!only_sweeps)
            status = solve_by_newton(w, options, dt, iterations);
        if (status != OK)
            return status;
        ++report->newton_steps;
        if (f->wait > 0)
            --f->wait;
        else if (tries)
            f->wait = (1 << (f->failures < 6 ? f->failures++ : 6)) - 1;
    } else
        f->failures = 0;
    choose_way(f, sweeps*SWEEP_COST + w->effort);
    SINGLE(t) *s = &f->run;
    SEPARATE(remember)(s);
    SINGLE(finish)(s);
    real size = 0;
    for (int a = 0; a < N; ++a)
        size += part(&s->q[a], 0) + part(&s->p[a], 0);
    return isfinite(size) ? OK : NOT_FINITE;
}

static void fast_begin(work_t *w, real dt, const real q[N], const real p[N])
{
    fast_t *f = fast_of(w);
    f->failures = f->wait = f->way = f->steps = 0;
    f->patience = 32;
    f->effort[SWEEPS_FIRST] = f->effort[NEWTON_FIRST] = 0;
    f->run.constants._used = SINGLE(used)();
    for (int i = 0; i < LANES; ++i)
        SINGLE(prepare)(&f->run, i, &w->constants, dt);
    for (int a = 0; a < N; ++a) {
        f->run.q[a] = splat(q[a]);
        f->run.p[a] = splat(p[a]);
    }
    IF_TIME(f->run.t = splat(w->t);)
    SEPARATE(set_up)(&f->run);
}

static void fast_state(work_t *w, real q[N], real p[N])
{
    const SINGLE(t) *s = &fast_of(w)->run;
    for (int a = 0; a < N; ++a) {
        q[a] = part(&s->q[a], 0);
        p[a] = part(&s->p[a], 0);
    }
}

/* Adds the state in the work memory to the record, as observe does. */
static void fast_observe(work_t *w, report_t *report)
{
    SINGLE(t) *s = &fast_of(w)->run;
    const lanes H = lanes_hamiltonian(&s->constants, s->q, s->p);
    set_work(report, part(&s->work, 0), part(&s->work_low, 0));
    const real gain = part(&H, 0) - report->energy_start;
    const real error = MATH(fabs)(gain - work_so_far(report));
    report->energy_error_max = larger(error, report->energy_error_max);
    report->energy_error_sum += error;
    SINGLE(observe_defects)(s, report);
}

#endif
