/* Runs by compositions of flows: one trajectory. */
#ifndef GS_SPLITTING_RUN_H
#define GS_SPLITTING_RUN_H

#include "gyrospark/splitting/start.h"

#include "gyrospark/run/record.h"

/* The state before some steps. */
typedef struct {
    flow_state now;
    int is_underway;
} kept_state;

_Static_assert(sizeof(flows) + 64 <= sizeof(((work_t *)0)->memory), "work memory is too small");

/* The state of the composition in its memory. */
static flows *flows_of(work_t *w)
{
    return ALIGNED(w->memory);
}

/* Starts from (q, p), which the caller may have changed, or at other parameters. */
static void set_state(work_t *w, const real q[N], const real p[N])
{
    flows *s = flows_of(w);
    IF_FORCES(s->now.work = w->simulation.report.work;) /* with that of the last drift */
    s->now.work_low = 0;
    prepare_flows(s, &w->constants, s->h);
    start_flows(s, q, p);
}

/* Copies what a step changes, to take steps again. */
static void keep_state(const flows *s, kept_state *kept)
{
    kept->now = s->now;
    kept->is_underway = s->is_underway;
}

static void restore_state(flows *s, const kept_state *kept)
{
    s->now = kept->now;
    s->is_underway = kept->is_underway;
}

static void begin_run(work_t *w, const options_t *options, real dt, const real q[N],
    const real p[N])
{
    (void)options;
    flows *s = flows_of(w);
    s->h = dt;
    prepare_flows(s, &w->constants, dt);
    start_flows(s, q, p);
    s->now.work = s->now.work_low = 0;
}

static int are_finite(const flow_state *now)
{
    return isfinite(norm(N, now->q) + norm(Y, now->y));
}

/* Sets the state at the end of the last step, and its work. */
static void get_state(work_t *w, real q[N], real p[N], report_t *report)
{
    real work;
    const flows *s = flows_of(w);
    end_of_step(&w->constants, s, q, p, &work);
    (void)report; /* without forces */
    IF_FORCES(report->work = s->now.work + (s->now.work_low + work);)
}

/* One step at the time t, up to its last kick. */
static void step_on(work_t *w, real t)
{
    flows *s = flows_of(w);
    w->t = s->t = t;
    for (int i = 0; i < s->stages; ++i)
        take_stage(&w->constants, s, i);
}

static void reset_iteration(work_t *w)
{
    (void)w; /* nothing is kept of a failed step */
}

/*
 * Is step n of a run recorded? The state at the end of a step costs a drift of its own, so that
 * later steps are recorded now and then only.
 */
static int is_observed(long n)
{
    return n <= OBSERVED_STEPS || n % OBSERVED_EVERY == 0;
}

#if !GS_PROFILE_RUN
/* A step alone. */
static int single_step(work_t *w, const options_t *options, real dt, const real q[N],
    const real p[N], real q1[N], real p1[N], real multipliers[ROOM], int *iterations)
{
    report_t report = { 0 };
    (void)multipliers;
    *iterations = 0;
    begin_run(w, options, dt, q, p);
    step_on(w, w->t);
    if (!are_finite(&flows_of(w)->now))
        return NOT_FINITE;
    get_state(w, q1, p1, &report);
    return OK;
}
#endif

#endif
