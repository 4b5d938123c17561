/* A trajectory that is kept between calls: begin, advance, set_parameters. */
#ifndef GS_RUN_BEGIN_ADVANCE_H
#define GS_RUN_BEGIN_ADVANCE_H

#include "gyrospark/run/integrate.h"

#if !GS_PROFILE_RUN
#if GS_FIXED_POINT
/* The state of a run becomes (q, p); where that is new, nothing is left over of rounding. */
static void take_over(work_t *w, const real q[N], const real p[N])
{
    SINGLE(t) *s = &fast_of(w)->run;
    for (int a = 0; a < N; ++a) {
        if (!(part(&s->q[a], 0) == q[a])) {
            s->q[a] = splat(q[a]);
            s->q_low[a] = splat(0);
        }
        if (!(part(&s->p[a], 0) == p[a])) {
            s->p[a] = splat(p[a]);
            s->p_low[a] = splat(0);
        }
    }
    for (int i = 0; i < LANES; ++i)
        SINGLE(prepare)(s, i, &w->constants, w->held.dt);
    IF_FRAME(SINGLE(wake)(s);)
    SINGLE(set_schur)(s);
    IF_TIME(lanes_at_time(&s->constants, splat(w->t));)
    SINGLE(look)(s);
}

/* After a step that failed: what it left behind is forgotten. */
static void recover(work_t *w)
{
    SINGLE(t) *s = &fast_of(w)->run;
    SINGLE(forget)(s);
    s->work = splat(work_so_far(&w->held.report));
    s->work_low = splat(0);
}
#else
/* Newton keeps nothing from step to step. */
static void take_over(work_t *w, const real q[N], const real p[N])
{
    (void)w, (void)q, (void)p;
}

static void recover(work_t *w)
{
    (void)w;
}
#endif

#if GS_FRAME
#include "gyrospark/frames/trajectory.h"
#endif
#endif

size_t NAME(work_size)(void)
{
    return sizeof(work_t);
}

const report_t *NAME(report_of)(const work_t *work)
{
    return &work->held.report;
}

void NAME(begin)(work_t *w, const parameters_t *parameters, const options_t *options, real dt,
    const real q[N], const real p[N])
{
    w->held.options = *options;
    w->held.dt = dt;
    w->held.start = start_time(parameters);
    w->held.is_new = 0;
    prepare(parameters, &w->constants);
    IF_TIME(w->t = w->held.start;)
    begin(w, options, dt, q, p, &w->held.report);
    for (int a = 0; a < N; ++a) {
        w->held.q[a] = q[a];
        w->held.p[a] = p[a];
    }
    IF_FRAME(begin_frame(w, parameters);)
}

void NAME(set_parameters)(work_t *w, const parameters_t *parameters)
{
    IF_TIME(w->t = w->held.start + (real)w->held.report.steps*w->held.dt;)
    const real before = hamiltonian(AT(&w->constants, w->t), w->held.q, w->held.p);
    prepare(parameters, &w->constants);
    w->held.report.energy_start += hamiltonian(AT(&w->constants,
        w->t), w->held.q, w->held.p) - before;
    w->held.is_new = 1;
    IF_FRAME(change_frame(w, parameters);)
}

int NAME(advance)(work_t *w, long steps, real q[N], real p[N])
{
    const rows_t none = { 0 };
    IF_INPUTS(const inputs_t kept = { 0 };)
    real *old_q = w->held.q, *old_p = w->held.p, jump = 0;
    const int sweeps = w->held.options.solver != NEWTON;
    int moved = 0;
    for (int a = 0; a < N; ++a)
        moved |= !(q[a] == old_q[a]) || !(p[a] == old_p[a]);
    IF_TIME(w->t = w->held.start + (real)w->held.report.steps*w->held.dt;)
    IF_TIME(at_time(&w->constants, w->t);)
    if (moved) /* by the caller: that is no error */
        jump = hamiltonian(&w->constants, q, p) - hamiltonian(&w->constants, old_q, old_p);
    w->held.report.energy_start += jump;
    IF_FRAME(into_frame(w, q, p);)
    if (sweeps && (moved || w->held.is_new))
        take_over(w, q, p);
    w->held.is_new = 0;
    const int status = run_on(&w->held.options, IF_INPUTS(
        kept,) w->held.start, w->held.dt, steps, 1, q, p, none,
        &w->held.report, w);
    IF_FRAME(out_of_frame(w, q, p);)
    for (int a = 0; a < N; ++a) {
        old_q[a] = q[a];
        old_p[a] = p[a];
    }
    if (status != OK) {
        w->held.is_new = 1;
        if (sweeps)
            recover(w);
    }
    return status;
}

#if GS_INPUTS
void NAME(set_inputs)(work_t *w, const real u[INPUTS])
{
    set_inputs(&w->constants, u);
}
#endif

#endif
