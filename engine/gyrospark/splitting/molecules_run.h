/* Runs of many molecules: functions that ``run.h`` has for a system of bodies. */
#ifndef GS_SPLITTING_MOLECULES_RUN_H
#define GS_SPLITTING_MOLECULES_RUN_H

#include "gyrospark/splitting/molecules.h"

typedef molecules_t run_flows;

/* Whether a step was under way before some steps; the rest is kept in the work memory. */
typedef int kept_state;

_Static_assert(sizeof(molecules_t) + 64 <= sizeof(((work_t *)0)->memory),
    "work memory is too small");

/* The state of the molecules, at the first multiple of 64 bytes in its memory. */
static molecules_t *run_flows_of(work_t *w)
{
    return (molecules_t *)(void *)(((size_t)w->memory + 63) & ~(size_t)63);
}

/* The numbers of the composition. */
static flows *flows_of(work_t *w)
{
    return &run_flows_of(w)->one;
}

/* Starts from (q, p), which the caller may have changed, or at other parameters. */
static void set_state(work_t *w, const real q[N], const real p[N])
{
    molecules_t *s = run_flows_of(w);
    prepare_molecules(s, &w->constants);
    start_molecules(s, q, p);
}

static void keep_state(molecules_t *s, kept_state *was_underway)
{
    s->before = s->now;
    *was_underway = s->is_underway;
}

static void restore_state(molecules_t *s, const kept_state *was_underway)
{
    s->now = s->before;
    s->is_underway = *was_underway;
}

static void begin_run(work_t *w, const options_t *options, real dt, const real q[N],
    const real p[N])
{
    (void)options;
    run_flows_of(w)->one.h = dt;
    set_state(w, q, p);
}

/* Lanes behind the last molecule do not count: without forces of pairs they may move far away. */
static int are_finite(const molecules_state *now)
{
    lanes size = splat(0);
    for (int block = 0; block < BLOCKS; ++block) {
        lanes own = splat(0);
        for (int a = 0; a < COORDINATES; ++a)
            own += now->block[block].q[a];
        for (int e = 0; e < Y; ++e)
            own += now->block[block].y[e];
        size += lanes_select_value(partners_of(-1, block), own, splat(0));
    }
    real sum = 0;
    for (int lane = 0; lane < LANES; ++lane)
        sum += lane_get(&size, lane);
    return isfinite(sum);
}

/* Sets the state at the end of the last step. */
static void get_state(work_t *w, real q[N], real p[N], report_t *report)
{
    (void)report;
    molecules_at_end(run_flows_of(w), q, p);
}

/* One step at the time t, up to its last kick. */
static void step_on(work_t *w, real t)
{
    w->t = t;
    step_molecules(run_flows_of(w));
}

#endif
