/* Profile control: begin and advance. */
#ifndef GS_PROFILES_CONTROL_H
#define GS_PROFILES_CONTROL_H

#if GS_SPLITTING
#include "gyrospark/splitting/control.h"
#else
#include "gyrospark/profiles/arguments.h"
#include "gyrospark/profiles/solve.h"

/* The state of the caller; a component that did not change keeps its round-off. */
static void set_state(real state[N], real low[N], const real caller[N])
{
    for (int a = 0; a < N; ++a) {
        if (!(state[a] == caller[a])) {
            state[a] = caller[a];
            low[a] = (real)0;
        }
    }
}

/* Ends the step in (q, p); nothing changes if the result is not finite. */
static bool complete_step(state_t *w, real q[N], real p[N])
{
    real q_end[N];
    real p_end[N];
    real q_low[N];
    real p_low[N];
    end_of_step(w, q_end, p_end, q_low, p_low);
    const bool finite = are_finite(N, q_end) && are_finite(N, p_end);
    if (finite) {
        record_unknowns(w);
        for (int a = 0; a < N; ++a) {
            w->q[a] = q_end[a];
            w->p[a] = p_end[a];
            q[a] = q_end[a];
            p[a] = p_end[a];
            w->q_low[a] = q_low[a];
            w->p_low[a] = p_low[a];
        }
        ++w->steps;
#if GS_FORCED_BY_TIME
        w->t = time_after((real)0, w->steps, w->h);
#endif
    }
    return finite;
}

/* One step from the state (q, p) of the caller, which becomes its end, or stays on failure. */
static status_t step_state(state_t *w, real q[N], real p[N])
{
    set_state(w->q, w->q_low, q);
    set_state(w->p, w->p_low, p);
    evaluate_constraints(w);
    status_t status = solve_fixed_point(w);
    if (((status == OK) || (status == NOT_CONVERGED)) && !complete_step(w, q, p)) {
        status = NOT_FINITE;
    }
    return status;
}
#endif

size_t NAME(work_size)(void)
{
    return sizeof(state_t);
}

real NAME(time)(const state_t *w)
{
#if GS_SPLITTING
    return time_after(w->start_time, w->steps, w->flows.h);
#else
    return time_after(w->start_time, w->steps, w->h);
#endif
}

status_t NAME(set_parameters)(state_t *w, const parameters_t *parameters)
{
    status_t status = INVALID;
    if ((w->begun == GS_BEGUN) && are_valid(parameters)) {
#if GS_FORCED_BY_TIME
        const parameters_t own = begun_at(w->start_time, parameters);
        prepare(&own, &w->constants);
#else
        prepare(parameters, &w->constants);
#endif
#if GS_SPLITTING
        restart(w, w->q, w->p);
#endif
        status = OK;
    }
    return status;
}

status_t NAME(begin)(state_t *w, const parameters_t *parameters, const options_t *options, real dt,
    const real q[N], const real p[N])
{
    status_t status = INVALID;
    w->begun = 0U;
    if (is_step(dt) && is_state(q, p) && is_option(options) && are_valid(parameters)) {
        w->begun = GS_BEGUN;
        w->steps = 0;
#if GS_FORCED_BY_TIME
        w->start_time = origin_of(parameters);
#else
        w->start_time = start_time(parameters);
#endif
        prepare(parameters, &w->constants);
#if GS_SPLITTING
        begin_state(w, dt, q, p);
#else
        w->tolerance = options->tolerance;
        w->max_iterations = options->max_iterations;
        w->h = dt;
        w->h_inverse = (real)1/dt;
        w->t = (real)0;
        w->history_length = 0;
        w->order = 0;
        w->iterations = 0;
        w->change = (real)0;
        for (int a = 0; a < N; ++a) {
            w->q[a] = q[a];
            w->p[a] = p[a];
            w->q_low[a] = (real)0;
            w->p_low[a] = (real)0;
        }
#endif
        status = OK;
    }
    return status;
}

status_t NAME(advance)(state_t *w, real q[N], real p[N])
{
    return (w->begun == GS_BEGUN) ? step_state(w, q, p) : INVALID;
}

int NAME(iterations)(const state_t *w)
{
#if GS_SPLITTING
    (void)w; /* nothing is iterated */
    return 0;
#else
    return w->iterations;
#endif
}

real NAME(change)(const state_t *w)
{
#if GS_SPLITTING
    (void)w;
    return (real)0;
#else
    return MATH(sqrt)(w->change);
#endif
}

#endif
