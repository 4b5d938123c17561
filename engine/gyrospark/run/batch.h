/* Integration of a batch: one trajectory per lane of a vector register. */
#ifndef GS_RUN_BATCH_H
#define GS_RUN_BATCH_H

#include "gyrospark/fixed_point/batch.h"
#include "gyrospark/fixed_point/fallback.h"
#include "gyrospark/run/integrate.h"
#include "gyrospark/run/lane_record.h"

/* State of a batch, inside the caller's batch memory. */
typedef struct {
    BATCH(t) solver;
    BATCH(unknowns) converged; /* unknowns of lanes that converged or do not restart */
    lanes_record record;
    lanes start; /* time at the start of the run */
    long done;   /* steps since the start */
} ensemble_t;

_Static_assert(sizeof(ensemble_t) + 64 <= sizeof(((batch_memory *)0)->memory),
    "batch memory is too small");
_Static_assert(_Alignof(ensemble_t) <= 64, "ensemble_of aligns to 64 bytes only");

/* The state of a batch in its memory. */
static ensemble_t *ensemble_of(batch_memory *memory)
{
    return ALIGNED(memory->memory);
}

enum { UNKNOWNS = sizeof(BATCH(unknowns))/sizeof(lanes) };

/* Copies the first `count` unknowns of an iterate in the lanes of the mask m. */
INLINE void select_lanes(lanes_mask m, int count, const BATCH(unknowns) *from, BATCH(unknowns) *to)
{
    assign_lanes(m, count, (const lanes *)(const void *)from, (lanes *)(void *)to);
}

/*
 * Restarts the iteration of the lanes in `restarted` from the Euler start or, if x is not NULL,
 * from the unknowns x. The unknowns of all other lanes remain bit-identical.
 */
static void restart_lanes(ensemble_t *b, lanes_mask restarted, const real *x)
{
    b->converged = b->solver.now;
    if (x == NULL)
        BATCH(euler_start)(&b->solver);
    for (int i = 0; i < LANES; ++i)
        if (x != NULL && mask_get(&restarted, i))
            BATCH(set_unknowns)(&b->solver, i, x);
    IF_CONSTRAINED(BATCH(begin_iteration)(&b->solver);)
    select_lanes(lanes_mask_not(restarted), UNKNOWNS, &b->converged, &b->solver.now);
}

/*
 * Fixed-point iteration until every lane has converged or failed. Each lane returns the iterate at
 * which its own convergence test stopped it, so that its result does not depend on neighbouring
 * lanes. failed[i] is the failure status of lane i, or OK. QUARTER_STEP is a second attempt of the
 * lanes that have failed; the others keep their iterates, and a first failure its reason.
 */
