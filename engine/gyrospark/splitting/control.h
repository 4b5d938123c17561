/* Profile control of a composition of flows: begin and advance. */
#ifndef GS_SPLITTING_CONTROL_H
#define GS_SPLITTING_CONTROL_H

#include "gyrospark/splitting/start.h"

static int is_finite_state(const real q[N], const real p[N])
{
    real size = 0;
    for (int a = 0; a < N; ++a)
        size += q[a] + p[a];
    return isfinite(size);
}

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

void NAME(set_parameters)(state_t *w, const parameters_t *parameters)
{
    prepare(parameters, &w->constants);
    restart(w, w->q, w->p);
}

void NAME(begin)(state_t *w, const parameters_t *parameters, real dt, const real q[N],
    const real p[N])
{
    w->flows.h = dt;
    w->start_time = start_time(parameters);
    w->steps = 0;
    w->flows.now.work = w->flows.now.work_low = 0;
    prepare(parameters, &w->constants);
    restart(w, q, p);
}

int NAME(advance)(state_t *w, real q[N], real p[N])
{
    real q_end[N], p_end[N], work;
    int differs = 0;
    for (int a = 0; a < N; ++a)
        differs |= !(q[a] == w->q[a]) || !(p[a] == w->p[a]);
    if (differs)
        restart(w, q, p);
    const flow_state before = w->flows.now;
    const int was_underway = w->flows.is_underway;
    w->flows.t = w->start_time + (real)w->steps*w->flows.h;
    for (int i = 0; i < w->flows.stages; ++i)
        take_stage(&w->constants, &w->flows, i);
    end_of_step(&w->constants, &w->flows, q_end, p_end, &work);
    if (!is_finite_state(q_end, p_end)) {
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

#endif
