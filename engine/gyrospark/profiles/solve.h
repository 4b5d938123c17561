/* Profiles control and run: starting values, convergence test, iteration. */
#ifndef GS_PROFILES_SOLVE_H
#define GS_PROFILES_SOLVE_H

#if GS_SPARK
#include "gyrospark/profiles/spark.h"
#else
#include "gyrospark/profiles/midpoint.h"
#endif

/* g at the state with its round-off, and 1/|G_mu|^2 of each row of G. */
static void evaluate_constraints(state_t *w)
{
#if GS_CONSTRAINED
    real G[M][N];
    KERNEL(constraint)(&w->constants, w->q, w->g);
    KERNEL(constraint_jacobian)(&w->constants, w->q, G);
    for (int mu = 0; mu < M; ++mu) {
        real square = LIMIT(MIN);
        for (int a = 0; a < N; ++a) {
            w->g[mu] += G[mu][a]*w->q_low[a];
            square += G[mu][a]*G[mu][a];
        }
        w->row_weight[mu] = (real)1/square;
    }
#else
    w->defect = 0;
#endif
}

/*
 * Polynomial extrapolation by backward differences of the unknowns: x_n = sum_(k < order)
 * history[k]. The error of order k is the next difference of the new values.
 */
static void predict_unknowns(state_t *w)
{
    for (int e = 0; e < X; ++e) {
        w->x[e] = 0;
        for (int k = w->order - 1; k >= 0; --k) {
            w->x[e] += w->history[k][e];
        }
    }
}

/* Updates the differences by a completed step; the order with the least error is selected. */
static void record_unknowns(state_t *w)
{
    real *rest = w->x; /* the unknowns are overwritten */
    real best = (real)HUGE_VAL;
    w->order = 1;
    for (int k = 0; (k < ORDERS) && (k <= w->history_length); ++k) {
        real missed = (real)0;
        for (int e = 0; e < X; ++e) {
            const real old = w->history[k][e];
            w->history[k][e] = rest[e];
            rest[e] -= old;
            if (e < HAT) {
                missed += rest[e]*rest[e];
            }
        }
        if ((k < w->history_length) && (missed < best)) {
            best = missed;
            w->order = k + 1;
        }
    }
    if (w->history_length < ORDERS) {
        ++w->history_length;
    }
}

/* State of the convergence test: squared norms relative to the state. */
typedef struct {
    int iterations;
    int stagnation; /* the last iterations without a decrease */
    real remaining; /* increment and constraint error of the last iteration, */
    real previous;  /* of the one before, */
    real smallest;  /* and of all */
} progress_t;

/*
 * Whether the iteration has converged: the next increment, extrapolated by the rate of the last two
 * (modes may alternate), is below round-off, or two iterations near round-off brought no decrease.
 */
static bool test_convergence(progress_t *s, real change, real defect, real tolerance)
{
    const real low = (real)4096*epsilon;
    const real beyond = epsilon/(real)256;
    const real visible = (defect > ((real)4*epsilon*epsilon)) ? defect : (real)0;
    const real remaining = change + visible;
    real rate = (real)0.0001; /* at least, of two iterations */
    if (s->iterations >= 2) {
        rate = MATH(sqrt)(remaining/s->previous);
    }
    const real next = remaining*MATH(fmax)(remaining/s->remaining, rate);
    s->stagnation = (remaining < ((real)0.8*s->smallest)) ? 0 : (s->stagnation + 1);
    s->previous = s->remaining;
    s->remaining = remaining;
    s->smallest = (remaining < s->smallest) ? remaining : s->smallest;
    ++s->iterations;
    return (change <= (tolerance*tolerance)) || ((s->iterations > 1) && (next < (beyond*beyond)))
        || ((s->stagnation >= 2) && (remaining < (low*low)));
}

/* Weights of the norms: the state and the increment of the step. */
static void update_scales(state_t *w)
{
    real dq[N];
    real dp[N];
    real q_square = LIMIT(MIN);
    real p_square = LIMIT(MIN);
    total(S, w->x, dq);
    total(S, &w->x[HAT], dp);
    for (int a = 0; a < N; ++a) {
        q_square += (w->q[a]*w->q[a]) + (dq[a]*dq[a]);
        p_square += (w->p[a]*w->p[a]) + (dp[a]*dp[a]);
    }
    w->q_weight = (real)1/q_square;
    w->p_weight = (real)1/p_square;
}

/*
 * Iterates to convergence, at most max_iterations times in all. If the first increment is large,
 * the prediction may lead to another root: the iteration restarts without it.
 */
static status_t solve_fixed_point(state_t *w)
{
    const progress_t initial = { 0, 0, (real)HUGE_VAL, (real)HUGE_VAL, (real)HUGE_VAL };
    progress_t progress = initial;
    bool predicted = w->history_length > 0;
    bool restarts = true;
    bool close = false;
    bool converged = false;
    bool scaled = true;
    bool ended = false;
    status_t status = DIVERGED;
    w->iterations = 0;
    while (!ended) {
        ++w->iterations;
        if (restarts) {
            if (predicted) {
                predict_unknowns(w);
            } else {
                initial_unknowns(w);
            }
            progress = initial;
        }
        if (restarts
            || (!predicted && ((progress.iterations == 1) || (progress.iterations == 3)))) {
            update_scales(w); /* again: a body at rest has no scale before it moves */
            begin_iteration(w);
        }
        w->change = iterate_once(w);
        close = w->change < (real)0.0004; /* 2 % */
        converged = test_convergence(&progress, w->change, w->defect, w->tolerance);
        restarts = predicted && (progress.iterations == 1) && !close;
        /* Coordinates or momenta of 0 with rates of 0 have no scale at first. */
        scaled = (progress.iterations > 1)
            || (((w->q_weight*LIMIT(MIN)) < (real)0.5) && ((w->p_weight*LIMIT(MIN)) < (real)0.5));
        predicted = predicted && !restarts;
        ended = converged || (w->iterations >= w->max_iterations)
            || (!restarts && scaled && !(w->change < (real)9));
    }
    if (converged) {
        status = OK;
    } else if (close) {
        status = NOT_CONVERGED;
    } else if (isnan(w->change) != 0) {
        status = NOT_FINITE;
    } else {
        status = DIVERGED;
    }
    return status;
}

#endif
