/* Continues a run by compositions of flows. */
#ifndef GS_SPLITTING_RUN_ON_H
#define GS_SPLITTING_RUN_ON_H

#include "gyrospark/splitting/run.h"

/* Takes the steps first + 1 to last; returns the number of those whose state is finite. */
static long take_steps(IF_INPUTS(inputs_t inputs,) real start, real dt, long first, long last,
    work_t *w)
{
    flows *s = flows_of(w);
    const flow_state before = s->now;
    const int was_underway = s->is_underway;
    for (long n = first; n < last; ++n) {
        IF_INPUTS(set_step_inputs(&w->constants, &inputs, 0, n);)
        step_on(w, start + (real)n*dt);
    }
    if (are_finite(&s->now))
        return last - first;
    s->now = before; /* once more, up to the step that fails */
    s->is_underway = was_underway;
    for (long n = first;; ++n) {
        const flow_state previous = s->now;
        const int is_underway = s->is_underway;
        IF_INPUTS(set_step_inputs(&w->constants, &inputs, 0, n);)
        step_on(w, start + (real)n*dt);
        if (are_finite(&s->now))
            continue;
        s->now = previous;
        s->is_underway = is_underway;
        return n - first;
    }
}

/* Continues a run that began at the time `start` by `steps` steps. */
static int run_on(const options_t *options, IF_INPUTS(
    inputs_t inputs,) real start, real dt, long steps, long every,
    real q[N], real p[N], rows_t out, report_t *report, work_t *work)
{
    const long begun = report->steps, end = begun + steps;
    int status = OK;
    while (status == OK && report->steps < end) {
        const long first = report->steps;
        long last = first + 1; /* the next step that is recorded or stored */
        while (last < end && !is_observed(last) && (last - begun) % every != 0)
            ++last;
        report->steps += take_steps(IF_INPUTS(inputs,) start, dt, first, last, work);
        if (report->steps < last)
            status = NOT_FINITE;
        const int stored = status == OK && (last - begun) % every == 0;
        if (!stored && status == OK && last < end && !is_observed(last))
            continue;
        real none[ROOM];
        get_state(work, q, p, report);
        if (status == OK && is_observed(last))
            observe_steps(AT(&work->constants, start + (real)last*dt), last, q, p, report);
        if (stored)
            store(out, (last - begun)/every - 1, q, p, work, options, none, 0, report);
    }
    return status;
}

#endif
