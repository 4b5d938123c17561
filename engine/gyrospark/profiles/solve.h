/* Profiles control and run: starting values, convergence test, iteration. */
#ifndef GS_PROFILES_SOLVE_H
#define GS_PROFILES_SOLVE_H

#if GS_SPARK
#include "gyrospark/profiles/spark.h"
#else
#include "gyrospark/profiles/midpoint.h"
#endif

/* ---------------------------------------------------------------- starting values from the past */

/*
 * Backward differences of the unknowns, past[k], continue the polynomial through the last steps:
 * x_n = sum_(k < order) past[k]. What that has missed is the next difference of the new values.
 */
static void predict_unknowns(state_t *w)
{
    for (int e = 0; e < X; ++e) {
        w->x[e] = 0;
        for (int k = w->order - 1; k >= 0; --k)
            w->x[e] += w->history[k][e];
    }
}

/* Records the unknowns of the step just done, and chooses the order for the next one. */
static void record_unknowns(state_t *w)
{
    real *rest = w->x, best = (real)HUGE_VAL; /* the unknowns are not asked for any more */
    w->order = 1;
    for (int k = 0; k < ORDERS && k <= w->history_length; ++k) {
        real missed = 0;
        for (int e = 0; e < X; ++e) {
            const real old = w->history[k][e];
            w->history[k][e] = rest[e];
            rest[e] -= old;
            missed += e < HAT ? rest[e]*rest[e] : 0;
        }
        if (k < w->history_length && missed < best) {
            best = missed;
            w->order = k + 1;
        }
    }
    w->history_length += w->history_length < ORDERS;
}

/* ------------------------------------------------------------------- when a sweep has converged */

/* What is known of the sweeps of a step: squares, relative to the state. */
typedef struct {
    int iterations, stagnation;   /* all; those in a row that brought nothing nearer */
    real remaining, previous;  /* what the last sweep changed or found amiss, and the one before it */
    real smallest;         /* of all */
} progress_t;

static const progress_t initial_progress = { 0, 0, (real)HUGE_VAL, (real)HUGE_VAL, (real)HUGE_VAL };

/*
 * Whether sweeps may end: when the next would change less than round-off, at the rate of the last
 * two (modes may alternate), or when two in a row near round-off have brought nothing nearer.
 */
static int test_convergence(progress_t *s, real change, real defect, real tolerance)
{
    const real low = 4096*epsilon, beyond = epsilon/256, least_rate = (real)0.0001;
    const real remaining = change + (defect > 4*epsilon*epsilon ? defect : 0);
    const real of_two = s->iterations < 2 ? least_rate : MATH(sqrt)(remaining/s->previous);
    const real next = remaining*MATH(fmax)(remaining/s->remaining, of_two);
    s->stagnation = remaining < (real)0.8*s->smallest ? 0 : s->stagnation + 1;
    s->previous = s->remaining;
    s->remaining = remaining;
    s->smallest = remaining < s->smallest ? remaining : s->smallest;
    return change <= tolerance*tolerance || (++s->iterations > 1 && next < beyond*beyond)
        || (s->stagnation >= 2 && remaining < low*low);
}

/* ----------------------------------------------------------------------------------- the steps */

/* What changes are relative to: the state and the step's own length. */
static void update_scales(state_t *w)
{
    real dq[N], dp[N], q_square = LIMIT(MIN), p_square = LIMIT(MIN);
    total(S, w->x, dq);
    total(S, w->x + HAT, dp);
    for (int a = 0; a < N; ++a) {
        q_square += w->q[a]*w->q[a] + dq[a]*dq[a];
        p_square += w->p[a]*w->p[a] + dp[a]*dp[a];
    }
    w->q_weight = 1/q_square;
    w->p_weight = 1/p_square;
}

/*
 * Sweeps until they have converged, at most max_sweeps, all told. They begin with what past
 * steps predict, and once more without it where the first of them shows it to be far off: that may
 * lead to another root.
 */
static int solve_fixed_point(state_t *w)
{
    int predicted = w->history_length > 0, restarts = 1;
    progress_t progress;
    for (w->iterations = 1;; ++w->iterations) {
        if (restarts) {
            (predicted ? predict_unknowns : initial_unknowns)(w);
            progress = initial_progress;
        }
        if (restarts || (!predicted && (progress.iterations == 1 || progress.iterations == 3))) {
            update_scales(w); /* again, for what is at rest has none before it moves */
            begin_iteration(w);
        }
        w->change = iterate_once(w);
        const int close = w->change < (real)0.0004; /* 2 % */
        if (test_convergence(&progress, w->change, w->defect, w->tolerance))
            return OK;
        restarts = predicted && progress.iterations == 1 && !close;
        predicted = predicted && !restarts;
        if (w->iterations >= w->max_iterations || (!restarts && !(w->change < 9)))
            return close ? NOT_CONVERGED : isnan(w->change) ? NOT_FINITE : DIVERGED;
    }
}

#endif
