/* Profile control: begin and advance. */
#ifndef GS_PROFILES_CONTROL_H
#define GS_PROFILES_CONTROL_H

#include "gyrospark/profiles/solve.h"

/* The state of the caller; a component that did not change keeps its round-off. */
static void set_state(real state[N], real low[N], const real given[N])
{
    for (int a = 0; a < N; ++a)
        if (!(state[a] == given[a])) {
            state[a] = given[a];
            low[a] = 0;
        }
}

size_t NAME(work_size)(void)
{
    return sizeof(state_t);
}

void NAME(set_parameters)(state_t *w, const parameters_t *parameters)
{
    prepare(parameters, &w->constants);
}

void NAME(begin)(state_t *w, const parameters_t *parameters,
    const options_t *options, real dt, const real q[N], const real p[N])
{
    w->tolerance = options->tolerance;
    w->max_iterations = options->max_iterations;
    w->h = dt;
    w->h_inverse = 1/dt;
    w->t = w->start_time = start_time(parameters);
    w->steps = w->history_length = w->order = w->iterations = 0;
    w->change = 0;
    for (int a = 0; a < N; ++a) {
        w->q[a] = q[a];
        w->p[a] = p[a];
        w->q_low[a] = w->p_low[a] = 0;
    }
    prepare(parameters, &w->constants);
}

int NAME(advance)(state_t *w, real q[N], real p[N])
{
    real q_end[N], p_end[N], q_low[N], p_low[N], size = 0;
    set_state(w->q, w->q_low, q);
    set_state(w->p, w->p_low, p);
    evaluate_constraints(w);
    const int status = solve_fixed_point(w);
    if (status != OK && status != NOT_CONVERGED)
        return status;
    end_of_step(w, q_end, p_end, q_low, p_low);
    for (int a = 0; a < N; ++a)
        size += q_end[a] + p_end[a];
    if (!isfinite(size))
        return NOT_FINITE;
    record_unknowns(w);
    for (int a = 0; a < N; ++a) {
        q[a] = w->q[a] = q_end[a];
        p[a] = w->p[a] = p_end[a];
        w->q_low[a] = q_low[a];
        w->p_low[a] = p_low[a];
    }
    w->t = w->start_time + (real)++w->steps*w->h;
    return status;
}

int NAME(iterations)(const state_t *w)
{
    return w->iterations;
}

real NAME(change)(const state_t *w)
{
    return MATH(sqrt)(w->change);
}

#endif