static void solve_fixed_point_lanes(ensemble_t *b, const options_t *options, int start,
    const int *alive, int *failed, int *iterations)
{
    BATCH(t) *solver = &b->solver;
    const lanes radius = splat(FAR_CHANGE);
    const int predicted = start == PREDICTED, updates = updates_rates(&solver->predictor);
    int preliminary = start == QUARTER_STEP ? SHORT_STEP_ITERATIONS : 0;
    lanes iterations_taken = splat(0), to_solve = splat(0), solved = splat(0);
    for (int i = 0; i < LANES; ++i) {
        const int keeps = start == QUARTER_STEP && failed[i] == OK;
        lane_set(&to_solve, i, (real)(alive[i] && !keeps));
        lane_set(&solved, i, (real)(alive[i] && keeps));
    }
    lanes_progress_t progress = lanes_initial_progress();
    lanes_mask active = to_solve > splat(0), finished = solved > splat(0);
    if (lanes_any(finished))
        select_lanes(finished, BATCH(RESULT), &solver->now, &b->converged);
    BATCH(start_iteration)(solver, start);
    for (int iteration = 1; lanes_any(active); ++iteration) {
        BATCH(iterate_once)(solver);
        if (preliminary > 0) {
            if (--preliminary % (SHORT_STEP_ITERATIONS/2) == 0)
                BATCH(start_iteration)(solver, FROM_HALF_STEP);
            iterations_taken = lanes_select_value(active, iterations_taken + 1, iterations_taken);
            iteration = 0;
            continue;
        }
        const lanes change = solver->change;
        const lanes_mask contracting = lanes_is_contracting(&progress, change, options->tolerance,
            options->max_iterations);
        if (!updates && !lanes_any(active & lanes_mask_not(contracting))) {
            lanes_update_contracting(&progress, change, solver->constraint_state.defect);
            iterations_taken = lanes_select_value(active, iterations_taken + 1, iterations_taken);
            continue;
        }
        const lanes_mask estimates = active & lanes_needs_round_off_estimate(&progress, change);
        if (lanes_any(estimates)) {
            BATCH(estimate_round_off)(solver);
            lanes_set_round_off_floor(&progress, estimates, solver->round_off);
        }
        lanes *rates = solver->predictor.rate + rate_index(iteration);
        const lanes rate[2] = { rates[0], rates[1] };
        lanes_convergence_t result = lanes_test_convergence(&progress, change,
            solver->constraint_state.defect, solver->step_squared, options->tolerance,
            options->max_iterations, updates, rates);
        assign_lanes(lanes_mask_not(active), 2, rate, rates);
        iterations_taken = lanes_select_value(active, iterations_taken + 1, iterations_taken);
        if (predicted && iteration == 1) {
            const lanes_mask restarted = active & lanes_mask_not(change < radius*radius);
            for (int i = 0; i < LANES; ++i)
                if (mask_get(&active, i))
                    solver->predictor.first[i] = lane_get(&change, i);
            if (lanes_any(restarted)) { /* a poor prediction may lead to another root */
                const lanes_progress_t start = lanes_initial_progress();
                assign_lanes(restarted, sizeof(progress)/sizeof(lanes), &start.iterations,
                    &progress.iterations);
                restart_lanes(b, restarted, NULL);
            }
            result.ended &= lanes_mask_not(restarted);
        }
        const lanes_mask ends = active & result.ended;
        for (int i = 0; i < LANES; ++i)
            if (mask_get(&ends, i) && !mask_get(&result.failed, i))
                failed[i] = OK;
            else if (mask_get(&ends, i) && failed[i] == OK)
                failed[i] = failure_reason(lane_get(&progress.change, i),
                    lane_get(&progress.previous, i));
        active &= lanes_mask_not(ends);
        if (lanes_any(ends) && lanes_any(active)) {
            finished |= ends;
            select_lanes(ends, BATCH(RESULT), &solver->now, &b->converged);
        }
        if (!predicted && lanes_any(active) && (iteration == 1 || iteration == 3)) {
            BATCH(update_scales)(solver);
            IF_FACTORISED(BATCH(factorise_schur)(solver);)
        }
    }
    for (int i = 0; i < LANES; ++i)
        iterations[i] += (int)lane_get(&iterations_taken, i);
    if (lanes_any(finished))
        select_lanes(finished, BATCH(RESULT), &b->converged, &solver->now);
}

/*
 * Solves the step of one lane by full Newton; the result is bit-identical to that of the solver
 * NEWTON.
 */
static int solve_lane_by_newton(ensemble_t *b, const options_t *options, int lane,
    int *iterations, work_t *w)
{
    real q[N], p[N];
    int iterations_taken;
    get_constants(&b->solver.constants, lane, &w->constants);
    for (int a = 0; a < N; ++a) {
        q[a] = lane_get(&b->solver.q[a], lane);
        p[a] = lane_get(&b->solver.p[a], lane);
    }
    const real dt = lane_get(&b->solver.h, lane);
    w->t = lane_get(&b->solver.t, lane);
    IF_TIME(w->step = lane_get(&b->solver.step, lane);)
    const int status = newton(w, options, dt, q, p, w->x, &iterations_taken);
    *iterations += iterations_taken;
    if (status != OK)
        return status;
    lanes number = splat(0);
    lane_set(&number, lane, 1);
    restart_lanes(b, number > splat(0), w->x);
    return OK;
}

