/* Profile control of a composition of flows: begin and advance. */
#ifndef GS_SPLITTING_CONTROL_H
#define GS_SPLITTING_CONTROL_H

#include "gyrospark/profiles/arguments.h"
#include "gyrospark/splitting/start.h"

/* Starts the flows from (q, p), at the present parameters. */
static void restart(state_t *w, const real q[N], const real p[N])
{
    prepare_flows(&w->flows, &w->constants, w->flows.h);
    start_flows(&w->flows, q, p);
    for (int a = 0; a < N; ++a) {
        w->q[a] = q[a];
        w->p[a] = p[a];
    }
}

size_t NAME(work_size)(void)
{
    return sizeof(state_t);
}

real NAME(time)(const state_t *w)
{
    return time_after(w->start_time, w->steps, w->flows.h);
}

status_t NAME(set_parameters)(state_t *w, const parameters_t *parameters)
{
    status_t status = INVALID;
    if ((w->steps >= 0) && are_valid(parameters)) {
        prepare(parameters, &w->constants);
        restart(w, w->q, w->p);
        status = OK;
    }
    return status;
}

status_t NAME(begin)(state_t *w, const parameters_t *parameters, const options_t *options, real dt,
    const real q[N], const real p[N])
{
    w->steps = -1;
    if (!is_step(dt) || !is_state(q, p) || !is_option(options) || !are_valid(parameters)) {
        return INVALID;
    }
    w->steps = 0;
    w->flows.h = dt;
    w->flows.t = w->start_time = start_time(parameters);
    w->flows.now.work = w->flows.now.work_low = 0;
    prepare(parameters, &w->constants);
    restart(w, q, p);
    return OK;
}

status_t NAME(advance)(state_t *w, real q[N], real p[N])
{
    real q_end[N], p_end[N], work;
    bool differs = false;
    if (w->steps < 0) {
        return INVALID;
    }
    for (int a = 0; a < N; ++a) {
        differs = differs || !(q[a] == w->q[a]) || !(p[a] == w->p[a]);
    }
    if (differs) {
        restart(w, q, p);
    }
    const flow_state before = w->flows.now;
    const int was_underway = w->flows.is_underway;
#if GS_FORCED_BY_TIME
    w->flows.t = NAME(time)(w);
#endif
    if (!was_underway) {
        drift_on(&w->constants, &w->flows, 0);
    }
    for (int i = 0; i < w->flows.stages; ++i) {
        if (i > 0) {
            drift_on(&w->constants, &w->flows, i);
        }
        end_stage(&w->constants, &w->flows, i);
    }
    /* The drift up to the end of the step, and that into the next one: neither waits for the other. */
    end_of_step(&w->constants, &w->flows, q_end, p_end, &work);
    drift_on(&w->constants, &w->flows, w->flows.stages + 1);
    if (!are_finite(N, q_end) || !are_finite(N, p_end)) {
        w->flows.now = before;
        w->flows.is_underway = was_underway;
        return NOT_FINITE;
    }
    for (int a = 0; a < N; ++a) {
        q[a] = w->q[a] = q_end[a];
        p[a] = w->p[a] = p_end[a];
    }
    ++w->steps;
    return OK;
}

/* Nothing is iterated. */
int NAME(iterations)(const state_t *w)
{
    (void)w;
    return 0;
}

real NAME(change)(const state_t *w)
{
    (void)w;
    return 0;
}

#endif
