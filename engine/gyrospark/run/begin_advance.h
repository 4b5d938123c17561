/* Stateful interface to a trajectory: begin, advance, set_parameters. */
#ifndef GS_RUN_BEGIN_ADVANCE_H
#define GS_RUN_BEGIN_ADVANCE_H

#include "gyrospark/run/integrate.h"

#if !GS_PROFILE_RUN
#if GS_FIXED_POINT
/* Sets the state to (q, p). A component that changes loses the low word of its compensated sum. */
static void set_state(work_t *w, const real q[N], const real p[N])
{
    SINGLE(t) *s = &fixed_point_of(w)->solver;
    for (int a = 0; a < N; ++a) {
        if (!(lane_get(&s->q[a], 0) == q[a])) {
            s->q[a] = splat(q[a]);
            s->q_low[a] = splat(0);
        }
        if (!(lane_get(&s->p[a], 0) == p[a])) {
            s->p[a] = splat(p[a]);
            s->p_low[a] = splat(0);
        }
    }
    for (int i = 0; i < LANES; ++i)
        SINGLE(prepare)(s, i, &w->constants, w->simulation.dt);
    IF_FRAME(SINGLE(release_equilibrium)(s);)
#if GS_CONSTANT_SCHUR
    SINGLE(prepare_schur)(s);
#endif
    IF_TIME(lanes_at_time(&s->constants, splat(w->t));)
    IF_CONSTRAINED(SINGLE(evaluate_constraints)(s);)
}

/* Discards the predictor's history after a failed step, and restores the work of the report. */
static void reset_iteration(work_t *w)
{
    SINGLE(t) *s = &fixed_point_of(w)->solver;
    SINGLE(reset_history)(s);
    s->work = splat(0);
    IF_FORCES(s->work = splat(w->simulation.report.work);)
    s->work_low = splat(0);
}
#elif !GS_SPLITTING
/* Newton's method has no state from step to step, but what it predicts by with velocity constraints. */
static void set_state(work_t *w, const real q[N], const real p[N])
{
    (void)w, (void)q, (void)p;
#if GS_VELOCITY_CONSTRAINTS
    begin_history(w);
#endif
}

static void reset_iteration(work_t *w)
{
    (void)w;
#if GS_VELOCITY_CONSTRAINTS
    begin_history(w);
#endif
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
    return &work->simulation.report;
}

void NAME(begin)(work_t *w, const parameters_t *parameters, const options_t *options, real dt,
    const real q[N], const real p[N])
{
    w->simulation.options = *options;
    w->simulation.dt = dt;
#if GS_FORCED_BY_TIME
    w->simulation.start = origin_of(parameters);
#endif
    w->simulation.state_changed = 0;
    prepare(parameters, &w->constants);
    IF_TIME(w->t = 0;)
    begin(w, options, dt, q, p, &w->simulation.report);
    for (int a = 0; a < N; ++a) {
        w->simulation.q[a] = q[a];
        w->simulation.p[a] = p[a];
    }
    IF_FRAME(begin_frame(w, parameters);)
}

void NAME(set_parameters)(work_t *w, const parameters_t *parameters)
{
    IF_TIME(w->t = (real)w->simulation.report.steps*w->simulation.dt;)
    const real before = hamiltonian(AT(&w->constants, w->t), w->simulation.q, w->simulation.p);
#if GS_FORCED_BY_TIME
    const parameters_t own = begun_at(w->simulation.start, parameters);
    prepare(&own, &w->constants);
#else
    prepare(parameters, &w->constants);
#endif
    w->simulation.report.energy_start += hamiltonian(AT(&w->constants,
        w->t), w->simulation.q, w->simulation.p) - before;
    w->simulation.state_changed = 1;
    IF_FRAME(change_frame(w, parameters);)
}

int NAME(advance)(work_t *w, long steps, real q[N], real p[N])
{
    const rows_t none = { 0 };
    IF_INPUTS(const inputs_t no_inputs = { 0 };)
    real *old_q = w->simulation.q, *old_p = w->simulation.p, jump = 0;
    const int by_fixed_point = w->simulation.options.solver != NEWTON;
    int differs = 0;
    for (int a = 0; a < N; ++a)
        differs |= !(q[a] == old_q[a]) || !(p[a] == old_p[a]);
    IF_TIME(w->t = (real)w->simulation.report.steps*w->simulation.dt;)
    IF_TIME(at_time(&w->constants, w->t);)
    if (differs) /* the caller changed the state: the jump of H is no energy error */
        jump = hamiltonian(&w->constants, q, p) - hamiltonian(&w->constants, old_q, old_p);
    w->simulation.report.energy_start += jump;
    IF_FRAME(into_frame(w, q, p);)
    if (by_fixed_point && (differs || w->simulation.state_changed))
        set_state(w, q, p);
    w->simulation.state_changed = 0;
    const int status = run_on(&w->simulation.options, IF_INPUTS(
        no_inputs,) 0, w->simulation.dt, steps, 1, q, p, none,
        &w->simulation.report, w);
    IF_FRAME(out_of_frame(w, q, p);)
    for (int a = 0; a < N; ++a) {
        old_q[a] = q[a];
        old_p[a] = p[a];
    }
    if (status != OK) {
        w->simulation.state_changed = 1;
        if (by_fixed_point)
            reset_iteration(w);
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
