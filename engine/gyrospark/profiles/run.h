/* Profile run: a step by fixed-point iteration, with Newton's method where it fails. */
#ifndef GS_PROFILES_RUN_H
#define GS_PROFILES_RUN_H

#include "gyrospark/profiles/solve.h"
#include "gyrospark/newton/step.h"

#include "gyrospark/profiles/unknowns.h"

#if GS_FORCES
/* Stores the work of the step that the iteration has completed. */
static void store_iteration_work(work_t *w, const real q[N], const real p[N])
{
    get_unknowns(&w->state, w->state.x, w->x);
    w->work_done = step_work(w, w->state.h, q, p, w->x);
}
#endif

/* Takes the state of the caller; a component that changed loses its round-off. */
static void set_state(work_t *w, const real q[N], const real p[N])
{
    state_t *s = &w->state;
    s->constants = w->constants;
    for (int a = 0; a < N; ++a) {
        if (!(s->q[a] == q[a]))
            s->q_low[a] = 0;
        if (!(s->p[a] == p[a]))
            s->p_low[a] = 0;
        s->q[a] = q[a];
        s->p[a] = p[a];
    }
}

/* Clears the history after a step by Newton's method. */
static void reset_iteration(work_t *w)
{
    w->state.history_length = w->state.order = 0;
}

static void begin_run(work_t *w, const options_t *options, real dt, const real q[N],
    const real p[N])
{
    state_t *s = &w->state;
    s->tolerance = options->tolerance;
    s->max_iterations = options->max_iterations;
    s->h = dt;
    s->h_inverse = 1/dt;
    s->constants = w->constants;
    w->failures = w->newton_steps_left = s->history_length = s->order = 0;
    for (int a = 0; a < N; ++a) {
        s->q[a] = q[a];
        s->p[a] = p[a];
        s->q_low[a] = s->p_low[a] = 0;
    }
}

/* One step by fixed-point iteration; a failed step leaves the state. */
static int advance_by_fixed_point(work_t *w, real q[N], real p[N])
{
    state_t *s = &w->state;
    real q_end[N], p_end[N], q_low[N], p_low[N];
    s->t = w->t;
    evaluate_constraints(s);
    const int status = solve_fixed_point(s);
    if (status != OK)
        return status;
    end_of_step(s, q_end, p_end, q_low, p_low);
    if (!isfinite(norm(N, q_end) + norm(N, p_end)))
        return NOT_FINITE;
    IF_FORCES(store_iteration_work(w, q, p);)
    record_unknowns(s);
    for (int a = 0; a < N; ++a) {
        q[a] = s->q[a] = q_end[a];
        p[a] = s->p[a] = p_end[a];
        s->q_low[a] = q_low[a];
        s->p_low[a] = p_low[a];
    }
    return OK;
}

/* One step of a run, recorded; Newton's method if the iteration fails, and for some steps after. */
static int advance_run(work_t *w, const options_t *options, real dt, real q[N], real p[N],
    real multipliers[ROOM], int *iterations, report_t *report)
{
    const int only_fixed_point = options->solver == FIXED_POINT;
    const int iterates = options->solver != NEWTON
        && (only_fixed_point || w->newton_steps_left == 0);
    int status = NOT_CONVERGED, taken = 0;
    *iterations = 0;
    if (iterates) {
        status = advance_by_fixed_point(w, q, p);
        *iterations = w->state.iterations;
        w->failures = status == OK ? 0 : w->failures;
    }
    if (status != OK) {
        if (!only_fixed_point)
            status = advance(w, options, dt, q, p, q, p, multipliers, &taken);
        *iterations += taken;
        if (status != OK)
            return status;
        if (options->solver != NEWTON) {
            ++report->newton_steps;
            w->newton_steps_left = iterates ? (1 << (w->failures < 6 ? w->failures++ : 6)) - 1
                : w->newton_steps_left - 1;
            set_state(w, q, p);
            reset_iteration(w);
        }
    }
    IF_FORCES(add_work(report, w->work_done);)
    observe(&w->constants, q, p, report);
    return OK;
}

#endif