#if GS_INPUTS
/* Sets the inputs of the next step in every lane; unused lanes repeat the first trajectory. */
static void set_lane_inputs(ensemble_t *b, const inputs_t *inputs, int count)
{
    constants c;
    for (int i = 0; i < LANES && inputs->values != NULL; ++i) {
        set_step_inputs(&c, inputs, i < count ? i : 0, b->done);
        lanes_set_inputs(&b->solver.constants, i, &c);
    }
}
#endif

/* Adds the energy and constraint errors of all lanes to the record. */
static void observe_batch(ensemble_t *b)
{
    BATCH(t) *solver = &b->solver;
    const lanes H = lanes_hamiltonian(&solver->constants, solver->q, solver->p);
    const lanes *g = NULL, *f = NULL;
#if GS_CONSTRAINED
    lanes hidden[M];
    lanes_hidden_constraint(&solver->constants, solver->q, solver->p, hidden);
    g = solver->constraint_state.g_rounded;
    f = hidden;
#endif
    observe_lanes(&b->record, H, solver->work, g, f);
}

/* Copies the report of a lane to the caller's report. */
static void write_report(const ensemble_t *b, int lane, report_t *report)
{
    IF_FORCES(report->work = lane_get(&b->solver.work, lane);)
    IF_FORCES(report->work_low = lane_get(&b->solver.work_low, lane);)
    write_record(&b->record, lane, report);
}

/* Copies the state and report of a lane to the caller. */
static void write_state(const ensemble_t *b, int lane, const lanes *from_q, const lanes *from_p,
    real *q, real *p, report_t *report)
{
    write_report(b, lane, report);
    for (int a = 0; a < N; ++a) {
        q[lane*N + a] = lane_get(&from_q[a], lane);
        p[lane*N + a] = lane_get(&from_p[a], lane);
    }
}

/* Whether the state of a lane is finite */
static int is_finite_lane(const BATCH(t) *solver, int lane)
{
    real size = 0;
    for (int a = 0; a < N; ++a)
        size += lane_get(&solver->q[a], lane) + lane_get(&solver->p[a], lane);
    return isfinite(size);
}

/*
 * Begins a batch of `count` trajectories. Unused lanes repeat the first trajectory, which keeps
 * their values finite and costs no time.
 */
static void begin_ensemble(ensemble_t *b, int count, const parameters_t *parameters, const real *dt,
    const real *q, const real *p)
{
    b->solver.constants._used = count < LANES ? count : LANES;
    for (int i = 0; i < LANES; ++i) {
        const int from = i < count ? i : 0;
        constants c;
        prepare(&parameters[from], &c);
        BATCH(prepare)(&b->solver, i, &c, dt[from]);
        lane_set(&b->start, i, start_time(&parameters[from]));
        for (int a = 0; a < N; ++a) {
            lane_set(&b->solver.q[a], i, q[from*N + a]);
            lane_set(&b->solver.p[a], i, p[from*N + a]);
        }
    }
    IF_TIME(b->solver.t = b->start;)
    BATCH(initialise)(&b->solver);
    b->done = 0;
    const lanes_record start = {
        .energy_start = lanes_hamiltonian(&b->solver.constants, b->solver.q, b->solver.p) };
    b->record = start;
    observe_batch(b);
}

int NAME(lanes)(void)
{
    return LANES;
}

