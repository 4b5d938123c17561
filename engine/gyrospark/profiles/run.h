/* Profile run: a step by fixed-point iteration, with Newton's method where it fails. */
#ifndef GS_PROFILES_RUN_H
#define GS_PROFILES_RUN_H

#include "gyrospark/profiles/solve.h"
#include "gyrospark/newton/step.h"

#if GS_FORCES
#if GS_SPARK
#if GS_CONSTRAINED
/* The unknowns (B.2) from the scaled ones. */
static void unscale(const state_t *w, real x[U])
{
    for (int e = 0; e < S*N; ++e) {
        x[e] = w->x[e]/(w->h*weights[e/N]);
        x[K_HAT + e] = w->x[HAT + e]/(w->h*weights_hat[e/N]);
    }
    for (int e = 0; e < P*M; ++e) {
        const int l = e/M, node = l == 0 ? P - 1 : l - 1;
        x[LAMBDA + e] = w->x[IMPULSE + node*M + e % M]/(w->h*tableau.b_tilde[l]);
    }
}
#else
/* The unknowns (B.2) from the scaled ones. */
static void unscale(const state_t *w, real x[U])
{
    for (int e = 0; e < S*N; ++e) {
        x[e] = w->x[e]/(w->h*weights[e/N]);
        x[K_HAT + e] = w->x[HAT + e]/(w->h*weights_hat[e/N]);
    }
}
#endif
#else
/* The unknowns from those of the sweeps: a multiplier is an impulse by h. */
static void unscale(const state_t *w, real x[U])
{
    for (int e = 0; e < X; ++e)
        x[e] = w->x[e]/(e < IMPULSE ? 1 : w->h);
}
#endif

/* The work of the step that sweeps have just done, from their unknowns. */
static void note_sweeps(work_t *w, const real q[N], const real p[N])
{
    unscale(&w->state, w->x);
    note_work(w, w->state.h, q, p, w->x);
}
#else
/* Without forces no work is done. */
static void note_sweeps(work_t *w, const real q[N], const real p[N])
{
    (void)w, (void)q, (void)p;
}
#endif

/* ---------------------------------------------------------- a run: sweeps, Newton behind them */

/* Rounding errors are forgotten where the state is another one. */
static void take_over(work_t *w, const real q[N], const real p[N])
{
    state_t *s = &w->state;
    s->constants = w->constants;
    for (int a = 0; a < N; ++a) {
        if (!(s->q[a] == q[a]))
            s->q_low[a] = 0;
        if (!(s->p[a] == p[a]))
            s->p_low[a] = 0;
        s->q[a] = q[a];
        s->p[a] = p[a];
    }
}

/* After a step that sweeps have not done: starting values come from the steps behind it. */
static void recover(work_t *w)
{
    w->state.known = w->state.order = 0;
}

static void begin_run(work_t *w, const options_t *options, real dt, const real q[N],
    const real p[N])
{
    state_t *s = &w->state;
    s->tolerance = options->tolerance;
    s->max_sweeps = options->max_iterations;
    s->h = dt;
    s->h_inverse = 1/dt;
    s->constants = w->constants;
    w->failures = w->wait = s->known = s->order = 0;
    for (int a = 0; a < N; ++a) {
        s->q[a] = q[a];
        s->p[a] = p[a];
        s->q_low[a] = s->p_low[a] = 0;
    }
}

/* One step by sweeps alone; one that is not done leaves the state. */
static int advance_by_sweeps(work_t *w, real q[N], real p[N])
{
    state_t *s = &w->state;
    real q_end[N], p_end[N], q_low[N], p_low[N];
    s->t = w->t;
    look(s);
    const int status = sweep_until_done(s);
    if (status != OK)
        return status;
    end_of_step(s, q_end, p_end, q_low, p_low);
    if (!isfinite(norm(N, q_end) + norm(N, p_end)))
        return NOT_FINITE;
    note_sweeps(w, q, p);
    record(s);
    for (int a = 0; a < N; ++a) {
        q[a] = s->q[a] = q_end[a];
        p[a] = s->p[a] = p_end[a];
        s->q_low[a] = q_low[a];
        s->p_low[a] = p_low[a];
    }
    return OK;
}

/* One step of a run, counted and observed: by Newton where sweeps fail, and some steps after. */
static int advance_run(work_t *w, const options_t *options, real dt, real q[N], real p[N],
    real multipliers[ROOM], int *iterations, report_t *report)
{
    const int only = options->solver == FIXED_POINT, tries = options->solver != NEWTON
        && (only || w->wait == 0);
    int status = NOT_CONVERGED, taken = 0;
    *iterations = 0;
    if (tries) {
        status = advance_by_sweeps(w, q, p);
        *iterations = w->state.sweeps;
        w->failures = status == OK ? 0 : w->failures;
    }
    if (status != OK) {
        if (!only)
            status = advance(w, options, dt, q, p, q, p, multipliers, &taken);
        *iterations += taken;
        if (status != OK)
            return status;
        if (options->solver != NEWTON) {
            ++report->newton_steps;
            w->wait = tries ? (1 << (w->failures < 6 ? w->failures++ : 6)) - 1 : w->wait - 1;
            take_over(w, q, p);
            recover(w);
        }
    }
    count_work(w, report);
    observe(&w->constants, q, p, report);
    return OK;
}

#endif
