/* Profiles control and run: starting values, convergence test, iteration. */
#ifndef GS_PROFILES_SOLVE_H
#define GS_PROFILES_SOLVE_H

#if GS_SPARK
#include "gyrospark/profiles/spark.h"
#else
#include "gyrospark/profiles/midpoint.h"
#endif

/*
 * Polynomial extrapolation by backward differences of the unknowns: x_n = sum_(k < order)
 * history[k]. The error of order k is the next difference of the new values.
 */
static void predict_unknowns(state_t *w)
{
    for (int e = 0; e < X; ++e) {
        w->x[e] = 0;
        for (int k = w->order - 1; k >= 0; --k)
            w->x[e] += w->history[k][e];
    }
}

/* Updates the differences by a completed step; the order with the least error is selected. */
static void record_unknowns(state_t *w)
{
    real *rest = w->x, best = (real)HUGE_VAL; /* the unknowns are overwritten */
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

/* State of the convergence test: squared norms relative to the state. */
typedef struct {
    int iterations, stagnation; /* all, and the last ones without a decrease */
    real remaining, previous;   /* increment and constraint error of the last two iterations */
    real smallest;              /* of all */
} progress_t;

static const progress_t initial_progress = { 0, 0, (real)HUGE_VAL, (real)HUGE_VAL, (real)HUGE_VAL };

/*
 * Whether the iteration has converged: the next increment, extrapolated by the rate of the last two
 * (modes may alternate), is below round-off, or two iterations near round-off brought no decrease.
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

/* Weights of the norms: the state and the increment of the step. */
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
 * Iterates to convergence, at most max_iterations times in all. If the first increment is large,
 * the prediction may lead to another root: the iteration restarts without it.
 */
static status_t solve_fixed_point(state_t *w)
{
    int predicted = w->history_length > 0, restarts = 1;
    progress_t progress;
    for (w->iterations = 1;; ++w->iterations) {
        if (restarts) {
            if (predicted)
                predict_unknowns(w);
            else
                initial_unknowns(w);
            progress = initial_progress;
        }
        if (restarts || (!predicted && (progress.iterations == 1 || progress.iterations == 3))) {
            update_scales(w); /* again: a body at rest has no scale before it moves */
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
