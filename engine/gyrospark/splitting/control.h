/* Profile control of a composition of flows: its state and a step. */
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

static void begin_state(state_t *w, real dt, const real q[N], const real p[N])
{
    w->flows.h = dt;
    w->flows.t = (real)0;
    w->flows.now.work = (real)0;
    w->flows.now.work_low = (real)0;
    restart(w, q, p);
}

/* One step of the flows; they stay as they were if its end is not finite. */
static bool complete_step(state_t *w, real q[N], real p[N])
{
    real q_end[N];
    real p_end[N];
    real work;
    flow_state before;
    before = w->flows.now;
    const int was_underway = w->flows.is_underway;
#if GS_FORCED_BY_TIME
    w->flows.t = time_after((real)0, w->steps, w->flows.h);
#endif
    if (was_underway == 0) {
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
    const bool finite = are_finite(N, q_end) && are_finite(N, p_end);
    if (finite) {
        for (int a = 0; a < N; ++a) {
            w->q[a] = q_end[a];
            w->p[a] = p_end[a];
            q[a] = q_end[a];
            p[a] = p_end[a];
        }
        ++w->steps;
    } else {
        w->flows.now = before;
        w->flows.is_underway = was_underway;
    }
    return finite;
}

static status_t step_state(state_t *w, real q[N], real p[N])
{
    bool same = true;
    for (int a = 0; a < N; ++a) {
        same = same && (q[a] == w->q[a]) && (p[a] == w->p[a]);
    }
    if (!same) {
        restart(w, q, p);
    }
    return complete_step(w, q, p) ? OK : NOT_FINITE;
}

#endif