/* Integrates one batch in place; the public header documents the arguments. */
static void integrate_lanes(int count, const parameters_t *parameters, const options_t *options,
    IF_INPUTS(inputs_t inputs,)
    const real *dt, long steps, long every, long rows, real *q, real *p, rows_t out,
    report_t *reports, int *status, batch_memory *batch, work_t *work)
{
    ensemble_t *b = ensemble_of(batch);
    BATCH(t) *solver = &b->solver;
    int alive[LANES], most[LANES] = { 0 }, alive_count = 0;
    if (count <= 0)
        return;
    if (reports[0].steps == 0 && status[0] == OK) {
        begin_ensemble(b, count, parameters, dt, q, p);
        for (int i = 0; i < count; ++i) {
            reports[i].energy_start = lane_get(&b->record.energy_start, i);
            write_report(b, i, &reports[i]);
        }
    }
    for (int i = 0; i < LANES; ++i) {
        alive[i] = i < count && status[i] == OK;
        alive_count += alive[i];
    }
    for (long k = 1; k <= steps && alive_count > 0; ++k) {
        int failed[LANES] = { OK }, iterations_taken[LANES] = { 0 };
        IF_INPUTS(set_lane_inputs(b, &inputs, count);)
        solver->t = b->start + (real)b->done++*solver->h;
        IF_TIME(solver->step = b->start + (real)b->done*solver->h - solver->t;)
        const int start = solver->predictor.count > 0 ? PREDICTED : EULER;
        solve_fixed_point_lanes(b, options, start, alive, failed, iterations_taken);
#if GS_SPARK
        int failures = 0;
        for (int i = 0; i < LANES; ++i)
            failures += failed[i] != OK;
        if (failures > 0 && start == EULER)
            solve_fixed_point_lanes(b, options, QUARTER_STEP, alive, failed, iterations_taken);
#endif
        for (int i = 0; i < LANES; ++i) {
            if (failed[i] != OK && options->solver != FIXED_POINT) {
                failed[i] = solve_lane_by_newton(b, options, i, &iterations_taken[i], work);
                reports[i].newton_steps += failed[i] == OK;
            }
            IF_CLOCK(if (alive[i] && failed[i] == OK && !BATCH(time_advances)(solver, i))
                failed[i] = TIME_STOPPED;)
            if (failed[i] != OK) {
                status[i] = failed[i];
                alive[i] = 0;
                --alive_count;
                write_state(b, i, solver->q, solver->p, q, p, &reports[i]);
            }
        }
        lanes q_before[N], p_before[N];
        for (int a = 0; a < N; ++a) {
            q_before[a] = solver->q[a];
            p_before[a] = solver->p[a];
        }
        IF_FORCES(const lanes work_before = solver->work;)
        BATCH(record_step)(solver);
        BATCH(finish)(solver);
        for (int i = 0; i < count; ++i)
            if (alive[i] && !is_finite_lane(solver, i)) {
                status[i] = NOT_FINITE;
                alive[i] = 0;
                --alive_count;
                write_state(b, i, q_before, p_before, q, p, &reports[i]);
                IF_FORCES(reports[i].work = lane_get(&work_before, i);)
            }
        observe_batch(b);
        for (int i = 0; i < count; ++i) {
            if (!alive[i])
                continue;
            report_t *report = &reports[i];
            IF_CLOCK(record_time_step(report, lane_get(&solver->q[N - 1], i)
                - lane_get(&q_before[N - 1], i));)
            ++report->steps;
            report->iterations += iterations_taken[i];
            if (iterations_taken[i] > report->iterations_max)
                report->iterations_max = iterations_taken[i];
            if (iterations_taken[i] > most[i])
                most[i] = iterations_taken[i];
            if (k == steps)
                write_state(b, i, solver->q, solver->p, q, p, report);
            if (k % every != 0)
                continue;
            const long row = i*rows + k/every - 1;
            for (int a = 0; a < N && out.q != NULL; ++a)
                out.q[row*N + a] = lane_get(&solver->q[a], i);
            for (int a = 0; a < N && out.p != NULL; ++a)
                out.p[row*N + a] = lane_get(&solver->p[a], i);
            IF_CONSTRAINED(if (out.multipliers != NULL)
                BATCH(multipliers)(solver, i, out.multipliers + row*MULTIPLIERS);)
            if (out.iterations != NULL)
                out.iterations[row] = most[i];
            if (out.work != NULL)
                out.work[row] = lane_get(&solver->work, i);
            most[i] = 0;
        }
    }
}

#endif
