/* Several trajectories, one in each lane. */
#ifndef GS_RUN_BATCH_H
#define GS_RUN_BATCH_H

#include "gyrospark/fixed_point/batch.h"
#include "gyrospark/fixed_point/fallback.h"
#include "gyrospark/run/integrate.h"

/* --------------------------------------------------------------- several trajectories at a time */

/* What a caller's batch memory holds. */
typedef struct {
    BATCH(t) run;
    BATCH(iterate) kept; /* lanes that converged before their mates, or are to be kept */
    lanes energy_start, energy_error_max, energy_error_sum;
    lanes start; /* the time at the start of the run */
    long done;   /* steps since then */
    lanes g_max, g_sum, f_max, f_sum;
} batch_t;

_Static_assert(sizeof(batch_t) + 64 <= sizeof(((batch_memory *)0)->memory),
    "batch memory is too small");

static batch_t *batch_of(batch_memory *memory)
{
    return (batch_t *)(((size_t)memory->memory + 63) & ~(size_t)63);
}

enum { WHOLE = sizeof(BATCH(iterate))/sizeof(lanes) };

/* The first `count` numbers of an iterate, in the lanes of m. */
INLINE void keep(lanes_mask m, int count, const BATCH(iterate) *from, BATCH(iterate) *to)
{
    renew(m, count, (const lanes *)(const void *)from, (lanes *)(void *)to);
}

/*
 * The lanes in `fresh` begin at the rates at the start of the step (or, with x given, at those
 * unknowns); the others are not touched, to the bit.
 */
static void restart(batch_t *b, lanes_mask fresh, const real *x)
{
    b->kept = b->run.now;
    if (x == NULL)
        BATCH(guess)(&b->run);
    for (int i = 0; i < LANES; ++i)
        if (x != NULL && holds(&fresh, i))
            BATCH(load)(&b->run, i, x);
    BATCH(begin)(&b->run);
    keep(lanes_others(fresh), WHOLE, &b->kept, &b->run.now);
}

/*
 * Sweeps until every lane has converged or given up. A lane ends with the sweep that is its own
 * last one: what it computes does not depend on its mates. lost[i] says why lane i gave up.
 */
static void sweep_lanes(batch_t *b, const options_t *options, const int *alive, int *lost,
    int *sweeps)
{
    BATCH(t) *run = &b->run;
    const lanes far = splat((real)0.02);
    const int predicted = run->predictor.count > 0, watches = watches_rates(&run->predictor);
    lanes taken = splat(0), living = splat(0);
    for (int i = 0; i < LANES; ++i) {
        set_part(&living, i, (real)alive[i]);
        lost[i] = OK;
    }
    lanes_progress_t progress = lanes_start_of_sweeps();
    lanes_mask busy = living > splat(0), early = busy & lanes_others(busy);
    BATCH(start)(run, predicted);
    for (int round = 1; lanes_any(busy); ++round) {
        BATCH(sweep)(run);
        const lanes change = run->change;
        const lanes_mask on = lanes_goes_on(&progress, change, options->tolerance,
            options->max_iterations);
        if (!watches && !lanes_any(busy & lanes_others(on))) {
            lanes_go_on(&progress, change, run->bound.defect);
            taken = lanes_pick(busy, taken + 1, taken);
            continue;
        }
        const lanes_mask looks = busy & lanes_calls_for_look(&progress, change);
        if (lanes_any(looks)) {
            BATCH(noise)(run);
            lanes_look(&progress, looks, run->noise);
        }
        lanes *rates = run->predictor.rate + rate_of(round);
        const lanes rate[2] = { rates[0], rates[1] };
        lanes_verdict_t verdict = lanes_judge(&progress, change, run->bound.defect, run->moved,
            options->tolerance, options->max_iterations, watches, rates);
        renew(lanes_others(busy), 2, rate, rates);
        taken = lanes_pick(busy, taken + 1, taken);
        if (predicted && round == 1) {
            const lanes_mask fresh = busy & lanes_others(change < far*far);
            for (int i = 0; i < LANES; ++i)
                if (holds(&busy, i))
                    run->predictor.first[i] = part(&change, i);
            if (lanes_any(fresh)) { /* a far prediction may lead to another root */
                const lanes_progress_t start = lanes_start_of_sweeps();
                renew(fresh, sizeof(progress)/sizeof(lanes), &start.sweeps, &progress.sweeps);
                restart(b, fresh, NULL);
            }
            verdict.ended &= lanes_others(fresh);
        }
        const lanes_mask ends = busy & verdict.ended;
        for (int i = 0; i < LANES; ++i)
            if (holds(&ends, i) && holds(&verdict.failed, i))
                lost[i] = why(part(&progress.change, i), part(&progress.before, i));
        busy &= lanes_others(ends);
        if (lanes_any(ends) && lanes_any(busy)) {
            early |= ends;
            keep(ends, BATCH(RESULT), &run->now, &b->kept);
        }
        if (!predicted && lanes_any(busy) && (round == 1 || round == 3)) {
            BATCH(sizes)(run);
            BATCH(factor)(run);
        }
    }
    for (int i = 0; i < LANES; ++i)
        sweeps[i] += (int)part(&taken, i);
    if (lanes_any(early))
        keep(early, BATCH(RESULT), &b->kept, &run->now);
}

