/* Profiles control and run: starting values, convergence test, iteration. */
#ifndef GS_PROFILES_SOLVE_H
#define GS_PROFILES_SOLVE_H

#include "gyrospark/profiles/arithmetic.h"

/* ---------------------------------------------------------------- starting values from the past */

/*
 * Backward differences of the unknowns, past[k], continue the polynomial through the last steps:
 * x_n = sum_(k < order) past[k]. What that has missed is the next difference of the new values.
 */
static void predict(state_t *w)
{
    for (int e = 0; e < X; ++e) {
        w->x[e] = 0;
        for (int k = w->order - 1; k >= 0; --k)
            w->x[e] += w->past[k][e];
    }
}

/* Records the unknowns of the step just done, and chooses the order for the next one. */
static void record(state_t *w)
{
    real *rest = w->x, best = (real)HUGE_VAL; /* the unknowns are not asked for any more */
    w->order = 1;
    for (int k = 0; k < ORDERS && k <= w->known; ++k) {
        real missed = 0;
        for (int e = 0; e < X; ++e) {
            const real old = w->past[k][e];
            w->past[k][e] = rest[e];
            rest[e] -= old;
            missed += e < HAT ? rest[e]*rest[e] : 0;
        }
        if (k < w->known && missed < best) {
            best = missed;
            w->order = k + 1;
        }
    }
    w->known += w->known < ORDERS;
}

/* ------------------------------------------------------------------- when a sweep has converged */

/* What is known of the sweeps of a step: squares, relative to the state. */
typedef struct {
    int sweeps, idle;   /* all; those in a row that brought nothing nearer */
    real left, before;  /* what the last sweep changed or found amiss, and the one before it */
    real least;         /* of all */
} progress_t;

static const progress_t no_sweeps = { 0, 0, (real)HUGE_VAL, (real)HUGE_VAL, (real)HUGE_VAL };

/*
 * Whether sweeps may end: when the next would change less than round-off, at the rate of the last
 * two (modes may alternate), or when two in a row near round-off have brought nothing nearer.
 */
static int is_done(progress_t *s, real change, real defect, real tolerance)
{
    const real low = 4096*epsilon, beyond = epsilon/256, seen = (real)0.0001;
    const real left = change + (defect > 4*epsilon*epsilon ? defect : 0);
    const real of_two = s->sweeps < 2 ? seen : MATH(sqrt)(left/s->before);
    const real next = left*MATH(fmax)(left/s->left, of_two);
    s->idle = left < (real)0.8*s->least ? 0 : s->idle + 1;
    s->before = s->left;
    s->left = left;
    s->least = left < s->least ? left : s->least;
    return change <= tolerance*tolerance || (++s->sweeps > 1 && next < beyond*beyond)
        || (s->idle >= 2 && left < low*low);
}

/* ----------------------------------------------------------------------------------- the steps */

/* What changes are relative to: the state and the step's own length. */
static void sizes(state_t *w)
{
    real dq[N], dp[N], q_square = LIMIT(MIN), p_square = LIMIT(MIN);
    total(S, w->x, dq);
    total(S, w->x + HAT, dp);
    for (int a = 0; a < N; ++a) {
        q_square += w->q[a]*w->q[a] + dq[a]*dq[a];
        p_square += w->p[a]*w->p[a] + dp[a]*dp[a];
    }
    w->q_size = 1/q_square;
    w->p_size = 1/p_square;
}

/*
 * Sweeps until they have converged, at most max_sweeps, all told. They begin with what past
 * steps predict, and once more without it where the first of them shows it to be far off: that may
 * lead to another root.
 */
static int sweep_until_done(state_t *w)
{
    int predicted = w->known > 0, fresh = 1;
    progress_t progress;
    for (w->sweeps = 1;; ++w->sweeps) {
        if (fresh) {
            (predicted ? predict : first_values)(w);
            progress = no_sweeps;
        }
        if (fresh || (!predicted && (progress.sweeps == 1 || progress.sweeps == 3))) {
            sizes(w); /* again, for what is at rest has none before it moves */
            begin_sweeps(w);
        }
        w->change = sweep(w);
        const int close = w->change < (real)0.0004; /* 2 % */
        if (is_done(&progress, w->change, w->defect, w->tolerance))
            return OK;
        fresh = predicted && progress.sweeps == 1 && !close;
        predicted = predicted && !fresh;
        if (w->sweeps >= w->max_sweeps || (!fresh && !(w->change < 9)))
            return close ? NOT_CONVERGED : isnan(w->change) ? NOT_FINITE : DIVERGED;
    }
}

#endif