/* Lane i by full Newton, as solver NEWTON does it. */
static int rescue(batch_t *b, const options_t *options, int lane, int *iterations, work_t *w)
{
    real q[N], p[N];
    int taken;
    get_constants(&b->run.constants, lane, &w->constants);
    for (int a = 0; a < N; ++a) {
        q[a] = part(&b->run.q[a], lane);
        p[a] = part(&b->run.p[a], lane);
    }
    const real dt = part(&b->run.h, lane);
    w->t = part(&b->run.t, lane);
    IF_TIME(w->span = part(&b->run.span, lane);)
    const int status = newton(w, options, dt, q, p, w->x, &taken);
    *iterations += taken;
    if (status != OK)
        return status;
    lanes number = splat(0);
    set_part(&number, lane, 1);
    restart(b, number > splat(0), w->x);
    return OK;
}

INLINE lanes lanes_size(lanes a)
{
    return lanes_larger(a, -a);
}

#if GS_CONSTRAINED
static void observe_lane_defects(batch_t *b)
{
    BATCH(t) *run = &b->run;
    lanes f[M], g_size = splat(0), f_size = splat(0);
    lanes_hidden_constraint(&run->constants, run->q, run->p, f);
    for (int mu = 0; mu < M; ++mu) {
        g_size = lanes_larger(g_size, lanes_size(run->bound.g_rounded[mu]));
        f_size = lanes_larger(f_size, lanes_size(f[mu]));
    }
    b->g_max = lanes_larger(g_size, b->g_max);
    b->g_sum += g_size;
    b->f_max = lanes_larger(f_size, b->f_max);
    b->f_sum += f_size;
}
#else
static void observe_lane_defects(batch_t *b)
{
    (void)b;
}
#endif

#if GS_INPUTS
/* The inputs of the next step of each trajectory; lanes beyond the last repeat the first. */
static void take_lane_inputs(batch_t *b, const inputs_t *inputs, int count)
{
    constants c;
    for (int i = 0; i < LANES && inputs->values != NULL; ++i) {
        take_inputs(&c, inputs, i < count ? i : 0, b->done);
        lanes_set_inputs(&b->run.constants, i, &c);
    }
}
#endif

static void observe_lanes(batch_t *b)
{
    BATCH(t) *run = &b->run;
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

static int is_finite_lane(const BATCH(t) *run, int lane)
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
        BATCH(prepare)(&b->run, i, &c, dt[from]);
        set_part(&b->start, i, start_time(&parameters[from]));
        for (int a = 0; a < N; ++a) {
            set_part(&b->run.q[a], i, q[from*N + a]);
            set_part(&b->run.p[a], i, p[from*N + a]);
        }
    }
    IF_TIME(b->run.t = b->start;)
    BATCH(set_up)(&b->run);
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
    IF_INPUTS(inputs_t inputs,)
    const real *dt, long steps, long every, long rows, real *q, real *p, rows_t out,
    report_t *reports, int *status, batch_memory *batch, work_t *work)
{
    batch_t *b = batch_of(batch);
    BATCH(t) *run = &b->run;
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
        IF_INPUTS(take_lane_inputs(b, &inputs, count);)
        run->t = b->start + (real)b->done++*run->h;
        IF_TIME(run->span = b->start + (real)b->done*run->h - run->t;)
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
        BATCH(remember)(run);
        BATCH(finish)(run);
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
                BATCH(multipliers)(run, i, out.multipliers + row*MULTIPLIERS);
            if (out.iterations != NULL)
                out.iterations[row] = most[i];
            if (out.work != NULL)
                out.work[row] = part(&run->work, i);
            most[i] = 0;
        }
    }
}

#endif
